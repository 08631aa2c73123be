"""Tables that plainly mean something else than they say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from missions import make_folder

from gtsam_nav.readers import open_mission
from gtsam_nav.readers._mended_table import DAY_S, days_passed

STAMPS = np.arange(86_390.0, 86_410.0)


def depths(stamps: np.ndarray) -> str:
    return "t,depth_m\n" + "".join(f"{t},{k}\n" for k, t in enumerate(stamps))


def test_seconds_of_the_day_go_on_past_midnight(tmp_path: Path) -> None:
    files = {"a.csv": depths(STAMPS % DAY_S), "b.csv": depths(STAMPS[:5])}
    sensors = {name: {"type": "depth", "file": f"{name}.csv"} for name in "ab"}
    mission = open_mission(make_folder(tmp_path, files, sensors))
    np.testing.assert_allclose(mission.sensors["a"].series.t, STAMPS - STAMPS[0])
    assert mission.rejections == ()
    (warning,) = [w for w in mission.warnings if "midnight" in w]
    assert "seconds of the day are the stamps of 'a', and they pass midnight" in warning


def test_a_cut_line_of_scaled_stamps_is_past_midnight_too(tmp_path: Path) -> None:
    text = depths((1000 * (STAMPS % DAY_S)).astype(int)) + "10000,x1"
    entry = {"type": "depth", "file": "a.csv", "scale": {"t": 0.001}}
    mission = open_mission(make_folder(tmp_path, {"a.csv": text}, {"a": entry}))
    np.testing.assert_allclose(mission.sensors["a"].series.t, STAMPS - STAMPS[0])
    assert [(r.t, r.reason) for r in mission.rejections] == [(20.0, "truncated line")]


def test_sensors_on_either_side_of_midnight_are_of_one_night(tmp_path: Path) -> None:
    t = np.arange(0.0, 120.0)
    night = (86_340.0 + t) % 86_400.0
    rows = [f"{night[k]:.1f},1.0,0.1" for k in range(len(t))]
    for name, chosen in (("x", rows), ("late", rows[80:])):
        text = "\n".join(["t,depth_m,sigma", *chosen])
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    beams = np.zeros((len(t), 4), dtype=np.uint8)
    np.savez(tmp_path / "beams.npz", t=night, angle=0.1 * t, intensity=beams, resolution_m=0.1)
    (tmp_path / "mission.yaml").write_text(
        "sensors: {x: {type: depth, file: x.csv}, late: {type: depth, file: late.csv},"
        " beams: {file: beams.npz}}",
        encoding="utf-8",
    )
    mission = open_mission(tmp_path)
    begins = {name: float(s.series.t[0]) for name, s in mission.sensors.items()}
    assert begins == {"x": 0.0, "late": 80.0, "beams": 0.0}
    assert [len(s.series) for s in mission.sensors.values()] == [120, 40, 120]
    passing, late = [warning for warning in mission.warnings if "midnight" in warning]
    assert "'x', 'beams'" in passing
    assert "the stamps of 'late' begin after" in late


@pytest.mark.parametrize(("first_s", "duration_s"), [(0.0, 20.0), (0.4, 20.0), (5.0, 200.0)])
def test_a_log_counted_from_power_up_is_of_no_day(
    tmp_path: Path, first_s: float, duration_s: float
) -> None:
    up = np.arange(first_s, first_s + duration_s, 0.5)
    night = np.arange(86_340.0, 86_460.0) % DAY_S
    files = {"a.csv": depths(night), "b.csv": depths(up), "c.csv": depths(night)}
    sensors = {name: {"type": "depth", "file": f"{name}.csv"} for name in "abc"}
    mission = open_mission(make_folder(tmp_path, files, sensors))
    assert "b" not in mission.sensors
    assert any("'b' is left out" in w and "time_offset_s" in w for w in mission.warnings)
    assert not any("next day's" in w and "'b'" in w for w in mission.warnings)


def test_a_last_line_that_was_cut_off_is_of_its_day(tmp_path: Path) -> None:
    files = {"a.csv": depths(STAMPS % DAY_S) + "10.0,"}
    mission = open_mission(make_folder(tmp_path, files, {"a": {"type": "depth", "file": "a.csv"}}))
    (cut,) = mission.rejections
    assert cut.t == pytest.approx(20.0)


def test_two_midnights_and_missing_stamps() -> None:
    t = np.arange(86_000.0, 86_000.0 + 2 * DAY_S, 100.0)
    read = t % DAY_S
    read[[3, 4, 5]] = np.nan
    known = np.isfinite(read)
    np.testing.assert_array_equal(days_passed(read)[known], (t // DAY_S)[known])


def test_a_stamp_that_comes_late_is_still_the_day_s_before() -> None:
    t = np.array([86_399.9, 0.1, 86_399.95, np.nan, 0.2, 0.3])
    np.testing.assert_array_equal(days_passed(t), [0, 1, 0, 0, 1, 1])


@pytest.mark.parametrize(
    "t",
    [
        np.empty(0),
        np.array([np.nan]),
        STAMPS,
        STAMPS[::-1] % DAY_S,
        np.append(STAMPS % DAY_S, -1.0),  # no seconds of the day
        np.array([86_399.0, 0.0, 86_400.5]),
        np.array([0.0, 50_000.0, 1.0]),  # falls back from noon
        np.array([86_399.0, 40_000.0]),
        np.array([86_399.0, 1.0, 86_399.5, 43_000.0, 1.0]),
    ],
)
def test_nothing_else_is_taken_for_seconds_of_the_day(t: np.ndarray) -> None:
    assert not np.any(days_passed(t))


@pytest.mark.parametrize(("start_utc", "warned"), [(1.75e9, True), (0, False), (None, False)])
def test_posix_stamps_that_are_counted_from_a_start_of_today_are_doubted(
    tmp_path: Path, start_utc: float | None, warned: bool
) -> None:
    description = {} if start_utc is None else {"start_utc": start_utc}
    folder = make_folder(
        tmp_path,
        {"a.csv": depths(1.75e9 + STAMPS)},
        {"depth": {"file": "a.csv"}},
        **description,
    )
    told = any(
        "where they are POSIX seconds themselves" in w for w in open_mission(folder).warnings
    )
    assert told == warned
