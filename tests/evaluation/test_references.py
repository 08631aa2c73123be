"""What trajectories from elsewhere are scored on: a file, or what a mission withholds."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from gtsam_nav.errors import DataError
from gtsam_nav.evaluation.references import open_reference
from gtsam_nav.evaluation.settings import EvaluationSettings
from gtsam_nav.preprocess.gnss_policy import GnssSettings
from gtsam_nav.series import ReferenceSeries

GNSS = GnssSettings()


def series_of(path: Path, **options: str) -> ReferenceSeries:
    sensor, _ = open_reference(path, GNSS, **options)
    assert (sensor.name, sensor.type) == (path.name, "reference")
    assert isinstance(sensor.series, ReferenceSeries)
    return sensor.series


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".second.csv.gz"])
def test_positions_alone(tmp_path: Path, suffix: str) -> None:
    text = "t,n,e,d\n0,1,2,3\n1,4,5,6\n1,4,5,6\n2,nan,0,0\n"
    path = tmp_path / f"truth{suffix}"
    path.write_bytes(gzip.compress(text.encode()) if suffix.endswith("gz") else text.encode())
    series = series_of(path)
    np.testing.assert_array_equal(series.t, [0.0, 1.0])
    np.testing.assert_array_equal(series.p_n, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    assert series.rpy is None
    assert series.sigma is None


def test_attitude_and_sigma_are_read_where_they_stand(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text(
        "t,n,e,d,roll_deg,pitch_deg,yaw_deg,sigma\n0,1,2,3,10,20,30,0.5\n1,1,2,3,-10,0,90,0.25\n"
    )
    series = series_of(path)
    assert series.rpy is not None
    np.testing.assert_allclose(np.degrees(series.rpy), [[10, 20, 30], [-10, 0, 90]])
    np.testing.assert_array_equal(series.sigma, [0.5, 0.25])


@pytest.mark.parametrize(
    ("frame", "p_n", "yaw_deg"), [("ned", [1.0, 2.0, 3.0], 0.0), ("enu", [2.0, 1.0, -3.0], 90.0)]
)
@pytest.mark.parametrize("suffix", [".tum", ".txt"])
def test_poses_of_a_tum_file(
    tmp_path: Path, suffix: str, frame: str, p_n: list[float], yaw_deg: float
) -> None:
    path = tmp_path / f"truth{suffix}"
    path.write_text("0 1 2 3 0 0 0 1\n1 1 2 3 0 0 0 1\n")
    series = series_of(path, frame=frame)
    np.testing.assert_allclose(series.p_n, [p_n, p_n], atol=1e-12)
    assert series.rpy is not None
    np.testing.assert_allclose(np.degrees(series.rpy[:, 2]), yaw_deg)


def test_positions_that_are_left_out_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("t,n,e,d,sigma\n0,1,2,3,1\n1,1,2,3,nan\n2,1,2,3,nan\n3,1,2,3,1\n4,1")
    _, (warning,) = open_reference(path, GNSS)
    left_out = "2 x non-finite sigma, 1 x truncated line"
    assert warning == f"positions of the reference are left out: {left_out}"


def test_a_file_without_a_valid_position_is_none(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("t,n,e,d\n0,nan,0,0\n1,nan,0,0\n")
    with pytest.raises(DataError, match=r"no valid position \(2 dropped\)"):
        open_reference(path, GNSS)


def mission_folder(folder: Path) -> Path:
    (folder / "mission.yaml").write_text(
        "name: fixes\nsensors:\n  gnss: {file: gnss.csv}\n  depth: {file: depth.csv}\n"
    )
    rows = "".join(f"{k},{k},0,0,1,1,1\n" for k in range(20))
    (folder / "gnss.csv").write_text("t,n,e,d,sigma_n,sigma_e,sigma_d\n" + rows)
    (folder / "depth.csv").write_text(
        "t,depth_m,sigma\n" + "".join(f"{k},1,0.1\n" for k in range(20))
    )
    return folder


def test_of_a_mission_the_withheld_fixes_are_taken(tmp_path: Path) -> None:
    folder = mission_folder(tmp_path)
    reference, _ = open_reference(folder, GnssSettings(use="every_k", every_k=4))
    np.testing.assert_array_equal(reference.series.t, [k for k in range(20) if k % 4])
    with pytest.raises(DataError, match="the GNSS policy withholds no fix"):
        open_reference(folder, GnssSettings(use="all"))


def test_a_window_has_a_start_before_its_stop() -> None:
    assert EvaluationSettings().window_s is None
    assert EvaluationSettings(window_s=(1.0, 2.0)).window_s == (1.0, 2.0)
    for stop in (1.0, 0.5):
        with pytest.raises(ValidationError, match=rf"\[1\.0, {stop}\] is empty"):
            EvaluationSettings(window_s=(1.0, stop))
