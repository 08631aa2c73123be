"""Dead reckoning of whole missions: drift, lost bottom lock, gate, and what is recorded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.config import Config, load_config
from gtsam_nav.errors import DataError, EstimationError
from gtsam_nav.frames import Array, rotation_from_rpy, wrap_angle
from gtsam_nav.mission import InitialState, Mission, Rejection, Sensor
from gtsam_nav.sensors.noise import HeadingNoise
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.series import (
    AttitudeSeries,
    BoolArray,
    DepthSeries,
    DvlSeries,
    GnssSeries,
    HeadingSeries,
    OdometrySeries,
    ReferenceSeries,
    Series,
)
from gtsam_nav.simulation import SimulationSettings, simulate
from gtsam_nav.simulation.settings import (
    AttitudeSimulation,
    DvlSimulation,
    GnssSimulation,
    HeadingSimulation,
)
from gtsam_nav.solution import Solution

DURATION_S, HEADING, SPEED_M_S = 60.0, 0.7, 0.5
COURSE_N = np.array([np.cos(HEADING), np.sin(HEADING), 0.0])
T_DVL = np.arange(0.0, DURATION_S, 0.2)

IDEAL = SimulationSettings(
    dvl=DvlSimulation(
        sigma_m_s=1e-3, scale_sigma=0.0, misalignment_sigma_deg=0.0, dropouts_per_min=0.0
    ),
    heading=HeadingSimulation(sigma_deg=0.05, bias_sigma_deg=0.0, wall_peak_deg=0.0),
    attitude=AttitudeSimulation(sigma_deg=0.01),
    gnss=GnssSimulation(sigma_white_m=0.01, sigma_drift_m=0.0, outlier_share=0.0),
)


def full(n: int, value: float) -> Array:
    return np.full(n, value)


def straight(
    bottom: BoolArray | None = None, water: BoolArray | None = None, current_m_s: float = 0.0
) -> Mission:
    """A straight course: water lock reads the speed less the current."""
    n = len(T_DVL)
    bottom = np.ones(n, dtype=bool) if bottom is None else bottom
    water = np.zeros(n, dtype=bool) if water is None else water
    v_d = np.zeros((n, 3))
    v_d[:, 0] = SPEED_M_S - current_m_s * water
    t = np.arange(0.0, DURATION_S, 0.1)
    series: dict[str, Series] = {
        "dvl": DvlSeries(
            t=T_DVL, v_d=v_d, sigma=full(n, 0.02), valid=bottom | water, bottom_lock=bottom
        ),
        "heading": HeadingSeries(t=t, heading=full(len(t), HEADING), sigma=full(len(t), 0.005)),
        "depth": DepthSeries(t=T_DVL, depth_m=full(n, 2.0), sigma=full(n, 0.05)),
    }
    return Mission("straight", {name: Sensor(name, name, one) for name, one in series.items()})


def within(start_s: float, stop_s: float) -> BoolArray:
    """Which DVL samples lie in a span."""
    t = T_DVL
    return (t >= start_s) & (t < stop_s)


def along_course(solution: Solution) -> float:
    """How far the end lies along the course, m."""
    return float(solution.trajectory.p_n[-1] @ COURSE_N)


def of_reason(solution: Solution, reason: str) -> list[Rejection]:
    return [r for r in solution.rejections if r.reason == reason]


def test_a_straight_course_is_followed() -> None:
    solution = gn.estimate(straight(), "dr")
    trajectory = solution.trajectory
    later = trajectory.t > 5.0
    np.testing.assert_allclose(
        trajectory.p_n[later, :2], trajectory.t[later, None] * SPEED_M_S * COURSE_N[:2], atol=0.1
    )
    np.testing.assert_allclose(trajectory.p_n[:, 2], 2.0, atol=1e-6)
    assert trajectory.v_n is not None
    np.testing.assert_allclose(
        trajectory.v_n[later], np.tile(SPEED_M_S * COURSE_N, (later.sum(), 1)), atol=1e-3
    )
    np.testing.assert_allclose(trajectory.rpy[:, 2], HEADING, atol=1e-9)
    assert solution.rejections == ()
    assert not solution.georeferenced


def test_a_vehicle_already_under_way_is_not_gated_out() -> None:
    slow = straight()
    dvl = slow.sensors["dvl"]
    assert isinstance(dvl.series, DvlSeries)
    fast = replace(dvl, series=replace(dvl.series, v_d=dvl.series.v_d * 12.0))
    solution = gn.estimate(slow.with_sensor(fast), "dr")
    distance = float(np.linalg.norm(solution.trajectory.p_n[-1, :2]))
    assert distance == pytest.approx(12.0 * SPEED_M_S * DURATION_S, rel=0.02)
    assert solution.rejections == ()


def test_the_trajectory_covers_the_mission_at_its_rate() -> None:
    for rate_hz in (10.0, 25.0):
        config = load_config(None, [f"motion.rate_hz={rate_hz}"])
        mission = straight().crop(7.0, 50.0)
        t = gn.estimate(mission, "dr", config).trajectory.t
        start_s, stop_s = mission.span_s
        assert t[0] == start_s
        assert t[-1] == stop_s
        np.testing.assert_allclose(np.diff(t[:-1]), 1 / rate_hz, rtol=1e-9)
        assert t[-1] - t[-2] <= 1 / rate_hz + 1e-9


def test_the_uncertainty_grows_across_the_course_and_along_it() -> None:
    trajectory = gn.estimate(straight(), "dr").trajectory
    cov = trajectory.cov_pose_n
    assert cov is not None
    assert np.linalg.eigvalsh(cov).min() > 0
    np.testing.assert_allclose(cov, np.swapaxes(cov, 1, 2), atol=1e-12)
    across_n = np.array([-np.sin(HEADING), np.cos(HEADING), 0.0])
    for axis in (COURSE_N, across_n):
        variance = np.einsum("i,nij,j->n", axis, cov[:, :3, :3], axis)
        assert np.all(np.diff(variance[20::50]) > 0)  # an update shrinks it for a moment
    assert trajectory.sigma_v_n is not None
    assert trajectory.sigma_v_n[-1, 2] < 0.03  # about that of one reading
    # the compass is wrong by what its card's defaults say
    compass = HeadingNoise()
    turned = SPEED_M_S * np.radians(np.hypot(compass.bias_sigma_deg, compass.disturbance_sigma_deg))
    sigma_across = np.linalg.norm(trajectory.sigma_v_n[-1, :2])
    assert turned < sigma_across < 1.2 * turned


@pytest.mark.parametrize("water", [False, True], ids=["no lock", "water lock"])
def test_a_short_gap_of_bottom_lock_is_bridged(water: bool) -> None:
    gap = within(20.0, 28.0)
    mission = straight(~gap, gap if water else None, current_m_s=0.4)
    solution = gn.estimate(mission, "dr")
    undisturbed = gn.estimate(straight(), "dr")
    assert along_course(solution) == pytest.approx(along_course(undisturbed), abs=0.05)
    reason = "water lock in a short gap" if water else "no lock"
    assert [r.index for r in of_reason(solution, reason)] == np.flatnonzero(gap).tolist()
    assert len(solution.innovations["dvl"].nis) == (~gap).sum()


def test_water_lock_counts_after_the_limit_and_for_less() -> None:
    gap, current_m_s = within(20.0, 40.0), 0.1
    mission = straight(~gap, gap, current_m_s)
    noisy = replace(mission.sensors["dvl"], noise={"water_sigma_m_s": 0.05})
    mission = mission.with_sensor(noisy)
    used = gn.estimate(mission, "dr")
    assert of_reason(used, "water lock in a short gap") == []
    assert len(used.innovations["dvl"].nis) == len(T_DVL)
    loss_m = along_course(gn.estimate(straight(), "dr")) - along_course(used)
    assert 0.3 < loss_m <= current_m_s * 20.0  # drawn to the water's speed, not at once
    patient = gn.estimate(mission, "dr", load_config(None, ["motion.water_lock_after_s=30"]))
    assert len(of_reason(patient, "water lock in a short gap")) == gap.sum()
    assert along_course(patient) == pytest.approx(
        along_course(gn.estimate(straight(), "dr")), abs=0.1
    )
    # during the gap: less certain than with bottom lock, more than without any
    sigma = [
        np.interp(35.0, s.trajectory.t, s.trajectory.sigma_v_n[:, 0])  # type: ignore[index]
        for s in (gn.estimate(straight(), "dr"), used, patient)
    ]
    assert sigma[0] < sigma[1] < sigma[2]


def test_the_gate_rejects_and_records() -> None:
    mission = straight()
    dvl = mission.sensors["dvl"].series
    assert isinstance(dvl, DvlSeries)
    v_d = dvl.v_d.copy()
    v_d[[50, 51, 200]] += [0.0, 3.0, 0.0]
    kept = np.delete(np.arange(len(v_d)), [10, 11])  # rows are numbers in the source
    wild = replace(dvl, v_d=v_d).select(kept)
    solution = gn.estimate(mission.with_sensor(replace(mission.sensors["dvl"], series=wild)), "dr")
    gated = of_reason(solution, "innovation gate")
    assert [(r.sensor, r.index, r.t) for r in gated] == [
        ("dvl", k, float(T_DVL[k])) for k in (50, 51, 200)
    ]
    limit = np.sqrt(chi2_limit(Config().dr.gate_probability, 3))
    for rejection in gated:
        assert rejection.normalised_residual is not None
        assert rejection.normalised_residual > limit
    assert not np.isin(T_DVL[[50, 51, 200]], solution.innovations["dvl"].t).any()
    assert along_course(solution) == pytest.approx(
        along_course(gn.estimate(straight(), "dr")), abs=0.02
    )


def test_innovations_are_recorded_by_sensor() -> None:
    solution = gn.estimate(straight(), "dr")
    dof = {name: innovations.dof for name, innovations in solution.innovations.items()}
    assert dof == {"dvl": 3, "depth": 1, "heading": 1}
    for name, innovations in solution.innovations.items():
        assert len(innovations.t) == len(innovations.nis)
        assert np.all(np.diff(innovations.t) > 0), name
        assert np.all(innovations.nis >= 0), name


def test_what_the_reader_dropped_stays_on_record() -> None:
    dropped = Rejection(1.0, "dvl", 4, "non-finite v_d")
    mission = replace(straight(), rejections=(dropped,), warnings=("the echoes are simulated",))
    solution = gn.estimate(mission, "dr")
    assert solution.rejections == (dropped,)
    assert solution.warnings == mission.warnings
    assert set(solution.stage_s) == {"filter"}


def test_progress_ends_at_one() -> None:
    heard: list[tuple[str, float]] = []
    gn.estimate(straight(), "dr", progress=lambda stage, share: heard.append((stage, share)))
    assert heard[-1] == ("dead reckoning", 1.0)


def odometry(speed_m_s: float = 0.5, yaw_rate: float = 0.1) -> Sensor:
    t = np.arange(0.0, DURATION_S, 0.1)
    one = np.ones(len(t))
    series = OdometrySeries(
        t=t,
        v_b=np.outer(one, [speed_m_s, 0.0]),
        yaw_rate=yaw_rate * one,
        sigma_v=0.02 * one,
        sigma_yaw_rate=0.005 * one,
    )
    return Sensor("wheels", "odometry", series)


def test_odometry_alone_drives_a_circle() -> None:
    solution = gn.estimate(Mission("robot", {"wheels": odometry()}), "dr")
    trajectory, radius_m = solution.trajectory, 5.0
    centre = np.array([0.0, radius_m])
    distance = np.linalg.norm(trajectory.p_n[:, :2] - centre, axis=1)
    np.testing.assert_allclose(distance, radius_m, atol=0.1)
    turned = np.unwrap(trajectory.rpy[:, 2])
    np.testing.assert_allclose(
        turned - turned[50], 0.1 * (trajectory.t - trajectory.t[50]), atol=0.02
    )
    assert solution.innovations["wheels"].dof == 4


def test_wheels_climb_a_slope_and_slip_in_turns() -> None:
    """Bow 0.1 rad up and north by AHRS, while the wheels claim to turn."""
    wheels = odometry(speed_m_s=1.0, yaw_rate=0.5)
    t = wheels.series.t
    n = len(t)
    heading = HeadingSeries(t=t, heading=np.zeros(n), sigma=full(n, 0.01))
    tilt = AttitudeSeries(t=t, roll=np.zeros(n), pitch=full(n, 0.1), sigma=full(n, 0.01))
    sensors = {
        "odometry": wheels,
        "heading": Sensor("heading", "heading", heading),
        "attitude": Sensor("attitude", "attitude", tilt),
    }
    trajectory = gn.estimate(Mission("slope", sensors), "dr").trajectory
    way = t[-1] * np.array([np.cos(0.1), 0.0, -np.sin(0.1)])
    np.testing.assert_allclose(trajectory.p_n[-1], way, atol=0.05)


def test_a_turn_that_wheels_do_not_notice_is_in_the_covariance() -> None:
    """Half a degree a metre, within the degree that is stated; a compass would tell it."""
    solution = gn.estimate(Mission("bent", {"odometry": odometry(yaw_rate=0.0)}), "dr")
    track = solution.trajectory
    turn = np.radians(0.5)
    way_m = 0.5 * track.t[-1]
    truth = np.array([np.sin(turn * way_m), 1 - np.cos(turn * way_m)]) / turn
    error = track.p_n[-1, :2] - truth
    assert track.cov_pose_n is not None
    assert error @ np.linalg.solve(track.cov_pose_n[-1, :2, :2], error) < 6.0
    assert np.sqrt(track.cov_pose_n[-1, 5, 5]) > turn * way_m
    beside = straight().without("dvl").with_sensor(odometry(yaw_rate=0.0))
    by_compass = gn.estimate(beside, "dr").trajectory.sigma_rpy
    assert by_compass is not None
    assert by_compass[-1, 2] - by_compass[9, 2] < 0.01


def test_wheels_that_start_at_once_are_believed() -> None:
    wheels = odometry(speed_m_s=2.0, yaw_rate=0.0)
    series = wheels.series
    assert isinstance(series, OdometrySeries)
    v_b = np.where((series.t > 10.0)[:, None], series.v_b, 0.0)
    jerky = replace(wheels, series=replace(series, v_b=v_b))
    solution = gn.estimate(Mission("jerk", {"odometry": jerky}), "dr")
    driven = 2.0 * (series.t[-1] - 10.0)
    assert solution.rejections == ()
    assert solution.trajectory.p_n[-1, 0] == pytest.approx(driven, abs=0.2)


def test_odometry_waits_for_a_blind_dvl() -> None:
    both = straight().with_sensor(odometry())
    assert "wheels" not in gn.estimate(both, "dr").innovations
    nothing = np.zeros(len(T_DVL), dtype=bool)
    blind = straight(nothing, nothing).with_sensor(odometry(yaw_rate=0.0))
    solution = gn.estimate(blind, "dr")
    assert len(of_reason(solution, "no lock")) == len(T_DVL)
    assert along_course(solution) == pytest.approx(0.5 * DURATION_S, abs=0.5)


def test_without_a_compass_the_wheels_tell_the_turns_beside_a_dvl() -> None:
    both = straight().with_sensor(odometry(yaw_rate=0.05)).without("heading")
    solution = gn.estimate(both, "dr")
    assert solution.innovations["wheels"].dof == 1
    turned = np.unwrap(solution.trajectory.rpy[:, 2])
    assert turned[-1] - turned[0] == pytest.approx(0.05 * DURATION_S, rel=0.05)


@pytest.mark.parametrize("by_dvl", [True, False], ids=["beside a DVL", "alone"])
def test_while_the_compass_is_silent_the_wheels_tell_the_turns(by_dvl: bool) -> None:
    """Silent from 20 s on; until then it reads a steady heading, whatever the wheels say."""
    both = straight().with_sensor(odometry(yaw_rate=0.05))
    compass = both.sensors["heading"]
    early = replace(compass, series=compass.series.select(compass.series.t < 20.0))
    mission = both.with_sensor(early) if by_dvl else both.with_sensor(early).without("dvl")
    solution = gn.estimate(mission, "dr")
    assert solution.innovations["wheels yaw rate"].dof == 1
    assert solution.innovations["wheels yaw rate"].t[0] > 20.0
    assert ("wheels" in solution.innovations) != by_dvl
    trajectory = solution.trajectory
    turned = np.interp([19.0, 22.0, DURATION_S], trajectory.t, np.unwrap(trajectory.rpy[:, 2]))
    assert turned[0] == pytest.approx(HEADING, abs=0.01)
    assert turned[2] - turned[1] == pytest.approx(0.05 * (DURATION_S - 22.0), rel=0.05)


def test_wheels_that_bridge_a_silent_compass_are_as_uncertain_as_their_turns() -> None:
    """From 20 s to 50 s by a degree a metre; the first headings after that end it."""
    both = straight().without("dvl").with_sensor(odometry(yaw_rate=0.0))
    compass, turn = both.sensors["heading"], np.radians(1.0)
    t = compass.series.t
    series = replace(compass, series=compass.series.select((t < 20.0) | (t > 50.0)))
    solution = gn.estimate(both.with_sensor(series), "dr")
    (said,) = (w for w in solution.warnings if "'heading' is silent" in w)
    assert said.endswith("the odometry tells the turns")
    track = solution.trajectory
    assert track.cov_pose_n is not None
    sigma_p = np.sqrt(np.trace(track.cov_pose_n[:, :2, :2], axis1=1, axis2=2))
    sigma_yaw = np.sqrt(track.cov_pose_n[:, 5, 5])
    before, late, after = np.searchsorted(track.t, [19.0, 49.0, 55.0])
    way_m = SPEED_M_S * (track.t[late] - 20.0)
    assert sigma_yaw[late] == pytest.approx(np.hypot(sigma_yaw[before], turn * way_m), rel=0.05)
    assert sigma_p[late] > np.hypot(sigma_p[before], 0.45 * turn * way_m**2)
    assert sigma_yaw[after] < 1.1 * sigma_yaw[before]
    assert sigma_p[after] > 0.9 * sigma_p[late]


def test_a_silent_compass_that_nothing_stands_in_for_is_said() -> None:
    mission = straight()
    compass = mission.sensors["heading"]
    early = replace(compass, series=compass.series.select(compass.series.t < 20.0))
    (said,) = gn.estimate(mission.with_sensor(early), "dr").warnings
    assert said.startswith("nothing measures how the vehicle turns from 19.")
    assert not gn.estimate(mission, "dr").warnings


def test_without_velocity_the_error_names_what_there_is() -> None:
    nothing = np.zeros(len(T_DVL), dtype=bool)
    for mission, present in (
        (straight().without("dvl"), "depth, heading"),
        (straight(nothing, nothing), "depth, dvl, heading"),
    ):
        with pytest.raises(
            DataError, match=f"dead reckoning needs .*; the mission has: {present}$"
        ):
            gn.estimate(mission, "dr")


def test_a_filter_that_diverges_says_so() -> None:
    lost = replace(straight(), initial=InitialState(p_n=np.full(3, np.nan)))
    with pytest.raises(EstimationError, match="not finite"):
        gn.estimate(lost, "dr")


def leaning(mission: Mission, tilt: AttitudeSeries) -> Mission:
    """The same level way by a vehicle that leans all along: its DVL leans with it."""
    dvl = mission.sensors["dvl"]
    assert isinstance(dvl.series, DvlSeries)
    v_d = dvl.series.v_d @ rotation_from_rpy([tilt.roll[0], tilt.pitch[0], 0.0])
    mission = mission.with_sensor(replace(dvl, series=replace(dvl.series, v_d=v_d)))
    return mission.with_sensor(Sensor("attitude", "attitude", tilt))


@pytest.mark.parametrize("rpy_deg", [(0.0, 20.0, 0.0), (30.0, 0.0, 0.0), (180.0, 0.0, 0.0)])
def test_a_dvl_leans_with_the_vehicle(rpy_deg: tuple[float, float, float]) -> None:
    """Along its bow and to starboard, without a depth gauge: it climbs, or drifts to port."""
    level = straight().without("depth")
    dvl = level.sensors["dvl"]
    assert isinstance(dvl.series, DvlSeries)
    v_b = np.array([SPEED_M_S, 0.1, 0.0])
    askew = replace(dvl, series=replace(dvl.series, v_d=np.tile(v_b, (len(T_DVL), 1))))
    roll, pitch, _ = np.radians(rpy_deg)
    n = len(T_DVL)
    tilt = AttitudeSeries(t=T_DVL, roll=full(n, roll), pitch=full(n, pitch), sigma=full(n, 0.01))
    mission = level.with_sensor(askew).with_sensor(Sensor("attitude", "attitude", tilt))
    trajectory = gn.estimate(mission, "dr").trajectory
    v_n = rotation_from_rpy([roll, pitch, HEADING]) @ v_b
    np.testing.assert_allclose(trajectory.p_n[-1], v_n * trajectory.t[-1], atol=0.1)
    assert trajectory.v_n is not None
    np.testing.assert_allclose(trajectory.v_n[-1], v_n, atol=1e-3)


def test_tilt_comes_from_the_clinometer_and_turns_the_depth_lever() -> None:
    roll, pitch, arm_b = 0.2, -0.3, np.array([2.0, 0.5, -0.4])
    t = np.arange(0.0, DURATION_S, 0.5)
    n = len(t)
    tilt = AttitudeSeries(t=t, roll=full(n, roll), pitch=full(n, pitch), sigma=full(n, 0.01))
    below = float((rotation_from_rpy([roll, pitch, HEADING]) @ arm_b)[2])
    mission = leaning(straight(), tilt)
    gauge = DepthSeries(t=t, depth_m=full(n, 2.0 + below), sigma=full(n, 0.01))
    solution = gn.estimate(mission.with_sensor(Sensor("depth", "depth", gauge, xyz_b=arm_b)), "dr")
    np.testing.assert_allclose(solution.trajectory.p_n[:, 2], 2.0, atol=1e-6)
    np.testing.assert_allclose(
        solution.trajectory.rpy,
        np.tile([roll, pitch, HEADING], (len(solution.trajectory), 1)),
        atol=1e-9,
    )
    sigma_rpy = solution.trajectory.sigma_rpy
    assert sigma_rpy is not None
    assert sigma_rpy[-1, 0] == pytest.approx(0.01, rel=0.1)
    assert of_reason(solution, "innovation gate") == []


def test_one_fix_starts_it_and_no_other_is_used() -> None:
    fixes = GnssSeries(
        t=[0.0, 30.0], p_n=[[100.0, 50.0, 0.0], [900.0, 900.0, 0.0]], sigma=np.ones((2, 3))
    )
    mission = straight().with_sensor(Sensor("gnss", "gnss", fixes))
    solution = gn.estimate(mission, "dr", load_config(None, ["gnss.use=all"]))
    np.testing.assert_allclose(solution.trajectory.p_n[0], [100.0, 50.0, 2.0], atol=1e-9)
    assert solution.georeferenced
    assert solution.gnss_used == 1
    assert "gnss" not in solution.innovations
    without = gn.estimate(straight(), "dr")
    np.testing.assert_allclose(
        solution.trajectory.p_n[:, :2] - [100.0, 50.0], without.trajectory.p_n[:, :2], atol=1e-9
    )
    stated = replace(mission, initial=InitialState(p_n=np.zeros(3), heading=HEADING))
    assert gn.estimate(stated, "dr").gnss_used == 0


def horizontal_error_m(mission: Mission) -> tuple[Array, float]:
    """Distance from the truth of a simulated mission, starts brought together; and the way."""
    trajectory = gn.estimate(mission, "dr").trajectory
    assert mission.reference is not None
    truth = mission.reference.series
    assert isinstance(truth, ReferenceSeries)
    truth = truth.select(trajectory.covers(truth.t))
    found = trajectory.interpolate(truth.t)
    error = (found.p_n - truth.p_n)[:, :2]
    assert truth.rpy is not None
    assert np.abs(wrap_angle(found.rpy - truth.rpy)).max() < np.radians(25.0)
    way_m = float(np.linalg.norm(np.diff(truth.p_n, axis=0), axis=1).sum())
    return np.linalg.norm(error - error[0], axis=1), way_m


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_simulated_survey_drifts_a_little(seed: int) -> None:
    error_m, way_m = horizontal_error_m(simulate(seed=seed, duration_s=300.0))
    assert way_m > 200
    assert 0.2 < error_m.max() < 0.03 * way_m


def test_ideal_sensors_hardly_drift() -> None:
    error_m, way_m = horizontal_error_m(simulate(seed=1, duration_s=300.0, settings=IDEAL))
    assert error_m.max() < 0.003 * way_m


def test_the_same_mission_gives_the_same_bytes() -> None:
    one, other = (gn.estimate(simulate(seed=5, duration_s=40.0), "dr") for _ in range(2))
    for name in ("t", "p_n", "q_nb_wxyz", "v_n", "cov_pose_n", "sigma_v_n"):
        np.testing.assert_array_equal(
            getattr(one.trajectory, name), getattr(other.trajectory, name)
        )


@pytest.mark.realdata
def test_st_pere_shows_its_real_drift(stpere_folder: Path) -> None:
    """The logs' compass bends the track: nothing may hide that (published: 17 m)."""
    config = load_config(
        None,
        ["gnss.use=window", "gnss.window_s=[0,300]", "evaluation.window_s=[0,3020]"],
    )
    mission = gn.open_mission(stpere_folder)
    solution = gn.estimate(mission, "dr", config)
    metrics = gn.evaluate(solution, solution.reference, config.evaluation.window_s)
    assert metrics.ate.se2 is not None
    assert metrics.ate.none is not None
    assert 2.4 < metrics.ate.se2.mean < 3.5
    assert 9.0 < metrics.ate.none.mean < 15.0
    assert metrics.coverage >= 0.99
    assert "simulated sonar" in " ".join(solution.warnings)
    unlocked = {"no lock", "water lock in a short gap"}
    assert sum(rejection.reason in unlocked for rejection in solution.rejections) == 84


def test_a_stated_start_does_not_lose_the_compass() -> None:
    """Which has a bias that the filter knows nothing of: readings follow it, not the start."""
    bias = np.radians(4.0)
    start = InitialState(p_n=np.zeros(3), heading=HEADING - bias, sigma_heading=np.radians(0.1))
    solution = gn.estimate(replace(straight(), initial=start), "dr")
    assert solution.rejections == ()
    off = wrap_angle(solution.trajectory.rpy[:, 2] - HEADING)
    assert np.abs(off[50:]).max() < np.radians(0.5)
