"""Speeds through the water that are taken for speeds over ground."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.audit.courses import BOW, Baselines, Velocity
from gtsam_nav.audit.currents import Current, current_findings, currents
from gtsam_nav.audit.motion import turned
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import DvlSeries, GnssSeries, HeadingSeries, OdometrySeries

T = np.arange(0.0, 600.0)
HEADING = 0.9 * np.sin(0.02 * T) + 0.01 * T
SPEED_M_S = 1.2
AHEAD = np.tile([SPEED_M_S, 0.0], (len(T), 1))
EVERY = np.ones(len(T), dtype=bool)
SIGMA = np.full(len(T), 0.05)
CURRENT = np.array([-0.3, 0.2])


def noisy(values: Array, sigma: float) -> Array:
    return values + np.random.default_rng(4).normal(0.0, sigma, values.shape)


def ways(drift_n: Array, compass: Array = HEADING, step: int = 20) -> Baselines:
    """The vehicle goes ahead and drifts; a fix a second, a baseline every 20 s."""
    v_n = turned(AHEAD, HEADING) + drift_n
    p_n = np.column_stack([np.cumsum(v_n, axis=0), 0.0 * T])
    fixes = GnssSeries(t=T, p_n=noisy(p_n, 0.3), sigma=np.full((len(T), 3), 0.3))
    headings = HeadingSeries(t=T, heading=compass, sigma=SIGMA)
    k = np.arange(0, len(T), step)
    return Baselines(Sensor("gnss", "gnss", fixes), headings, k[:-1], k[1:], fixes, 15.0)


def log(v_b: Array = AHEAD, name: str = "odometry") -> Velocity:
    return Velocity(name, T, np.column_stack([noisy(v_b, 0.05), 0.0 * T]), np.eye(3))


def only(velocity: Velocity, where: Baselines) -> Current:
    (found,) = currents([velocity], where)
    return found


def test_a_current_is_found_with_its_speed_and_direction() -> None:
    found = only(log(), ways(CURRENT))
    assert found.misleads
    assert found.v_n == pytest.approx(CURRENT, abs=0.02)


@pytest.mark.parametrize(
    "v_b",
    [AHEAD, 1.2 * AHEAD, turned(AHEAD, np.full(len(T), 0.2)), AHEAD[:, ::-1], -AHEAD],
    ids=["as it is", "too fast", "misaligned", "exchanged", "reversed"],
)
def test_over_ground_there_is_none(v_b: Array) -> None:
    assert not only(log(v_b), ways(np.zeros(2))).misleads


def test_nor_is_a_slight_one_told() -> None:
    assert not only(log(), ways(0.2 * CURRENT)).misleads


def test_deviation_of_the_compass_is_no_current() -> None:
    # its mean along a full circle looks like one; as much again turns with twice the heading
    deviation = HEADING + np.radians(25.0) * np.sin(HEADING)
    found = only(log(), ways(np.zeros(2), deviation))
    assert np.hypot(*found.v_n) > 0.3
    assert not found.misleads


def test_fixes_that_went_astray_do_not_make_one() -> None:
    where = ways(np.zeros(2))
    where.fixes.p_n[200:215, 1] += 400.0
    assert not only(log(), where).misleads


def test_fixes_that_went_astray_do_not_hide_one() -> None:
    where = ways(CURRENT)
    where.fixes.p_n[200:215, 1] += 400.0
    assert only(log(), where).v_n == pytest.approx(CURRENT, abs=0.05)


def test_few_baselines_the_bow_and_no_fixes_tell_nothing() -> None:
    assert currents([log()], ways(CURRENT, step=100)) == ()
    assert currents([log(name=BOW)], ways(CURRENT)) == ()
    assert currents([log()], None) == ()


def test_the_sensor_is_named_and_what_to_do() -> None:
    where = ways(CURRENT)
    wheels = OdometrySeries(t=T, v_b=AHEAD, yaw_rate=0.0 * T, sigma_v=SIGMA, sigma_yaw_rate=SIGMA)
    sounder = DvlSeries(
        t=T, v_d=np.column_stack([AHEAD, 0.0 * T]), sigma=SIGMA, valid=EVERY, bottom_lock=EVERY
    )
    mission = Mission(
        "m",
        {
            "odometry": Sensor("odometry", "odometry", wheels),
            "dvl": Sensor("dvl", "dvl", sounder),
        },
    )
    found = currents([log(), log(name="dvl")], where)
    first, second = current_findings(mission, found)
    assert (first.check, first.sensor, first.severity) == (
        "speed through water",
        "odometry",
        "warning",
    )
    assert "0.36 m/s towards 14" in first.message
    assert first.fix == "type: dvl, through_water: true"
    assert second.sensor == "dvl"
    assert second.fix == "through_water: true"


def test_nothing_is_said_of_what_does_not_mislead() -> None:
    assert not list(current_findings(Mission("m", {}), currents([log()], ways(np.zeros(2)))))
