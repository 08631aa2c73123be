"""Dumps of a Ping360: an invented one with every fault, and the recorded one."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from gtsam_nav.errors import DataError
from gtsam_nav.mission import Mission
from gtsam_nav.readers import open_mission
from gtsam_nav.series import BeamSeries

N = 8


def stamp(milliseconds: int, to: str = "000000") -> str:
    text = f"{to}{milliseconds:03d}"
    return " ".join(f"0x00{digit}" for digit in text)


def dump(folder: Path, **changed: dict[int, str]) -> Path:
    """Eight beams of four bins; ``changed`` are lines by file and number."""
    lines = {
        "angle": [str(200 + k) for k in range(N)],
        "data": [" ".join(hex(16 * k + j) for j in range(4)) for k in range(N)],
        "number_of_samples": ["4"] * N,
        "sample_period": ["80"] * N,
        "timestamp": [stamp(100 * k) for k in range(N)],
    }
    for name, replaced in changed.items():
        for k, line in replaced.items():
            lines[name][k] = line
    for name, rows in lines.items():
        (folder / f"{name}.dat").write_text("\n".join(rows) + "\n")
    return folder


def beams_of(mission: Mission) -> BeamSeries:
    series = mission.sensors["sonar"].series
    assert isinstance(series, BeamSeries)
    return series


def test_beams_angles_and_ranges(tmp_path: Path) -> None:
    series = beams_of(open_mission(dump(tmp_path)))
    np.testing.assert_allclose(series.t, 0.1 * np.arange(N))
    np.testing.assert_allclose(series.angle[:2], np.radians([180.0, 180.9]))
    np.testing.assert_array_equal(series.intensity[1], [16, 17, 18, 19])
    # 80 ticks of 25 ns are 2 us: 1.5 mm there and back
    assert series.resolution_m == pytest.approx(1.5e-3)


def test_times_go_on_after_midnight(tmp_path: Path) -> None:
    times = {k: stamp(100 * k, "235959" if k < 4 else "000000") for k in range(N)}
    series = beams_of(open_mission(dump(tmp_path, timestamp=times)))
    np.testing.assert_allclose(np.diff(series.t)[3], 1.1)


def test_everything_that_is_dropped_is_counted(tmp_path: Path) -> None:
    read = open_mission(
        dump(
            tmp_path,
            number_of_samples={1: "2"},
            data={2: "0x1 0x2", 3: "0x1 0x2 0x3 0x1ff", 4: "words"},
            sample_period={5: "160"},
            timestamp={6: "0x001 0x002"},
        )
    )
    assert Counter(r.reason for r in read.rejections) == {
        "cut message": 2,
        "malformed line": 2,
        "another range": 1,
        "non-finite t": 1,
    }
    assert len(beams_of(read)) == 2


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    dump(tmp_path)
    (tmp_path / "sample_period.dat").unlink()
    with pytest.raises(DataError, match=r"sample_period.dat is missing"):
        open_mission(tmp_path)


def test_a_dump_without_a_whole_beam(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no beam holds echoes"):
        open_mission(dump(tmp_path, data=dict.fromkeys(range(N), "x")))


@pytest.mark.realdata
def test_the_recorded_sector(recorded_data: Path) -> None:
    path = recorded_data / "ping360"
    if not path.is_dir():
        pytest.skip("the Ping360's beams are not among the recorded missions")
    read = open_mission(path)
    assert Counter(r.reason for r in read.rejections) == {"cut message": 1}
    series = beams_of(read)
    assert series.intensity.shape == (99, 1200)
    assert series.resolution_m * 1200 == pytest.approx(1.98)
