"""A Water Linked DVL's JSON: invented reports with every fault, and a recorded dive."""

from __future__ import annotations

import gzip
import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gtsam_nav.errors import DataError
from gtsam_nav.mission import Mission
from gtsam_nav.readers import open_mission
from gtsam_nav.series import DvlSeries


def report(time_ms: float = 100.0, vx: float = 0.1, **others: Any) -> str:
    given = {"vx": vx, "vy": 0.2, "vz": 0.3, "fom": 0.01, "altitude": 2.0, "velocity_valid": True}
    return json.dumps({"time": time_ms, **given, **others})


def log(folder: Path, *lines: str, end: str = "\n") -> Mission:
    (folder / "log.txt").write_text("\n".join(lines) + end)
    return open_mission(folder / "log.txt")


def dvl_of(mission: Mission) -> DvlSeries:
    series = mission.sensors["dvl"].series
    assert isinstance(series, DvlSeries)
    return series


def test_stamps_are_sums_of_the_milliseconds_between_reports(tmp_path: Path) -> None:
    read = log(tmp_path, report(500), report(100, 0.2), report(120, 0.3))
    series = dvl_of(read)
    np.testing.assert_allclose(series.t, [0.0, 0.1, 0.22])
    np.testing.assert_allclose(series.v_d, [[0.1, 0.2, 0.3], [0.2, 0.2, 0.3], [0.3, 0.2, 0.3]])
    np.testing.assert_allclose(series.sigma, 0.01)
    assert read.start_utc is None


def test_a_repeated_report_takes_no_time(tmp_path: Path) -> None:
    read = log(tmp_path, report(100), report(100), report(100, 0.2))
    np.testing.assert_allclose(dvl_of(read).t, [0.0, 0.1])
    assert Counter(r.reason for r in read.rejections) == {"repeated report": 1}


def test_a_damaged_report_takes_its_time(tmp_path: Path) -> None:
    """Cut off at its end, it still tells its time; at its beginning, it takes as long as most."""
    cut, headless = report(150, 0.4)[:40], report(150, 0.5, altitude=2.5)[30:]
    lines = [report(100, 0.1 * k) for k in range(3)]
    read = log(tmp_path, *lines, cut, report(100, 0.6), headless, "noise", report(100, 0.7))
    np.testing.assert_allclose(dvl_of(read).t, [0.0, 0.1, 0.2, 0.45, 0.65])
    np.testing.assert_allclose([r.t for r in read.rejections], [0.35, 0.55, 0.55])


@pytest.mark.parametrize("damaged", [0, 1])
@pytest.mark.parametrize("kept", [slice(None, -9), slice(9, None)])
def test_a_damaged_copy_takes_no_time(tmp_path: Path, damaged: int, kept: slice) -> None:
    copies = [report(100, 0.2)] * 2
    copies[damaged] = copies[damaged][kept]
    read = log(tmp_path, report(100), *copies, report(100, 0.3))
    np.testing.assert_allclose(dvl_of(read).t, [0.0, 0.1, 0.2])


def test_invalid_velocities_stay_and_unknown_altitudes_are_none(tmp_path: Path) -> None:
    lost = report(100, velocity_valid=False, fom=-1, altitude=-1)
    series = dvl_of(log(tmp_path, report(), lost))
    np.testing.assert_array_equal(series.valid, [True, False])
    np.testing.assert_array_equal(series.altitude_m, [2.0, 0.0])


def test_the_time_of_validity_counts_where_it_is_stated(tmp_path: Path) -> None:
    times = [1_700_000_000_000_000, 1_700_000_000_250_000]
    read = log(tmp_path, *(report(100, 0.1 * k, time_of_validity=t) for k, t in enumerate(times)))
    np.testing.assert_allclose(dvl_of(read).t, [0.0, 0.25], atol=1e-6)
    assert read.start_utc == pytest.approx(1_700_000_000)


def test_figures_of_a_card_serve_where_the_log_states_none(tmp_path: Path) -> None:
    card = tmp_path / "card.yaml"
    noise = "{sigma_m_s: 0.2, max_speed_m_s: 0.5}"
    card.write_text(f"mission: {{sensors: {{dvl: {{noise: {noise}}}}}}}")
    log(tmp_path, report(), report(100, 0.2, fom=-1), report(100, 0.9))
    read = open_mission(tmp_path / "log.txt", card=card)
    np.testing.assert_allclose(dvl_of(read).sigma, [0.01, 0.2])
    assert Counter(r.reason for r in read.rejections) == {"implausible speed": 1}


def test_everything_that_is_dropped_is_counted(tmp_path: Path) -> None:
    read = log(
        tmp_path,
        report(),
        "not JSON",
        '{"vx": 1}',
        '{"type": "position_local", "x": 1}',
        report(100, float("nan")),
        report(100, 99.0),
        report(100, 0.4)[:30],
        end="",
    )
    assert Counter(r.reason for r in read.rejections) == {
        "malformed report": 2,
        "non-finite v_d": 1,
        "implausible speed": 1,
        "truncated line": 1,
    }
    assert len(dvl_of(read)) == 1


def test_a_dive_without_lock(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no report holds a valid velocity"):
        log(tmp_path, report(velocity_valid=False))


@pytest.mark.realdata
def test_the_recorded_dive(recorded_data: Path) -> None:
    path = recorded_data / "dvl_a50" / "out20210528.txt.gz"
    if not path.is_file():
        pytest.skip("the A50's reports are not among the recorded missions")
    lines = gzip.decompress(path.read_bytes()).decode().splitlines()
    repeated = sum(a == b for a, b in zip(lines[1:], lines[:-1], strict=True))
    read = open_mission(path)
    assert Counter(r.reason for r in read.rejections) == {"repeated report": repeated}
    assert len(dvl_of(read)) == len(lines) - repeated
