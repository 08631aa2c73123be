"""The mechanisation against its readable twin, another frame, and central differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gtsam_nav.ekf import _strapdown
from gtsam_nav.ekf.local_level import LevelState, LocalLevel
from gtsam_nav.ekf.mechanisation import Readings, integrate_readable
from gtsam_nav.ekf.strapdown import (
    ACCEL_BIAS,
    GYRO_BIAS,
    NU,
    RHO,
    SIZE,
    THETA,
    InertialState,
    Strapdown,
)
from gtsam_nav.frames import (
    EARTH_RATE_RAD_S,
    Array,
    Origin,
    earth_rate_n,
    gravity_m_s2,
    ned_from_geodetic,
    quaternion_from_rotation,
    quaternion_from_rpy,
    rotation_from_quaternion,
    rotation_from_rpy,
)
from gtsam_nav.mission import Sensor
from gtsam_nav.preprocess.strapdown import readings_at_origin
from gtsam_nav.series import ImuSeries

BREST = Origin(48.3, -4.8, 20.0)
seeds = given(st.integers(0, 2**32 - 1))


def imu(t: Array, gyro_i: Array, accel_i: Array, **mounting: Array) -> Sensor:
    return Sensor("imu", "imu", ImuSeries(t=t, gyro_i=gyro_i, accel_i=accel_i), **mounting)


def state(rpy: Array, v_n: Array, p_n: Array | None = None, t: float = 0.0) -> InertialState:
    p_n = np.zeros(3) if p_n is None else p_n
    return InertialState(t, quaternion_from_rpy(rpy), p_n, v_n, np.zeros(3), np.zeros(3))


def restless(rng: np.random.Generator, t: Array) -> tuple[Array, Array]:
    """Smooth readings of a vehicle that turns and surges."""
    phase = rng.uniform(0, 2 * np.pi, (2, 3))
    w = 0.2 * np.sin(np.outer(t, [1.0, 0.7, 1.3]) + phase[0])
    return w, np.sin(np.outer(t, [0.9, 1.1, 0.6]) + phase[1]) + np.array([0.0, 0.0, -9.8])


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_the_compiled_mechanisation_is_the_readable_one(seed: int, curved: bool) -> None:
    rng = np.random.default_rng(seed)
    # steady samples, a silence in the middle, and spans that begin before and end after all of them
    t = np.sort(np.concatenate([rng.uniform(0.0, 1.0, 60), rng.uniform(4.0, 4.5, 30)]))
    n = len(t)
    gyro_b, accel_b = 0.3 * rng.normal(size=(n, 3)), rng.normal(size=(n, 3)) * 2 + [0, 0, -9.8]
    q, v_n = quaternion_from_rpy(rng.uniform(-1.5, 1.5, 3)), 5 * rng.normal(size=3)
    p_n = rng.normal(size=3) * [3e4, 3e4, 100.0]
    biases = 0.01 * rng.normal(size=6)
    there = Origin(rng.uniform(-80, 80), rng.uniform(-180, 180), 100.0)
    level = LocalLevel(there) if curved else None
    origin = np.array(level.origin) if level else np.empty(0)
    growth = rng.uniform(0, 1e-3, (3, SIZE))
    from_s, to_s = (float(moment) for moment in np.sort(rng.uniform(-0.5, 6.5, 2)))
    x, place = np.concatenate([q, v_n, biases]), p_n.copy()
    Phi, Q = np.eye(SIZE), np.zeros((SIZE, SIZE))
    k = int(np.searchsorted(t, from_s, side="right")) - 1
    _strapdown.integrate(
        x, place, Phi, Q, np.empty(_strapdown.SCRATCH), origin, t, gyro_b, accel_b, k, from_s, to_s,
        0.2, growth,
    )  # fmt: skip
    begin = level.enter(q, p_n, v_n) if level else LevelState(q, v_n, p_n)
    wanted_x, wanted_place, wanted_Phi, wanted_Q = integrate_readable(
        np.concatenate([begin.q_wxyz, begin.v, biases]),
        begin.place,
        curved,
        Readings(t, gyro_b, accel_b, 0.2),
        from_s,
        to_s,
        growth,
    )
    end = wanted_x[:4], wanted_place, wanted_x[4:7]
    if level:
        end = level.leave(LevelState(end[0], end[2], end[1]))
    np.testing.assert_allclose(x[:4] * np.sign(x[:4] @ end[0]), end[0], atol=1e-11)
    np.testing.assert_allclose(place, end[1], rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(x[4:7], end[2], rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(x[7:], biases)
    np.testing.assert_allclose(Phi, wanted_Phi, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(Q, wanted_Q, rtol=1e-9, atol=1e-12)


def ecef_axes(latitude: float, longitude: float) -> Array:
    """North, east, down as columns."""
    s, c, sl, cl = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    return np.array([[-s * cl, -sl, -c * cl], [-s * sl, cl, -c * sl], [c, 0.0, -s]])


def drive_in_ecef(t: Array, w_b: Array, f_b: Array, start: InertialState) -> tuple[Array, Array]:
    """Position and velocity in the mission's NED by integration in ECEF, a frame that neither
    leans nor turns with the vehicle: midpoint rule, small steps."""
    import pymap3d

    R_en = ecef_axes(np.radians(BREST.latitude_deg), np.radians(BREST.longitude_deg))
    origin_e = np.array(
        pymap3d.geodetic2ecef(BREST.latitude_deg, BREST.longitude_deg, BREST.height_m)
    )
    spin_e = np.array([0.0, 0.0, EARTH_RATE_RAD_S])

    def acceleration(R_eb: Array, p_e: Array, v_e: Array, force_b: Array) -> Array:
        lat, lon, h = pymap3d.ecef2geodetic(*p_e)
        down_e = ecef_axes(np.radians(lat), np.radians(lon))[:, 2]
        g_e = gravity_m_s2(float(lat), float(h)) * down_e
        return R_eb @ force_b + g_e - 2 * np.cross(spin_e, v_e)

    R_eb = R_en @ start.body.R_nb
    p_e, v_e = origin_e + R_en @ start.p_n, R_en @ start.v_n
    for k, dt in enumerate(np.diff(t)):
        w, f = (w_b[k] + w_b[k + 1]) / 2, (f_b[k] + f_b[k + 1]) / 2
        spin_b = R_eb.T @ spin_e
        half = R_eb @ Rotation.from_rotvec((w - spin_b) * dt / 2).as_matrix()
        a = acceleration(half, p_e + v_e * dt / 2, v_e, f)
        p_e, v_e = p_e + v_e * dt + a * dt**2 / 2, v_e + a * dt
        R_eb = R_eb @ Rotation.from_rotvec((w - spin_b) * dt).as_matrix()
    return R_en.T @ (p_e - origin_e), R_en.T @ v_e


@pytest.mark.slow
def test_tens_of_kilometres_away_the_earth_is_still_round() -> None:
    """Against another frame: transport rate, radii, Coriolis and the leaning vertical all count."""
    t = np.arange(0.0, 600.0, 0.1)
    w_b, f_b = restless(np.random.default_rng(0), t)
    w_b = 0.02 * w_b
    start = state(np.array([0.02, -0.01, 0.9]), np.array([60.0, 40.0, -1.0]))
    p_n, v_n = drive_in_ecef(t, w_b, f_b, start)
    assert np.linalg.norm(p_n[:2]) > 30e3
    found = Strapdown(imu(t, w_b, f_b), BREST).propagate(start, float(t[-1])).state
    np.testing.assert_allclose(found.p_n, p_n, atol=0.2)
    np.testing.assert_allclose(found.v_n, v_n, atol=1e-3)
    in_spans, strapdown = start, Strapdown(imu(t, w_b, f_b), BREST)
    for to_s in np.append(np.arange(0.37, t[-1], 0.37), t[-1]):
        in_spans = strapdown.propagate(in_spans, float(to_s)).state
    np.testing.assert_allclose(in_spans.p_n, p_n, atol=0.2)
    flat = Strapdown(imu(t, w_b, f_b), None).propagate(start, float(t[-1])).state
    assert np.linalg.norm(flat.p_n - p_n) > 500.0  # the test bites


@pytest.mark.parametrize("latitude_deg", [-60.0, 0.0, 48.3])
def test_what_stands_on_the_earth_stays_there(latitude_deg: float) -> None:
    origin, rpy = Origin(latitude_deg, 7.0, 300.0), np.array([0.3, -0.2, 2.0])
    t = np.arange(0.0, 301.0, 0.1)
    R_nb = rotation_from_rpy(rpy)
    w_b = R_nb.T @ earth_rate_n(latitude_deg)
    f_b = R_nb.T @ [0.0, 0.0, -gravity_m_s2(latitude_deg, 300.0)]
    still = imu(t, np.tile(w_b, (len(t), 1)), np.tile(f_b, (len(t), 1)))
    end = Strapdown(still, origin).propagate(state(rpy, np.zeros(3)), 300.0).state
    np.testing.assert_allclose(end.p_n, 0.0, atol=1e-4)
    np.testing.assert_allclose(rotation_from_quaternion(end.q_nb_wxyz), R_nb, atol=1e-9)


def test_without_an_origin_the_earth_stands_still() -> None:
    t = np.arange(0.0, 11.0, 0.1)
    rest = imu(t, np.zeros((len(t), 3)), np.tile([1.0, 0.0, -9.80665], (len(t), 1)))
    end = Strapdown(rest, None).propagate(state(np.zeros(3), np.zeros(3)), 10.0).state
    np.testing.assert_allclose(end.p_n, [50.0, 0.0, 0.0], atol=1e-9)


@seeds
@settings(max_examples=20)
def test_places_go_there_and_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    level = LocalLevel(BREST)
    q = quaternion_from_rotation(Rotation.random(random_state=seed).as_matrix())
    p_n, v_n = rng.normal(size=3) * [3e4, 3e4, 100.0], 10 * rng.normal(size=3)
    there = level.enter(q, p_n, v_n)
    lat, lon, h = there.place
    np.testing.assert_allclose(
        ned_from_geodetic(np.degrees(lat), np.degrees(lon), h, BREST), p_n, atol=1e-5
    )
    back = level.leave(there)
    for one, other in zip(back, (q, p_n, v_n), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-7)
    assert level.sag_m(p_n) == pytest.approx(p_n[:2] @ p_n[:2] / 2 / 6.38e6, rel=0.02, abs=0.01)


def moved(start: InertialState, error: Array) -> InertialState:
    return start.corrected(error)


def difference(a: InertialState, b: InertialState) -> Array:
    """The error that leads from a to b."""
    out = np.empty(SIZE)
    out[THETA] = Rotation.from_matrix(a.body.R_nb.T @ b.body.R_nb).as_rotvec()
    out[RHO] = a.body.R_nb.T @ (b.p_n - a.p_n)
    out[NU] = a.body.R_nb.T @ (b.v_n - a.v_n)
    out[GYRO_BIAS] = b.gyro_bias_b - a.gyro_bias_b
    out[ACCEL_BIAS] = b.accel_bias_b - a.accel_bias_b
    return out


@pytest.mark.parametrize("origin", [None, BREST], ids=["flat", "round"])
def test_the_transition_is_that_of_the_errors(origin: Origin | None) -> None:
    t = np.arange(0.0, 3.0, 0.01)
    w_b, f_b = restless(np.random.default_rng(3), t)
    strapdown = Strapdown(imu(t, w_b, f_b), origin)
    start = state(np.array([0.2, -0.3, 2.0]), np.array([8.0, -3.0, 0.5]), np.array([4e4, 1e4, 3.0]))
    span = strapdown.propagate(start, 2.005)
    steps = np.concatenate([np.full(3, 1e-5), np.full(3, 10.0), np.full(9, 1e-4)])
    numeric = [
        (
            difference(span.state, strapdown.propagate(moved(start, e), 2.005).state)
            - difference(span.state, strapdown.propagate(moved(start, -e), 2.005).state)
        )
        / (2 * steps[k])
        for k, e in enumerate(np.diag(steps))
    ]
    np.testing.assert_allclose(span.Phi, np.array(numeric).T, atol=2e-3)
    gradient = np.array(numeric).T[NU, RHO]
    np.testing.assert_allclose(span.Phi[NU, RHO], gradient, atol=1e-7)


def test_noise_grows_as_white_noise_integrates() -> None:
    t = np.arange(0.0, 20.0, 0.01)
    still = imu(t, np.zeros((len(t), 3)), np.tile([0.0, 0.0, -9.80665], (len(t), 1)))
    span = Strapdown(still, None).propagate(state(np.zeros(3), np.zeros(3)), 10.0)
    noise = Strapdown(still, None).noise
    q_a = noise.accel_noise_density_m_s2_sqrt_hz**2
    q_g = noise.gyro_noise_density_rad_s_sqrt_hz**2
    walk = noise.accel_bias_walk_m_s3_sqrt_hz**2
    vertical = q_a * 10.0**3 / 3 + walk * 10.0**5 / 20
    assert span.Q[5, 5] == pytest.approx(vertical, rel=0.01)
    assert span.Q[0, 0] == pytest.approx(q_g * 10.0, rel=0.01)
    # a tilt that walks makes gravity push: the third integral of white noise
    level = vertical + q_g * 9.80665**2 * 10.0**5 / 20
    assert span.Q[3, 3] == pytest.approx(level, rel=0.02)


def test_a_mounted_imu_reads_as_one_at_the_origin() -> None:
    t = np.arange(0.0, 10.0, 0.01)
    xyz_b, R_bi = np.array([1.0, -0.5, 0.4]), rotation_from_rpy([np.pi, 0.1, -2.0])
    w = np.stack([0.3 * np.sin(t), 0.2 * np.cos(2 * t), 0.5 * np.sin(0.5 * t)], axis=1)
    w_rate = np.stack([0.3 * np.cos(t), -0.4 * np.sin(2 * t), 0.25 * np.cos(0.5 * t)], axis=1)
    f_origin = np.tile([0.1, 0.2, -9.8], (len(t), 1))
    f_there = f_origin + np.cross(w_rate, xyz_b) + np.cross(w, np.cross(w, xyz_b))
    mounted = imu(t, w @ R_bi, f_there @ R_bi, xyz_b=xyz_b, R_bs=R_bi)
    gyro_b, accel_b = readings_at_origin(mounted)
    np.testing.assert_allclose(gyro_b, w, atol=1e-12)
    np.testing.assert_allclose(accel_b[1:-1], f_origin[1:-1], atol=1e-3)


def test_a_silent_imu_holds_its_last_readings_and_then_keeps_going() -> None:
    t = np.concatenate([np.arange(0.0, 10.0, 0.01), np.arange(70.0, 80.0, 0.01)])
    n = len(t)
    circling = imu(
        t,
        np.tile([0.0, 0.0, 0.2], (n, 1)) + np.outer(np.sin(t), [0, 0, 0.1]),
        np.tile([0.0, 0.0, -9.80665], (n, 1)) + np.outer(np.cos(t), [0.5, 0, 0]),
    )
    strapdown = Strapdown(circling, None)
    start = replace(state(np.zeros(3), np.array([3.0, 0.0, 0.0])), t=float(t[999]))
    one, minute = strapdown.propagate(start, 10.99), strapdown.propagate(start, 69.0)
    last = circling.series.select(slice(999, 1000))
    assert isinstance(last, ImuSeries)
    turn = Rotation.from_matrix(one.state.body.R_nb).as_rotvec()
    np.testing.assert_allclose(turn, last.gyro_i[0], atol=1e-9)
    np.testing.assert_array_equal(minute.state.v_n, one.state.v_n)
    np.testing.assert_allclose(
        minute.state.p_n - one.state.p_n, one.state.v_n * 58.01, rtol=1e-9, atol=1e-6
    )
    sigma_one, sigma_minute = np.sqrt(np.diag(one.Q)), np.sqrt(np.diag(minute.Q))
    assert 0.05 < sigma_one[2] < 0.3  # heading, rad: the turn may have ended
    assert sigma_minute[2] > 0.5
    assert 0.1 < sigma_one[3] < 2.0  # m
    assert 50.0 < sigma_minute[3] < 1000.0
    assert sigma_minute[0] < np.radians(12.0)


def test_the_rate_while_no_reading_is_held_is_that_which_others_tell() -> None:
    t = np.concatenate([np.arange(0.0, 10.0, 0.01), np.arange(70.0, 80.0, 0.01)])
    turning, level = np.tile([0.0, 0.0, 0.2], (len(t), 1)), np.tile([0.0, 0.0, -9.8], (len(t), 1))
    strapdown, unheard_b = Strapdown(imu(t, turning, level), None), np.array([0.0, 0.0, -0.3])
    for t_s, expected in ((5.0, 0.2), (40.0, -0.3), (70.5, 0.2), (80.5, 0.2), (82.0, -0.3)):
        here = replace(state(np.zeros(3), np.zeros(3)), t=t_s)
        assert strapdown.rate_b(here, unheard_b)[2] == pytest.approx(expected)
