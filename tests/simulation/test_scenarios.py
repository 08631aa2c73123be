"""The scenarios of the published systems: where they go, and that what they measure agrees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from gtsam_nav.frames import (
    EARTH_RATE_RAD_S,
    Array,
    Origin,
    geodetic_from_ned,
    gravity_m_s2,
    rotation_from_rpy,
    wrap_angle,
)
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.alignment import level_at_rest
from gtsam_nav.sensors.noise import NOISE_MODELS
from gtsam_nav.series import (
    DepthSeries,
    GnssSeries,
    HeadingSeries,
    ImuSeries,
    LandmarkSeries,
    ReferenceSeries,
)
from gtsam_nav.simulation import SCENARIOS, make_scenario, simulate
from gtsam_nav.simulation.inertia import gravity_n, ideal_imu
from gtsam_nav.simulation.motion import Motion, MotionSettings
from gtsam_nav.simulation.ranger import END_POINTS_M
from gtsam_nav.simulation.simulator import STREAMS

SPIN_I = np.array([0.0, 0.0, EARTH_RATE_RAD_S])
PUBLISHED = ("laps", "ranger", "submarine")
ABOARD = {
    "laps": {"imu", "heading", "gnss", "reference"},
    "ranger": {"imu", "landmarks", "reference"},
    "submarine": {"imu", "depth", "landmarks", "reference"},
}


@pytest.fixture(scope="module")
def missions() -> dict[str, Mission]:
    return {name: simulate(name, seed=2) for name in PUBLISHED}


def motion_of(name: str, seed: int) -> Motion:
    scenario = make_scenario(name, seed)
    stream = np.random.SeedSequence(seed).spawn(len(STREAMS))[STREAMS.index("motion")]
    return Motion(scenario.world, scenario.settings.motion, np.random.default_rng(stream))


def truth_of(mission: Mission) -> ReferenceSeries:
    assert mission.reference is not None
    assert isinstance(mission.reference.series, ReferenceSeries)
    return mission.reference.series


@pytest.mark.parametrize("name", PUBLISHED)
def test_it_carries_just_its_sensors_and_states_their_noise(
    missions: dict[str, Mission], name: str
) -> None:
    mission = missions[name]
    assert set(mission.sensors) == ABOARD[name]
    for sensor in mission.sensors.values():
        if sensor.type != "reference":
            NOISE_MODELS[sensor.type].model_validate(dict(sensor.noise))
    first, last = mission.span_s
    assert last - first == pytest.approx(make_scenario(name).duration_s, abs=1.5)
    assert truth_of(mission).rpy is not None


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_same_seed_gives_the_same_mission_and_another_one_another(name: str) -> None:
    once, again, other = (simulate(name, seed=k, duration_s=5.0) for k in (4, 4, 5))
    for sensor in once.sensors.values():
        np.testing.assert_array_equal(sensor.series.t, again.sensors[sensor.name].series.t)
    imus = [m.sensors["imu"].series for m in (once, again, other)]
    gyro = [imu.gyro_i for imu in imus if isinstance(imu, ImuSeries)]
    np.testing.assert_array_equal(gyro[0], gyro[1])
    assert not np.array_equal(gyro[0], gyro[2])
    assert once.initial.heading == again.initial.heading


def test_a_shorter_mission_is_the_beginning_of_the_longer() -> None:
    short, long = (truth_of(simulate("laps", duration_s=s)) for s in (60.0, 90.0))
    np.testing.assert_array_equal(short.p_n, long.p_n[: len(short)])


# ------------------------------------------------------------------------------------- the motion


@pytest.mark.parametrize("name", PUBLISHED)
def test_velocity_acceleration_and_rates_are_the_derivatives(name: str) -> None:
    """Through the ramps, the waves that come with the speed, and the stop at the end."""
    motion, h = motion_of(name, 1), 1e-4
    t = np.linspace(0.1, make_scenario(name).duration_s, 400)
    before, now, after = (motion.at(t + k * h) for k in (-1, 0, 1))
    np.testing.assert_allclose((after.p_n - before.p_n) / (2 * h), now.v_n, atol=2e-6)
    np.testing.assert_allclose((after.v_n - before.v_n) / (2 * h), now.a_n, atol=2e-6)
    turn = np.swapaxes(before.R_nb, 1, 2) @ after.R_nb / (2 * h)
    rate = np.column_stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]])
    np.testing.assert_allclose(rate, now.omega_nb_b, atol=1e-5)


@dataclass(frozen=True)
class InertialAxes:
    """Axes about the centre of the Earth that do not turn; they are the Earth's at time zero."""

    origin: Origin

    @property
    def R_en(self) -> Array:  # noqa: N802
        lat, lon = np.radians([self.origin.latitude_deg, self.origin.longitude_deg])
        return rotation_from_rpy([0.0, -lat - np.pi / 2, lon])

    def R_in(self, t: float) -> Array:  # noqa: N802
        return rotation_from_rpy([0.0, 0.0, EARTH_RATE_RAD_S * t]) @ self.R_en

    @property
    def origin_e(self) -> Array:
        a, e2, up = 6378137.0, 0.00669437999014, -self.R_en[:, 2]
        return np.asarray(a / np.sqrt(1 - e2 * up[2] ** 2) * up * [1, 1, 1 - e2])

    def position(self, t: float, p_n: Array) -> Array:
        return np.asarray(self.R_in(t) @ (p_n + self.R_en.T @ self.origin_e))

    def position_n(self, t: float, p_i: Array) -> Array:
        return np.asarray(self.R_in(t).T @ p_i - self.R_en.T @ self.origin_e)

    def gravitation(self, t: float, p_i: Array) -> Array:
        """Gravity less the centrifugal part, which belongs to the Earth's axes."""
        pull_n = gravity_n(self.position_n(t, p_i)[None], self.origin)[0]
        return np.asarray(self.R_in(t) @ pull_n + np.cross(SPIN_I, np.cross(SPIN_I, p_i)))


def integrate(name: str, rate_hz: float, stop_s: float) -> tuple[float, float]:
    """How far from the truth perfect readings end, m and rad, when integrated in inertial axes.

    Another frame and other equations than those that made them.
    """
    from scipy.spatial.transform import Rotation

    origin, dt = make_scenario(name).world.origin, 1 / rate_hz
    assert origin is not None
    axes = InertialAxes(origin)
    truth = motion_of(name, 0).at(np.arange(round(stop_s * rate_hz) + 1) * dt)
    gyro_b, force_b = ideal_imu(truth, origin)
    turns = Rotation.from_rotvec(0.5 * (gyro_b[1:] + gyro_b[:-1]) * dt).as_matrix()
    p_i = axes.position(0.0, truth.p_n[0])
    v_i = axes.R_in(0.0) @ truth.v_n[0] + np.cross(SPIN_I, p_i)
    R_ib = axes.R_in(0.0) @ truth.R_nb[0]
    pull = axes.gravitation(0.0, p_i)
    for k, turn in enumerate(turns):
        pull_next = axes.gravitation((k + 1) * dt, p_i + v_i * dt)
        push = 0.5 * (R_ib @ force_b[k] + R_ib @ turn @ force_b[k + 1])
        a_i = push + 0.5 * (pull + pull_next)
        p_i, v_i, R_ib = p_i + v_i * dt + 0.5 * a_i * dt**2, v_i + a_i * dt, R_ib @ turn
        pull = pull_next
    away_n = axes.position_n(truth.t[-1], p_i) - truth.p_n[-1]
    turned = (axes.R_in(truth.t[-1]).T @ R_ib).T @ truth.R_nb[-1]
    return float(np.linalg.norm(away_n)), float(Rotation.from_matrix(turned).magnitude())


@pytest.mark.parametrize(
    ("name", "rate_hz", "stop_s", "within_m"),
    [
        ("submarine", 10.0, 150.0, 0.05),
        ("laps", 50.0, 30.0, 0.01),
        pytest.param("laps", 25.0, 240.0, 1.5, marks=pytest.mark.slow),
        pytest.param("submarine", 10.0, 1800.0, 4.0, marks=pytest.mark.slow),
    ],
)
def test_perfect_readings_integrate_to_the_truth(
    name: str, rate_hz: float, stop_s: float, within_m: float
) -> None:
    away_m, turned = integrate(name, rate_hz, stop_s)
    assert away_m < within_m
    assert turned < np.radians(0.005)


def test_gravity_points_along_the_ellipsoids_normal() -> None:
    """A step along it changes the height alone; its strength is that of the place."""
    origin = make_scenario("submarine").world.origin
    assert origin is not None
    p_n = np.array([[0.0, 0.0, 0.0], [1500.0, -800.0, 60.0], [-4000.0, 9000.0, -100.0]])
    pull_n = gravity_n(p_n, origin)
    before = geodetic_from_ned(p_n, origin)
    after = geodetic_from_ned(p_n + 1000 * pull_n / np.linalg.norm(pull_n, axis=1)[:, None], origin)
    np.testing.assert_allclose(after[0], before[0], atol=1e-9)
    np.testing.assert_allclose(after[1], before[1], atol=1e-9)
    np.testing.assert_allclose(after[2], before[2] - 1000, atol=1e-3)
    strength = [gravity_m_s2(lat, h) for lat, h in zip(before[0], before[2], strict=True)]
    np.testing.assert_allclose(np.linalg.norm(pull_n, axis=1), strength, rtol=1e-12)
    assert np.linalg.norm(pull_n[1, :2]) == pytest.approx(9.82 * 1700 / 6.37e6, rel=0.01)


def test_the_laps_are_two_that_end_ninety_metres_east(missions: dict[str, Mission]) -> None:
    truth = truth_of(missions["laps"])
    assert truth.rpy is not None
    np.testing.assert_allclose(truth.p_n[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(truth.p_n[-1], [0.0, 90.0, 0.0], atol=1e-9)
    turned = np.unwrap(truth.rpy[:, 2])
    assert turned[-1] - turned[0] == pytest.approx(4 * np.pi, abs=1e-6)
    speed = np.linalg.norm(np.diff(truth.p_n[:, :2], axis=0), axis=1) * 20.0
    assert np.all(speed[: 20 * 20] < 1e-6)
    assert np.median(speed) == pytest.approx(2.5, rel=0.01)
    assert speed[-20:].max() < 1e-6


def test_the_laps_start_still_enough_to_level(missions: dict[str, Mission]) -> None:
    levelled = level_at_rest(missions["laps"], 0.0)
    assert levelled is not None
    accel_sigma = missions["laps"].sensors["imu"].noise["accel_bias_sigma_m_s2"]
    assert np.abs(levelled).max() < 4 * accel_sigma / 9.81
    imu = missions["laps"].sensors["imu"].series.crop(100.0, 110.0)
    assert isinstance(imu, ImuSeries)
    assert imu.accel_i.std(axis=0).max() > 0.15


@pytest.mark.parametrize("seed", range(7))
def test_the_ranger_ends_where_its_published_run_did(seed: int) -> None:
    mission = simulate("ranger", seed=seed)
    x_m, y_m = END_POINTS_M[seed % 5]
    np.testing.assert_allclose(truth_of(mission).p_n[-1], [y_m, x_m, 0.0], atol=1e-9)
    assert mission.origin is None
    assert mission.initial.p_n is not None
    np.testing.assert_allclose(mission.initial.p_n, 0.0, atol=5e-3)
    assert mission.initial.heading == pytest.approx(0.0, abs=np.radians(0.5))


def test_the_ranger_looks_before_and_after_its_drive_and_not_during_it() -> None:
    for seed in range(10):
        mission = simulate("ranger", seed=seed)
        seen = mission.sensors["landmarks"].series
        assert isinstance(seen, LandmarkSeries)
        truth = truth_of(mission)
        way = np.linalg.norm(truth.p_n - truth.p_n[0], axis=1)
        start, stop = truth.t[way > 1e-4][0], truth.t[way < way[-1] - 1e-4][-1]
        assert stop - start > 1.5
        before, after = seen.t < start + 0.1, seen.t > stop - 0.1
        assert np.all(before | after)
        assert set(seen.id[before]) == set(seen.id[after]) == {1, 2}


def test_the_submarine_always_has_a_beacon_in_reach_and_meets_all_again(
    missions: dict[str, Mission],
) -> None:
    seen = missions["submarine"].sensors["landmarks"].series
    assert isinstance(seen, LandmarkSeries)
    assert np.diff(seen.t).max() < 60.0
    revisited = [k for k in set(seen.id) if np.ptp(seen.t[seen.id == k]) > 900.0]
    assert len(set(seen.id)) == 8
    assert len(revisited) >= 4


# ------------------------------------------------------------------------------------ the sensors


def test_noise_of_the_laps_is_as_stated(missions: dict[str, Mission]) -> None:
    mission, motion = missions["laps"], motion_of("laps", 2)
    heading, gnss = mission.sensors["heading"].series, mission.sensors["gnss"]
    assert isinstance(heading, HeadingSeries)
    assert isinstance(gnss.series, GnssSeries)
    error = wrap_angle(heading.heading - motion.at(heading.t).rpy[:, 2])
    assert np.degrees(error.std()) == pytest.approx(1.0, rel=0.05)
    assert abs(np.degrees(error.mean())) < 0.05
    truth = motion.at(gnss.series.t)
    antenna_n = truth.p_n + truth.R_nb @ gnss.xyz_b
    error_p = gnss.series.p_n - antenna_n
    np.testing.assert_allclose(error_p.std(axis=0), [1.2, 1.2, 2.4], rtol=0.15)
    np.testing.assert_allclose(gnss.series.sigma, np.tile([1.2, 1.2, 2.4], (len(truth.t), 1)))
    assert gnss.series.v_n is not None
    h = 1e-3
    later = motion.at(gnss.series.t + h)
    v_n = (later.p_n + later.R_nb @ gnss.xyz_b - antenna_n) / h
    error_v = gnss.series.v_n - v_n
    stated = gnss.noise["sigma_velocity_m_s"]
    np.testing.assert_allclose(error_v.std(axis=0), stated, rtol=0.15)
    np.testing.assert_allclose(error_v.mean(axis=0), 0.0, atol=0.05)


@pytest.mark.parametrize("name", ["ranger", "submarine"])
def test_sightings_are_as_wrong_as_stated(name: str) -> None:
    """Normalised by the stated sigmas they are standard normal, in range, bearing, elevation."""
    ratios: list[Array] = []
    for seed in range(40 if name == "ranger" else 1):
        world = make_scenario(name, seed).world
        seen = simulate(name, seed).sensors["landmarks"].series
        assert isinstance(seen, LandmarkSeries)
        truth = motion_of(name, seed).at(seen.t)
        landmark_n = world.landmarks_n[np.searchsorted(world.landmark_id, seen.id)]
        x, y, z = np.einsum("nji,nj->in", truth.R_nb, landmark_n - truth.p_n)
        parts = [
            (seen.range_m - np.sqrt(x**2 + y**2 + z**2)) / seen.sigma_range,
            wrap_angle(seen.bearing - np.arctan2(y, x)) / seen.sigma_bearing,
        ]
        if seen.elevation is not None:
            parts.append((seen.elevation - np.arctan2(-z, np.hypot(x, y))) / seen.sigma_bearing)
        ratios.append(np.array(parts))
    ratio = np.concatenate(ratios, axis=1)
    assert len(ratio) == (2 if name == "ranger" else 3)
    np.testing.assert_allclose(ratio.std(axis=1), 1.0, atol=0.12)
    np.testing.assert_allclose(ratio.mean(axis=1), 0.0, atol=0.15)


def test_range_errors_of_the_ranger_are_three_percent_of_the_range() -> None:
    seen = simulate("ranger", 3).sensors["landmarks"].series
    assert isinstance(seen, LandmarkSeries)
    np.testing.assert_allclose(seen.sigma_range / seen.range_m, 0.03, rtol=0.02)
    np.testing.assert_allclose(np.degrees(seen.sigma_bearing), 1.8)


def test_the_submarine_states_its_start_with_the_errors_it_says() -> None:
    errors = []
    for seed in range(60):
        mission = simulate("submarine", seed, duration_s=2.0)
        truth = truth_of(mission)
        assert truth.rpy is not None
        assert mission.initial.heading is not None
        heading = wrap_angle(mission.initial.heading - truth.rpy[0, 2])
        away_n = mission.initial.p_n - truth.p_n[0]
        errors.append([*away_n / mission.initial.sigma_p, heading / mission.initial.sigma_heading])
    np.testing.assert_allclose(np.std(errors, axis=0), 1.0, atol=0.3)
    depth = simulate("submarine").sensors["depth"].series
    assert isinstance(depth, DepthSeries)
    true_d = motion_of("submarine", 0).at(depth.t).p_n[:, 2]
    assert np.std(depth.depth_m - true_d) == pytest.approx(depth.sigma[0], rel=0.1)


def test_an_open_course_too_short_for_cruise_speed_is_driven_all_the_same() -> None:
    slow_to_start = MotionSettings(rest_s=1.0, ramp_s=30.0, speed_m_s=1.0)
    world = make_scenario("ranger").world
    motion = Motion(world, slow_to_start, np.random.default_rng(0))
    end = motion.at([100.0])
    np.testing.assert_allclose(end.p_n[0, :2], world.course.waypoints_n[-1], atol=1e-9)
    assert np.linalg.norm(motion.at(np.arange(0.0, 40.0)).v_n, axis=1).max() < 0.2
