"""A simulated mission: complete, repeatable, and honest about its noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import TypeVar

import numpy as np
import pytest

from gtsam_nav.errors import ConfigError
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.sensors.noise import NOISE_MODELS, HeadingNoise
from gtsam_nav.series import (
    AttitudeSeries,
    BeamSeries,
    DepthSeries,
    DvlSeries,
    GnssSeries,
    HeadingSeries,
    ImuSeries,
    LandmarkSeries,
    OdometrySeries,
    ReferenceSeries,
    Series,
)
from gtsam_nav.simulation import SimulationSettings, sensors, simulate
from gtsam_nav.simulation.inertia import ideal_imu
from gtsam_nav.simulation.marina import marina
from gtsam_nav.simulation.motion import Kinematics, Motion
from gtsam_nav.simulation.raycast import cast
from gtsam_nav.simulation.sensors import point_velocity_b, wall_disturbance
from gtsam_nav.simulation.settings import (
    DvlSimulation,
    GnssSimulation,
    HeadingSimulation,
    ImuSimulation,
    LandmarkSimulation,
)
from gtsam_nav.simulation.simulator import STREAMS
from gtsam_nav.simulation.sonar import SonarSimulation, beam_axes

WORLD = marina()
SEED = 3
CLEAR_WATER = SimulationSettings(landmarks=LandmarkSimulation(max_range_m=20.0))
S = TypeVar("S", bound=Series)


@pytest.fixture(scope="module")
def mission() -> Mission:
    return simulate(seed=SEED)


@pytest.fixture(scope="module")
def matched() -> Mission:
    return simulate(seed=SEED, settings=SimulationSettings.matched())


def motion_of(seed: int, settings: SimulationSettings | None = None) -> Motion:
    """The motion of a mission; with the default survey unless told."""
    stream = np.random.SeedSequence(seed).spawn(len(STREAMS))[STREAMS.index("motion")]
    survey = (settings or SimulationSettings()).motion
    return Motion(WORLD, survey, np.random.default_rng(stream))


def truth_at(t: Array) -> Kinematics:
    return motion_of(SEED).at(t)


def matched_truth_at(t: Array) -> Kinematics:
    return motion_of(SEED, SimulationSettings.matched()).at(t)


def equal(a: Series, b: Series) -> bool:
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))


def series_of(sensor: Sensor, kind: type[S]) -> S:
    assert isinstance(sensor.series, kind)
    return sensor.series


def test_it_carries_every_sensor_at_its_rate(mission: Mission) -> None:
    rates = {s.name: len(s.series) / 600 for s in mission.sensors.values()}
    wanted = {"imu": 100, "dvl": 5, "heading": 10, "attitude": 10, "depth": 2, "gnss": 1}
    for name, rate in {**wanted, "odometry": 10, "reference": 100}.items():
        assert rates[name] == pytest.approx(rate, rel=0.01), name
    assert rates["sonar"] == pytest.approx(1 / 0.07, rel=0.02)
    assert len(mission.sensors["landmarks"].series) > 10
    assert mission.span_s[0] == 0.0
    assert mission.sonar_kind == "simulated"
    assert mission.origin == WORLD.origin


def test_the_reference_is_the_truth(mission: Mission) -> None:
    assert mission.reference is not None
    reference = series_of(mission.reference, ReferenceSeries)
    truth = truth_at(reference.t)
    assert reference.rpy is not None
    np.testing.assert_array_equal(reference.p_n, truth.p_n)
    np.testing.assert_array_equal(reference.rpy, truth.rpy)


def test_noise_maps_are_what_the_noise_models_read(mission: Mission, matched: Mission) -> None:
    for outing in (mission, matched):
        for sensor in outing.sensors.values():
            if sensor.type != "reference":
                assert sensor.noise
                NOISE_MODELS[sensor.type].model_validate(dict(sensor.noise))


def test_the_same_seed_gives_the_same_bytes() -> None:
    once, again = (simulate(seed=5, duration_s=30.0) for _ in range(2))
    for name, sensor in once.sensors.items():
        assert equal(sensor.series, again.sensors[name].series), name


def test_seeds_differ_in_every_sensor() -> None:
    one, other = (simulate(seed=k, duration_s=30.0, settings=CLEAR_WATER) for k in (1, 2))
    for name, sensor in one.sensors.items():
        assert not equal(sensor.series, other.sensors[name].series), name


def test_one_sensors_settings_leave_the_others_alone() -> None:
    usual = simulate(seed=1, duration_s=30.0)
    noisy = SimulationSettings(dvl=DvlSimulation(rate_hz=2.0, dropouts_per_min=20.0))
    changed = simulate(seed=1, duration_s=30.0, settings=noisy)
    for name, sensor in usual.sensors.items():
        assert equal(sensor.series, changed.sensors[name].series) == (name != "dvl"), name


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"name": "lagoon"}, "unknown simulation 'lagoon'; the choices are: marina"),
        ({"seed": -1}, "seed is -1"),
        ({"duration_s": 0.0}, "duration is 0 s; it must lie between 1 and 100000 s"),
        ({"duration_s": 1e12}, r"duration is 1e\+12 s; it must lie between 1 and 100000 s"),
        ({"duration_s": float("nan")}, "duration is nan s"),
    ],
)
def test_bad_arguments_are_named(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        simulate(**arguments)  # type: ignore[arg-type]


def test_imu_noise_has_the_stated_densities() -> None:
    no_drift = ImuSimulation(
        gyro_bias_walk_rad_s2_sqrt_hz=1e-12, accel_bias_walk_m_s3_sqrt_hz=1e-12
    )
    settings = SimulationSettings(imu=no_drift)
    sensor = simulate(seed=SEED, duration_s=100.0, settings=settings).sensors["imu"]
    imu = series_of(sensor, ImuSeries)
    gyro_b, accel_b = ideal_imu(truth_at(imu.t), WORLD.origin, flat=True)
    for error, key in (
        (imu.gyro_i - gyro_b, "gyro_noise_density_rad_s_sqrt_hz"),
        (imu.accel_i - accel_b, "accel_noise_density_m_s2_sqrt_hz"),
    ):
        stated = sensor.noise[key] * np.sqrt(100.0)
        np.testing.assert_allclose(error.std(axis=0), stated, rtol=0.03)


def test_imu_turn_on_bias_has_the_stated_spread() -> None:
    motion, settings = motion_of(SEED), ImuSimulation()
    biases = []
    for seed in range(60):
        sensor = sensors.imu(motion, WORLD, 2.0, settings, np.random.default_rng(seed))
        imu = series_of(sensor, ImuSeries)
        gyro_b, _ = ideal_imu(motion.at(imu.t), WORLD.origin, flat=True)
        biases.append((imu.gyro_i - gyro_b).mean(axis=0))
    assert np.std(biases) == pytest.approx(settings.gyro_bias_sigma_rad_s, rel=0.2)


def test_dvl_noise_and_mounting(matched: Mission) -> None:
    sensor = matched.sensors["dvl"]
    dvl = series_of(sensor, DvlSeries)
    locked = dvl.valid & dvl.bottom_lock
    v_b = point_velocity_b(matched_truth_at(dvl.t), sensor.xyz_b)
    error = (dvl.v_d @ sensor.R_bs.T - v_b)[locked]
    np.testing.assert_allclose(error.std(axis=0), dvl.sigma[0], rtol=0.07)
    np.testing.assert_allclose(error.mean(axis=0), 0.0, atol=4 * dvl.sigma[0] / len(error) ** 0.5)


def test_dvl_loses_the_bottom_in_bursts_and_sometimes_holds_the_water(mission: Mission) -> None:
    dvl = series_of(mission.sensors["dvl"], DvlSeries)
    lost = ~dvl.bottom_lock
    assert 0.01 < lost.mean() < 0.2
    bursts = np.sum(np.diff(lost.astype(int)) == 1)
    assert lost.sum() / bursts > 3
    frequent = SimulationSettings(dvl=DvlSimulation(dropouts_per_min=6.0))
    dvl = series_of(simulate(seed=1, settings=frequent).sensors["dvl"], DvlSeries)
    assert np.any(~dvl.valid & ~dvl.bottom_lock)
    assert np.any(dvl.valid & ~dvl.bottom_lock)
    assert np.all(dvl.valid[dvl.bottom_lock])


@pytest.mark.slow
def test_matched_heading_error_has_the_stated_parts() -> None:
    motion, settings = motion_of(SEED), SimulationSettings.matched().heading
    white, whole = [], []
    for seed in range(50):
        sensor = sensors.heading(motion, WORLD, 200.0, settings, np.random.default_rng(seed))
        heading = series_of(sensor, HeadingSeries)
        error = wrap_angle(heading.heading - motion.at(heading.t).rpy[:, 2])
        white.append(np.std(np.diff(error)) / np.sqrt(2))
        whole.append(np.mean(error**2))
    noise = HeadingNoise.model_validate(dict(sensor.noise))
    assert np.degrees(np.mean(white)) == pytest.approx(noise.sigma_deg, rel=0.1)
    total = np.linalg.norm([noise.sigma_deg, noise.bias_sigma_deg, noise.disturbance_sigma_deg])
    assert np.degrees(np.sqrt(np.mean(whole))) == pytest.approx(total, rel=0.15)
    assert noise.disturbance_time_s == settings.drift_time_s
    assert not noise.disturbance_smooth


def test_walls_disturb_the_heading_as_much_as_stated(mission: Mission) -> None:
    sensor = mission.sensors["heading"]
    heading = series_of(sensor, HeadingSeries)
    truth = truth_at(heading.t)
    error_deg = np.degrees(wrap_angle(heading.heading - truth.rpy[:, 2]))
    walls_deg = np.degrees(wall_disturbance(WORLD, truth.p_n, HeadingSimulation()))
    assert np.ptp(walls_deg) > 5.0
    rest = error_deg - walls_deg
    assert rest.std() == pytest.approx(sensor.noise["sigma_deg"], rel=0.05)
    assert np.sqrt(np.mean(walls_deg**2)) == pytest.approx(
        sensor.noise["disturbance_sigma_deg"], rel=0.01
    )


def test_walls_disturb_the_heading_as_smoothly_as_stated(mission: Mission) -> None:
    """Over seconds a Gauss-Markov process of that spread and time changes far more."""
    noise = HeadingNoise.model_validate(dict(mission.sensors["heading"].noise))
    assert noise.disturbance_smooth
    t = np.arange(0.0, mission.span_s[1], 0.5)
    walls_deg = np.degrees(wall_disturbance(WORLD, truth_at(t).p_n, HeadingSimulation()))
    for lag_s in (1.0, 3.0, 6.0):
        k = round(lag_s / 0.5)
        seen = np.sqrt(np.mean((walls_deg[k:] - walls_deg[:-k]) ** 2))
        a = lag_s / noise.disturbance_time_s
        smooth, rough = noise.disturbance_sigma_deg * np.sqrt(2 * -np.expm1([-(a**2), -a]))
        assert seen == pytest.approx(smooth, rel=0.5)
        assert seen < 0.75 * rough


def test_attitude_depth_and_odometry_noise(matched: Mission) -> None:
    attitude = series_of(matched.sensors["attitude"], AttitudeSeries)
    truth = matched_truth_at(attitude.t)
    assert np.std(attitude.roll - truth.rpy[:, 0]) == pytest.approx(attitude.sigma[0], rel=0.05)
    assert np.std(attitude.pitch - truth.rpy[:, 1]) == pytest.approx(attitude.sigma[0], rel=0.05)
    depth = series_of(matched.sensors["depth"], DepthSeries)
    error = depth.depth_m - matched_truth_at(depth.t).p_n[:, 2]
    assert np.std(error) == pytest.approx(depth.sigma[0], rel=0.1)
    odometry = series_of(matched.sensors["odometry"], OdometrySeries)
    truth = matched_truth_at(odometry.t)
    error_v = odometry.v_b - truth.v_b[:, :2]
    assert np.std(error_v) == pytest.approx(odometry.sigma_v[0], rel=0.05)
    error_w = odometry.yaw_rate - truth.omega_nb_b[:, 2]
    assert np.std(error_w) == pytest.approx(odometry.sigma_yaw_rate[0], rel=0.05)


def test_gnss_states_its_whole_error() -> None:
    settings = SimulationSettings(gnss=GnssSimulation(outlier_share=0.0, drift_time_s=5.0))
    sensor = simulate(seed=SEED, duration_s=600.0, settings=settings).sensors["gnss"]
    gnss = series_of(sensor, GnssSeries)
    truth = truth_at(gnss.t)
    error = gnss.p_n - (truth.p_n + truth.R_nb @ sensor.xyz_b)
    np.testing.assert_allclose(error.std(axis=0), gnss.sigma[0], rtol=0.15)
    assert sensor.noise["sigma_horizontal_m"] == pytest.approx(gnss.sigma[0, 0])


def test_gnss_outliers_are_there_unless_matched(mission: Mission, matched: Mission) -> None:
    def far(outing: Mission, truth_at: Callable[[Array], Kinematics]) -> int:
        sensor = outing.sensors["gnss"]
        gnss = series_of(sensor, GnssSeries)
        truth = truth_at(gnss.t)
        error = gnss.p_n - (truth.p_n + truth.R_nb @ sensor.xyz_b)
        return int(np.sum(np.any(np.abs(error) > 6 * gnss.sigma, axis=1)))

    assert far(mission, truth_at) > 0
    assert far(matched, matched_truth_at) == 0


def test_landmarks_are_the_buoys_seen_from_the_truth() -> None:
    mission = simulate(seed=SEED, settings=CLEAR_WATER)
    seen = series_of(mission.sensors["landmarks"], LandmarkSeries)
    truth = truth_at(seen.t)
    buoy_n = WORLD.landmarks_n[np.searchsorted(WORLD.landmark_id, seen.id)]
    offset_b = np.einsum("nji,nj->ni", truth.R_nb, buoy_n - truth.p_n)
    error_range = seen.range_m - np.linalg.norm(offset_b, axis=1)
    error_bearing = wrap_angle(seen.bearing - np.arctan2(offset_b[:, 1], offset_b[:, 0]))
    assert np.std(error_range) == pytest.approx(seen.sigma_range[0], rel=0.2)
    assert np.std(error_bearing) == pytest.approx(seen.sigma_bearing[0], rel=0.2)
    assert set(seen.id) == set(WORLD.landmark_id)


def test_strongest_echoes_lie_at_the_true_wall_ranges(mission: Mission) -> None:
    beams = series_of(mission.sensors["sonar"], BeamSeries)
    s = SonarSimulation()
    origin_n, azimuth = beam_axes(motion_of(SEED), beams.t, beams.angle, s)
    hits = cast(WORLD, origin_n, azimuth[:, None], s.range_m)
    ring_down = round(2.0 / beams.resolution_m)
    strongest = ring_down + beams.intensity[:, ring_down:].argmax(axis=1)
    level = np.take_along_axis(beams.intensity, strongest[:, None], axis=1)[:, 0]
    error = (strongest + 0.5) * beams.resolution_m - hits.range_m[:, 0]
    clear = (level > 100) & np.isfinite(error)
    assert clear.mean() > 0.4
    assert np.median(np.abs(error[clear])) < 0.15
    assert abs(np.median(error[clear])) < 0.05


def test_pings_are_lost_and_the_head_steps_on(mission: Mission) -> None:
    beams = series_of(mission.sensors["sonar"], BeamSeries)
    gaps = np.diff(beams.t)
    lost = np.round(gaps / 0.07).astype(int) - 1
    assert lost.max() >= 1
    assert lost.sum() / len(beams) == pytest.approx(0.005, abs=0.004)
    steps = np.diff(np.unwrap(beams.angle))
    np.testing.assert_allclose(steps, np.radians(1.8) * (lost + 1), atol=1e-9)
    assert beams.angle.min() >= 0
    assert beams.angle.max() < 2 * np.pi


def quiet(**changes: float) -> BeamSeries:
    """Beams of 15 s without speckle's causes other than the wanted ones."""
    nothing = {"echo_level": 0.0, "clutter_per_beam": 0.0, "ring_down_level": 0.0}
    sonar = SonarSimulation.model_validate({**nothing, **changes})
    outing = simulate(seed=1, duration_s=15.0, settings=SimulationSettings(sonar=sonar))
    return series_of(outing.sensors["sonar"], BeamSeries)


def test_noise_floor_rises_with_range_and_is_rayleigh() -> None:
    level = quiet(noise_near=20.0, noise_far=60.0).intensity.astype(float) + 0.5
    power = (level**2).mean(axis=0)
    assert power[:20].mean() == pytest.approx(20.0**2 * 3 ** (2 * 0.02), rel=0.1)
    assert power[-20:].mean() == pytest.approx(60.0**2 * 3 ** (-2 * 0.02), rel=0.1)
    ratio = np.std(level[:, -50:]) / np.mean(level[:, -50:])
    assert ratio == pytest.approx(np.sqrt(4 / np.pi - 1), rel=0.05)


def test_ring_down_dies_away_and_clutter_comes_when_asked() -> None:
    ringing = quiet(ring_down_level=160.0).intensity
    assert ringing[:, 0].mean() > 80
    assert ringing[:, 40:60].mean() < 10
    assert quiet().intensity.max() < 80
    assert np.sum(quiet(clutter_per_beam=1.0).intensity > 80) > 50


def test_second_echoes_come_at_twice_the_range() -> None:
    """At 15 s the vehicle faces walls to both sides within half of the sonar's range."""
    loud = {"echo_level": 150.0, "second_echo": 1.0, "noise_far": 4.0, "lost_share": 0.0}
    beams = quiet(**loud)
    s = SonarSimulation.model_validate(loud)
    origin_n, azimuth = beam_axes(motion_of(1), beams.t, beams.angle, s)
    hits = cast(WORLD, origin_n, azimuth[:, None], s.range_m)
    range_m = hits.range_m[:, 0]
    head_on = np.flatnonzero((hits.cosine[:, 0] > 0.98) & (range_m < 24))
    assert len(head_on) > 10
    at_twice = [beams.intensity[k, round(20 * range_m[k]) + np.arange(-5, 6)] for k in head_on]
    assert np.median(np.max(at_twice, axis=1)) > 40
