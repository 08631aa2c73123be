"""Constant timing errors: their effect on the residuals, and finding them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gtsam
import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.config import Config
from gtsam_nav.frames import Array
from gtsam_nav.graph.clocks import find_clocks
from gtsam_nav.graph.factors import X, gnss, gnss_velocity, heading, orientation
from gtsam_nav.graph.measurements.gnss import VELOCITY_OUTLIER
from gtsam_nav.graph.outset import start_and_motion
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.timing import TimingError, timing_effect, timing_errors
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.motion import VehicleMotion
from gtsam_nav.series import GnssSeries
from gtsam_nav.simulation.settings import SimulationSettings
from gtsam_nav.solution import ClockOffset, Solution, no_progress

KEYFRAMES = np.array([0.0, 0.5, 1.0, 1.5, 2.0])
IMU = TimingError("imu", "imu", "time_offset", 0.5)
FIXES = TimingError("gnss", "gnss", "time_offset", 0.5)
LAG = TimingError("gnss", "gnss", "velocity_lag", 0.1)


def state(t: float) -> Any:
    """A vehicle that turns, speeds up and rolls."""
    R_nb = gtsam.Rot3.Ypr(0.3 * t, 0.1 * t, 0.05)
    v_n = np.array([2.0 + 0.5 * t, 1.0 - 0.3 * t, 0.1])
    p_n = np.array([2.0 * t + 0.25 * t**2, t - 0.15 * t**2, 0.1 * t])
    return gtsam.NavState(R_nb, p_n, v_n)


def values_at(shift_s: float) -> Any:
    values = gtsam.Values()
    for k, t in enumerate(KEYFRAMES.tolist()):
        values.insert(X(k), state(t + shift_s))
    return values


def problem() -> Problem:
    n = len(KEYFRAMES)
    motion = VehicleMotion(
        t=KEYFRAMES,
        p_n=np.zeros((n, 3)),
        rpy=np.zeros((n, 3)),
        v_b=np.zeros((n, 3)),
        sigma_v=np.ones(n),
        position_variance=np.zeros(n),
        position_variance_m2_s=1.0,
        yaw_variance_rad2_s=1.0,
        gyro_bias_b=np.zeros(3),
        rejections=(),
    )
    start: Any = None
    return Problem(KEYFRAMES, start, motion, uses_imu=True, has_compass=False)


def effect_of(error: TimingError, sensor: str, factor: Any) -> Array:
    made = problem()
    made.add(2, sensor, factor)
    return timing_effect(made, (error,), np.zeros(1), (), values_at(0.0)).effect[:, 0]


R_2 = state(1.0).attitude().matrix()
FACTORS = {
    "position": gnss(X(2), np.array([1.0, 2.0, 0.3]), np.array([0.5, 0.1, -1.0]), np.full(3, 0.5)),
    "velocity": gnss_velocity(
        int(X(2)), state(1.0), np.array([2.0, 1.0, 0.0]), np.zeros(3), np.full(3, 0.2)
    ),
    "heading": heading(None, X(2), 0.35, R_2, 0.02),
    "displacement": gtsam.BetweenFactorNavState(
        X(1), X(2), gtsam.NavState(), gtsam.noiseModel.Isotropic.Sigma(9, 0.3)
    ),
}


@pytest.mark.parametrize("name", FACTORS)
def test_the_effect_is_how_the_residual_changes_as_the_vehicle_moves_on(name: str) -> None:
    """Fixes stamped late are compared with where the vehicle is later."""
    factor, h = FACTORS[name], 1e-4
    ahead, back = (factor.whitenedError(values_at(sign * h)) for sign in (1.0, -1.0))
    np.testing.assert_allclose(
        effect_of(FIXES, "gnss", factor), (ahead - back) / (2 * h), rtol=0.02, atol=0.02
    )


def test_an_imus_offset_is_that_of_all_others_backwards() -> None:
    factor = FACTORS["position"]
    others = effect_of(FIXES, "gnss", factor)
    np.testing.assert_allclose(effect_of(IMU, "gnss", factor), -others)
    assert not np.any(effect_of(IMU, "constraints", factor))
    assert not np.any(effect_of(FIXES, "depth", factor))


def test_a_lag_is_of_the_velocities_alone() -> None:
    assert LAG.shares(problem(), "gnss", VELOCITY_OUTLIER) == (-1, -1)
    assert LAG.shares(problem(), "gnss", "") == (0, 0)
    assert LAG.shares(problem(), "other", VELOCITY_OUTLIER) == (0, 0)


def test_an_offset_is_of_no_other_sensor_of_its_type() -> None:
    """Even where that one bears the type's name."""
    second = TimingError("gnss2", "gnss", "time_offset", 0.5)
    assert second.shares(problem(), "gnss2", "") == (1, 1)
    assert second.shares(problem(), "gnss", "") == (0, 0)


@pytest.mark.parametrize(
    ("kind", "label"), [("dvl", "velocity"), ("odometry", "velocity"), ("attitude", "attitude")]
)
def test_an_offset_is_of_the_factors_that_are_called_by_its_type(kind: str, label: str) -> None:
    error = TimingError("port", kind, "time_offset", 0.5)
    assert error.shares(problem(), label, "") == (1, 1)
    assert error.shares(problem(), "depth", "") == (0, 0)


def test_an_orientation_is_put_together_of_two_sensors() -> None:
    """Its yaw keeps the compass's time, roll and pitch the other's; together they move on."""
    measured = state(0.99).attitude().matrix()
    factor = orientation(None, X(2), measured, np.full(3, 0.01))
    parts = [
        effect_of(TimingError(kind, kind, "time_offset", 0.5), "heading", factor)
        for kind in ("heading", "attitude")
    ]
    np.testing.assert_allclose(sum(parts), -effect_of(IMU, "heading", factor))
    turning = gtsam.Values()
    for k in range(len(KEYFRAMES)):
        yaw = gtsam.Rot3.Yaw(0.3e-4)
        before = state(float(KEYFRAMES[k]))
        R_nb = yaw.compose(before.attitude())
        turning.insert(X(k), gtsam.NavState(R_nb, before.position(), before.velocity()))
    change = factor.whitenedError(turning) - factor.whitenedError(values_at(0.0))
    np.testing.assert_allclose(parts[0], change / 1e-4, rtol=0.02, atol=0.05)


def doubted(mission: Mission, name: str, offset_s: float, sigma_s: float = 0.5) -> Mission:
    """A mission whose sensor's stamps are off, and which asks to find out by how much."""
    sensor = mission.sensors[name]
    return mission.with_sensor(
        replace(sensor, series=sensor.series.shift(offset_s), time_offset_sigma_s=sigma_s)
    )


def found(solution: Solution, sensor: str) -> ClockOffset:
    return next(o for o in solution.clock_offsets if o.sensor == sensor)


@pytest.fixture(scope="module")
def laps() -> Mission:
    return gn.simulate("laps", seed=3).crop(0.0, 100.0)


def test_trusted_clocks_cost_nothing(laps: Mission) -> None:
    assert timing_errors(laps) == ()
    start, motion = start_and_motion(laps, Config())
    clocks = find_clocks(laps, start, motion, np.arange(3.0), Config(), no_progress)
    assert clocks.corrected(laps) is laps


@pytest.mark.slow
@pytest.mark.parametrize("sensor", ["imu", "gnss"])
def test_an_offset_is_found_with_an_honest_sigma(laps: Mission, sensor: str) -> None:
    solution = gn.estimate(doubted(laps, sensor, -0.3), "graph")
    offset = found(solution, sensor)
    assert offset.sigma_s < 0.2  # fixes of 1.2 m at 2.5 m/s
    assert abs(offset.offset_s - 0.3) < 3.0 * offset.sigma_s
    assert offset.observed
    assert not solution.warnings
    assert solution.slow_states is not None
    values, sigmas = solution.slow_states.columns[f"{sensor}_time_offset_s"]
    assert set(values) == {offset.offset_s}
    assert set(sigmas) == {offset.sigma_s}
    assert gn.evaluate(solution).clock_offsets == solution.clock_offsets


def test_the_lag_of_velocities_is_found(laps: Mission) -> None:
    gnss = laps.sensors["gnss"]
    series = gnss.series
    assert isinstance(series, GnssSeries)
    assert series.v_n is not None
    late = np.stack([np.interp(series.t - 0.4, series.t, v) for v in series.v_n.T], axis=1)
    noise = {**gnss.noise, "velocity_lag_sigma_s": 0.5}
    lagging = laps.with_sensor(replace(gnss, series=replace(series, v_n=late), noise=noise))
    offset = found(gn.estimate(lagging, "graph"), "gnss")
    assert offset.quantity == "velocity_lag"
    assert abs(offset.offset_s - 0.4) < 3.0 * offset.sigma_s < 0.5


def test_a_clock_that_nothing_tells_keeps_its_sigma_and_is_named(laps: Mission) -> None:
    """At rest every moment is like the other."""
    resting = gn.estimate(doubted(laps.crop(0.0, 15.0), "gnss", 0.0, sigma_s=0.1), "graph")
    offset = found(resting, "gnss")
    assert not offset.observed
    assert offset.sigma_s == pytest.approx(0.1, rel=0.1)
    assert any("time offset of sensor 'gnss' cannot be told" in w for w in resting.warnings)


def test_a_doubted_clock_of_a_sensor_that_is_not_used_is_named_too(laps: Mission) -> None:
    config = gn.load_config(None, ["gnss.use=none"])
    solution = gn.estimate(doubted(laps.crop(0.0, 15.0), "gnss", 0.0, sigma_s=0.1), "graph", config)
    offset = found(solution, "gnss")
    assert (offset.offset_s, offset.sigma_s, offset.observed) == (0.0, 0.1, False)
    assert any("time offset of sensor 'gnss' cannot be told" in w for w in solution.warnings)


@pytest.mark.parametrize("spare", ["odometry", "depth2", "dvl2", "compass2"])
def test_a_doubted_clock_of_a_sensor_that_gives_way_is_undetermined(spare: str) -> None:
    """The sensor in its place, which is late, may bear the type's name."""
    mission = gn.simulate("marina", seed=4, duration_s=20.0).without("sonar", "landmarks")
    for kind, twin in (("depth", "depth2"), ("dvl", "dvl2"), ("heading", "compass2")):
        if twin == spare:
            sensor = mission.sensors[kind]
            late = replace(sensor, series=sensor.series.shift(0.4))
            mission = mission.with_sensor(late).with_sensor(replace(sensor, name=twin))
    solution = gn.estimate(doubted(mission, spare, 0.4, sigma_s=0.5), "graph")
    offset = found(solution, spare)
    assert (offset.offset_s, offset.sigma_s, offset.observed) == (0.0, 0.5, False)
    assert any(f"time offset of sensor '{spare}' cannot be told" in w for w in solution.warnings)


def test_an_offset_far_beyond_its_stated_sigma_is_named() -> None:
    expected = ClockOffset("gnss", "time_offset", 0.3, 0.01, 0.1)
    assert not expected.warnings
    (said,) = replace(expected, offset_s=-0.5).warnings
    assert "time offset of sensor 'gnss' was found to be off by -0.5 s" in said


@pytest.mark.parametrize(
    ("offset_s", "word"), [(0.0, None), (1.0, "late"), (-1.0, "early")], ids=str
)
def test_a_trusted_clock_that_is_off_is_suspected(
    laps: Mission, offset_s: float, word: str | None
) -> None:
    shifted = gn.estimate(laps, "graph", faults=(f"clock:gnss={offset_s}",))
    said = [w for w in shifted.warnings if w.startswith("'gnss' seems to be")]
    assert len(said) == (word is not None)
    if word is not None:
        assert f" s {word} (sigma " in said[0]
        assert float(said[0].split()[4]) == pytest.approx(1.0, abs=0.5)


def test_a_compass_that_is_off_is_named_in_place_of_the_clock(laps: Mission) -> None:
    """Bent to a compass that is trusted, the way would look like late fixes."""
    turned = gn.estimate(laps, "graph", faults=("heading:bias=40",))
    (said,) = [w for w in turned.warnings if "seems to be" in w]
    assert said.startswith("'heading' seems to be off by ")


def test_two_clocks_that_are_both_doubted_are_told_apart_only_as_far_as_trusted(
    laps: Mission,
) -> None:
    """Only their difference is measured; each keeps its share of the prior."""
    both = doubted(doubted(laps, "imu", 0.0), "gnss", -0.2)
    both = both.without("heading")
    offsets = gn.estimate(both, "graph").clock_offsets
    difference = offsets[1].offset_s - offsets[0].offset_s
    if offsets[0].sensor != "imu":
        difference = -difference
    assert difference == pytest.approx(0.2, abs=0.3)
    for offset in offsets:
        assert offset.sigma_s == pytest.approx(0.5 / np.sqrt(2.0), rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(("sensor", "offset_s"), [("gnss", 0.5), ("dvl", -0.4), ("heading", 0.3)])
def test_offsets_beside_a_dvl(sensor: str, offset_s: float) -> None:
    settings = SimulationSettings.matched()
    mission = gn.simulate("marina", seed=4, duration_s=240.0, settings=settings)
    config = gn.load_config(None, ["gnss.use=all", "sonar.use=false"])
    solution = gn.estimate(doubted(mission, sensor, offset_s), "graph", config)
    offset = found(solution, sensor)
    assert offset.observed
    assert abs(offset.offset_s + offset_s) < 3.0 * offset.sigma_s
