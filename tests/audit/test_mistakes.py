"""Each classic mistake in a mission of one seed, and what its fix makes of it.

The small twin of ``python -m benchmarks.audit``.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import gtsam_nav as gn
from benchmarks.audit import names, warnings
from benchmarks.mistakes import MISTAKES, SILENT, Mistake
from gtsam_nav.audit import audit
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import GnssSeries, HeadingSeries, ImuSeries
from gtsam_nav.writers.mission_folder import MISSION_FILE, write_mission

SEED = 2
BY_NAME = {mistake.name: mistake for mistake in MISTAKES}
QUICK = ("gyro in deg/s, no DVL", "GNSS velocity ENU")


def look(mistake: Mistake) -> None:
    found = list(warnings(audit(mistake.mission(SEED))))
    assert any(names(finding, mistake) for finding in found), [f.text for f in found]


@pytest.mark.parametrize("name", QUICK)
def test_quick_mistakes_are_found(name: str) -> None:
    look(BY_NAME[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in BY_NAME if name not in QUICK])
def test_mistakes_are_found(name: str) -> None:
    look(BY_NAME[name])


def test_a_clean_mission_is_not_warned_of() -> None:
    assert list(warnings(audit(gn.simulate("laps", SEED)))) == []


@pytest.mark.slow
def test_clean_missions_are_not_warned_of() -> None:
    for seed in (SEED, SEED + 1):
        assert list(warnings(audit(gn.simulate("marina", seed, settings=SILENT)))) == []


def circling(t: Array) -> Array:
    return 1.2 + 0.9 * np.sin(0.05 * t) + 0.4 * np.sin(0.3 * t)


def outing(*exchanged: str) -> Mission:
    """Fixes with velocities, a compass and a gyro, on a way of curves that never turns north."""
    t, rng = np.arange(0.0, 400.0, 0.1), np.random.default_rng(5)
    heading = circling(t)
    rate = np.outer(np.gradient(heading, t), [0.0, 0.0, 1.0])
    v_n = 1.5 * np.column_stack([np.cos(heading), np.sin(heading), 0.0 * t])
    p_n = 0.1 * np.cumsum(v_n, axis=0)
    columns = {"p_n": p_n[::10], "v_n": v_n[::10]}
    noisy = {
        name: values[:, [1, 0, 2]] if name in exchanged else values
        for name, values in columns.items()
    }
    noisy["p_n"] = noisy["p_n"] + rng.normal(0.0, 0.2, noisy["p_n"].shape)
    imu = ImuSeries(
        t=t,
        gyro_i=rate + rng.normal(0.0, 1e-3, rate.shape),
        accel_i=np.tile([0.0, 0.0, -9.8], (len(t), 1)) + rng.normal(0.0, 1e-2, rate.shape),
    )
    compass = HeadingSeries(t=t, heading=heading, sigma=np.full(len(t), 0.01))
    gnss = GnssSeries(t=t[::10], sigma=np.full(noisy["p_n"].shape, 0.2), **noisy)
    listed = (Sensor("imu", "imu", imu), Sensor("heading", "heading", compass))
    return Mission("outing", {s.name: s for s in (*listed, Sensor("gnss", "gnss", gnss))})


def test_sound_velocities_are_not_accused_of_mirrored_fixes() -> None:
    assert [f.check for f in warnings(audit(outing()))] == []
    (mirrored,) = warnings(audit(outing("p_n")))
    assert (mirrored.check, mirrored.sensor) == ("fixes mirrored", "gnss")
    assert "columns: {lat_deg: lon_deg, lon_deg: lat_deg}" in mirrored.fix
    assert [f.check for f in warnings(audit(outing("v_n")))] == ["gnss velocity"]


def test_the_course_waits_for_headings_in_radians_to_be_mended() -> None:
    mission = outing()
    compass = mission.sensors["heading"]
    radians = replace(compass.series, heading=np.radians(circling(compass.series.t)))
    spoilt = mission.with_sensor(replace(compass, series=radians))
    assert [f.check for f in warnings(audit(spoilt))] == ["heading unit"]


def card_lines(fix: str) -> dict[str, Any]:
    """The keys of a card that a fix states, its remarks left out."""
    text = fix.split(", or ")[0].split(" (")[0]
    lines = yaml.safe_load("{" + text + "}")
    assert isinstance(lines, dict)
    return lines


MENDED = (
    *("DVL upside down", "bearings in radians", "ranges in feet"),
    *("gyro in deg/s", "accelerometer in g", "gravity sign", "IMU axes FLU", "heading ENU"),
    *("heading in radians", "DVL velocities reversed", "DVL misaligned by 10 deg"),
    *("GNSS clock 2 s late", "lever arm sign", "stale headings", "mirrored sonar"),
    *("DVL in knots", "DVL stamps in ms", "odometry in deg/s"),
)
"""One for each kind of line."""


@pytest.mark.slow
@pytest.mark.parametrize("name", MENDED)
def test_the_fix_mends_it(name: str, tmp_path: Path) -> None:
    mistake = BY_NAME[name]
    spoilt = mistake.mission(SEED)
    imu = spoilt.sensors["imu"]
    slower = replace(imu, series=imu.series.select(slice(None, None, 4)))
    write_mission(spoilt.with_sensor(slower).without("reference"), tmp_path / "mission")
    before = gn.open_mission(tmp_path / "mission")
    (finding,) = [f for f in warnings(audit(before)) if names(f, mistake)]
    card = tmp_path / "mission" / MISSION_FILE
    tree = yaml.safe_load(card.read_text())
    tree["sensors"][mistake.sensor] |= card_lines(finding.fix)
    card.write_text(yaml.safe_dump(tree))
    left = [f.text for f in warnings(audit(gn.open_mission(tmp_path / "mission")))]
    assert left == []
