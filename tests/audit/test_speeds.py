"""How fast velocities go, and in which unit they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.audit.courses import Baselines, Velocity, velocity_sources
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.speeds import (
    implausible_findings,
    speed_blame,
    speed_findings,
    speed_pairs,
    stated_scales,
)
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.series import DvlSeries, GnssSeries, HeadingSeries, OdometrySeries

T = np.arange(0.0, 600.0)
HEADING = 0.02 * T
AHEAD = np.tile([1.0, 0.0, 0.0], (len(T), 1))
SIGMA = np.full(len(T), 0.05)


def noisy(values: np.ndarray, sigma: float) -> np.ndarray:
    return values + np.random.default_rng(4).normal(0.0, sigma, values.shape)


def dvl(scale: float) -> Sensor:
    every = np.ones(len(T), dtype=bool)
    v_d = scale * noisy(AHEAD, 0.05)
    series = DvlSeries(t=T, v_d=v_d, sigma=SIGMA, valid=every, bottom_lock=every)
    return Sensor("dvl", "dvl", series)


def wheels(scale: float, slip_sigma: float = 0.0) -> Sensor:
    series = OdometrySeries(
        t=T,
        v_b=scale * noisy(AHEAD[:, :2], 0.08),
        yaw_rate=0.0 * T,
        sigma_v=SIGMA,
        sigma_yaw_rate=SIGMA,
    )
    return Sensor("odometry", "odometry", series, noise={"slip_sigma": slip_sigma})


def ways() -> Baselines:
    v_n = np.column_stack([np.cos(HEADING), np.sin(HEADING), 0.0 * T])
    fixes = GnssSeries(t=T, p_n=noisy(np.cumsum(v_n, axis=0), 0.3), sigma=np.full((len(T), 3), 0.3))
    compass = HeadingSeries(t=T, heading=HEADING, sigma=SIGMA)
    k = np.arange(0, len(T), 20)
    return Baselines(Sensor("gnss", "gnss", fixes), compass, k[:-1], k[1:], fixes, 15.0)


def warned(*sensors: Sensor, where: Baselines | None = None) -> dict[str | None, Finding]:
    mission = Mission("m", {s.name: s for s in sensors})
    sources: tuple[Velocity, ...] = velocity_sources(mission)
    pairs = speed_pairs(sources, where, stated_scales(mission))
    return {f.sensor: f for f in speed_findings(mission, pairs, speed_blame(pairs))}


@pytest.mark.parametrize(
    ("unit", "factor"), [("knots", "0.5144444"), ("cm/s", "0.01"), ("km/h", "0.2777778")]
)
def test_a_dvl_in_another_unit_is_told_by_fixes(unit: str, factor: float) -> None:
    found = warned(dvl(1 / float(factor)), where=ways())
    assert found["dvl"].check == "velocity unit"
    assert unit in found["dvl"].message
    assert found["dvl"].fix == f"scale: {{vx: {factor}, vy: {factor}, vz: {factor}}}"


def test_half_the_speed_is_no_unit() -> None:
    found = warned(dvl(0.5), where=ways())
    assert found["dvl"].check == "velocity scale"
    assert found["dvl"].fix == "scale: {vx: 2, vy: 2, vz: 2}"


def test_who_contradicts_both_others_is_to_blame() -> None:
    assert [*warned(dvl(0.5), wheels(1.0), where=ways())] == ["dvl"]
    assert [*warned(dvl(1.0), wheels(2.0), where=ways())] == ["odometry"]


def test_of_two_without_fixes_either_may_be_wrong() -> None:
    found = warned(dvl(1.0), wheels(2.0))
    assert {*found} == {"dvl", "odometry"}
    assert "unless odometry" in found["dvl"].message


@pytest.mark.parametrize("scale", [0.85, 1.0, 1.2])
def test_calibration_is_no_mistake(scale: float) -> None:
    assert warned(dvl(scale), wheels(1.0), where=ways()) == {}


def test_wheels_that_slip_are_not_blamed() -> None:
    assert warned(dvl(1.0), wheels(1.35)) != {}
    assert warned(dvl(1.0), wheels(1.35, slip_sigma=0.1)) == {}


@pytest.mark.parametrize(("n_dropped", "expected"), [(700, 1), (300, 0)])
def test_speeds_that_no_vehicle_has_are_in_another_unit(n_dropped: int, expected: int) -> None:
    sensor = dvl(1.0)
    dropped = tuple(Rejection(0.0, "dvl", k, "implausible speed") for k in range(n_dropped))
    mission = replace(Mission("m", {"dvl": sensor}), rejections=dropped)
    assert len(list(implausible_findings(mission, sensor))) == expected


def test_speeds_that_the_fixes_go_at_too_are_plausible() -> None:
    """A boat at 6 m/s: what its card says of the fastest is wrong, not the unit."""
    sensor = dvl(1.0)
    fast = GnssSeries(
        t=T, p_n=np.column_stack([6.0 * T, 0.0 * T, 0.0 * T]), sigma=np.full((len(T), 3), 1.0)
    )
    dropped = tuple(Rejection(0.0, "dvl", k, "implausible speed") for k in range(9 * len(T)))
    sensors = {"dvl": sensor, "gnss": Sensor("gnss", "gnss", fast)}
    (finding,) = implausible_findings(Mission("m", sensors, rejections=dropped), sensor)
    assert finding.fix == "noise: {max_speed_m_s: 12}"
    assert "6.0 m/s" in finding.message
