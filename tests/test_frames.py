"""Rotations, angles, geodesy and gravity."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gtsam_nav.frames import (
    EARTH_RATE_RAD_S,
    ENU_FROM_NED,
    FLU_FROM_FRD,
    Array,
    Origin,
    earth_rate_n,
    geodetic_from_ned,
    gravity_m_s2,
    ned_from_geodetic,
    quaternion_from_rotation,
    quaternion_from_rpy,
    rotation_from_quaternion,
    rotation_from_rpy,
    rpy_from_quaternion,
    rpy_from_rotation,
    skew,
    slerp,
    wrap_angle,
    yaw_from_quaternion,
)

ANGLES = st.floats(-np.pi, np.pi)
RPY = st.tuples(ANGLES, st.floats(-np.pi / 2, np.pi / 2), ANGLES).map(np.array)
VECTORS = st.tuples(*[st.floats(-1e3, 1e3)] * 3).map(np.array)
ORIGINS = st.builds(
    Origin, st.floats(-89.0, 89.0), st.floats(-179.0, 179.0), st.floats(-100.0, 1000.0)
)


@given(RPY)
def test_rotations_are_orthonormal(rpy: Array) -> None:
    R = rotation_from_rpy(rpy)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(R) == pytest.approx(1.0)


@given(RPY)
def test_a_rotation_survives_its_angles(rpy: Array) -> None:
    R = rotation_from_rpy(rpy)
    np.testing.assert_allclose(rotation_from_rpy(rpy_from_rotation(R)), R, atol=1e-14)


@given(st.tuples(ANGLES, st.floats(-1.5, 1.5), ANGLES).map(np.array))
def test_angles_survive_their_rotation(rpy: Array) -> None:
    back = rpy_from_rotation(rotation_from_rpy(rpy))
    np.testing.assert_allclose(wrap_angle(back - rpy), 0.0, atol=1e-13)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
@given(roll=ANGLES, yaw=ANGLES)
def test_a_vertical_body_keeps_its_rotation(pitch: float, roll: float, yaw: float) -> None:
    R = rotation_from_rpy([roll, pitch, yaw])
    rpy = rpy_from_rotation(R)
    assert rpy[1] == pytest.approx(pitch, abs=1e-7)
    np.testing.assert_allclose(rotation_from_rpy(rpy), R, atol=1e-14)


@pytest.mark.parametrize(
    ("rpy_deg", "v_b", "v_n"),
    [
        ((0, 0, 90), (1, 0, 0), (0, 1, 0)),  # heading east
        ((0, 90, 0), (1, 0, 0), (0, 0, -1)),  # bow up
        ((90, 0, 0), (0, 1, 0), (0, 0, 1)),  # starboard down
        ((0, 30, 90), (0, 1, 0), (-1, 0, 0)),  # yaw comes last
    ],
)
def test_each_angle_turns_as_in_the_field(rpy_deg: Any, v_b: Any, v_n: Any) -> None:
    R_nb = rotation_from_rpy(np.radians(rpy_deg))
    np.testing.assert_allclose(R_nb @ v_b, v_n, atol=1e-15)


@given(RPY)
def test_quaternions_are_unit_scalar_first_and_not_negative(rpy: Array) -> None:
    q_wxyz = quaternion_from_rpy(rpy)
    assert np.linalg.norm(q_wxyz) == pytest.approx(1.0)
    assert q_wxyz[0] >= 0.0
    assert q_wxyz[0] == pytest.approx(
        np.sqrt(max(0.0, 1 + np.trace(rotation_from_rpy(rpy)))) / 2, abs=1e-7
    )


@given(RPY, st.sampled_from([1.0, -1.0, 3.0, -0.2]))
def test_a_rotation_survives_its_quaternion(rpy: Array, scale: float) -> None:
    R = rotation_from_rpy(rpy)
    q_wxyz = scale * quaternion_from_rotation(R)
    np.testing.assert_allclose(rotation_from_quaternion(q_wxyz), R, atol=1e-14)
    np.testing.assert_allclose(rotation_from_rpy(rpy_from_quaternion(q_wxyz)), R, atol=1e-14)


@given(RPY, RPY, st.floats(0.0, 1.0), st.sampled_from([-1.0, 1.0]))
def test_the_way_between_two_attitudes_is_that_of_scipy(
    rpy_a: Array, rpy_b: Array, fraction: float, sign: float
) -> None:
    a, b = rotation_from_rpy(rpy_a), rotation_from_rpy(rpy_b)
    between = Rotation.from_matrix(a.T @ b)
    assume(between.magnitude() < np.pi - 1e-6)  # there are two ways half a turn
    wanted = a @ Rotation.from_rotvec(fraction * between.as_rotvec()).as_matrix()
    q_a, q_b = quaternion_from_rotation(a)[None], sign * quaternion_from_rotation(b)[None]
    q = slerp(q_a, q_b, [fraction])
    assert q[0, 0] >= 0.0
    np.testing.assert_allclose(np.linalg.norm(q), 1.0, atol=1e-12)
    np.testing.assert_allclose(rotation_from_quaternion(q[0]), wanted, atol=1e-9)
    np.testing.assert_allclose(np.abs(np.sum(slerp(q_a, q_a, [fraction]) * q_a)), 1.0, atol=1e-12)


@given(RPY, st.floats(0.1, 10.0))
def test_yaw_alone_is_that_of_all_three_angles(rpy: Array, scale: float) -> None:
    q = scale * quaternion_from_rpy([rpy, -rpy])
    np.testing.assert_array_equal(yaw_from_quaternion(q), rpy_from_quaternion(q)[:, 2])


def test_half_a_turn_goes_either_way_and_no_turn_goes_nowhere() -> None:
    start = quaternion_from_rpy([[0.1, 0.2, 0.3]] * 3)
    turned = quaternion_from_rpy([[0.0, 0.0, np.pi], [0.0, 0.0, 1e-9], [0.0, 0.0, 0.0]])
    level = quaternion_from_rpy(np.zeros((3, 3)))
    half = rpy_from_quaternion(slerp(level, turned, [0.5, 0.5, 0.5]))
    np.testing.assert_allclose(np.abs(half[:, 2]), [np.pi / 2, 0.5e-9, 0.0], atol=1e-15)
    for fraction in (0.0, 0.5, 1.0):
        along = slerp(start, level, [fraction] * 3)
        np.testing.assert_allclose(np.linalg.norm(along, axis=1), 1.0)
    np.testing.assert_allclose(slerp(start, level, [1.0] * 3), level, atol=1e-15)


def test_conversions_take_stacks() -> None:
    rpy = np.random.default_rng(0).uniform(-1.5, 1.5, size=(2, 5, 3))
    R, q_wxyz = rotation_from_rpy(rpy), quaternion_from_rpy(rpy)
    assert R.shape == (2, 5, 3, 3)
    assert q_wxyz.shape == (2, 5, 4)
    np.testing.assert_allclose(rotation_from_quaternion(q_wxyz), R, atol=1e-14)
    np.testing.assert_allclose(rpy_from_quaternion(q_wxyz), rpy, atol=1e-13)
    np.testing.assert_array_equal(R[1, 3], rotation_from_rpy(rpy[1, 3]))


@given(VECTORS, VECTORS)
def test_skew_is_the_cross_product(a: Array, b: Array) -> None:
    np.testing.assert_allclose(skew(a) @ b, np.cross(a, b), atol=1e-9)


@given(st.floats(-1e4, 1e4))
def test_wrapped_angles_differ_by_whole_turns(angle: float) -> None:
    wrapped = float(wrap_angle(angle))
    turns = (angle - wrapped) / (2 * np.pi)
    assert -np.pi <= wrapped <= np.pi
    assert turns == pytest.approx(round(turns), abs=1e-9)
    assert float(wrap_angle(wrapped)) == pytest.approx(wrapped, abs=1e-12)


def test_half_a_turn_wraps_to_the_lower_end() -> None:
    np.testing.assert_array_equal(wrap_angle([np.pi, -np.pi, 0.0]), [-np.pi, -np.pi, 0.0])


@pytest.mark.parametrize("swap", [ENU_FROM_NED, FLU_FROM_FRD])
def test_frame_swaps_are_rotations_and_their_own_inverse(swap: Array) -> None:
    np.testing.assert_array_equal(swap @ swap, np.eye(3))
    assert np.linalg.det(swap) == pytest.approx(1.0)


def test_enu_and_flu_are_those_of_ros() -> None:
    np.testing.assert_array_equal(ENU_FROM_NED @ [1.0, 2.0, 3.0], [2.0, 1.0, -3.0])
    np.testing.assert_array_equal(FLU_FROM_FRD @ [1.0, 2.0, 3.0], [1.0, -2.0, -3.0])
    # REP-103: yaw is zero facing east and grows counter-clockwise
    east, north = (rotation_from_rpy([0.0, 0.0, yaw]) for yaw in (np.pi / 2, 0.0))
    np.testing.assert_allclose(ENU_FROM_NED @ east @ FLU_FROM_FRD, np.eye(3), atol=1e-15)
    yaw = rpy_from_rotation(ENU_FROM_NED @ north @ FLU_FROM_FRD)[2]
    assert yaw == pytest.approx(np.pi / 2)


@given(ORIGINS, st.tuples(*[st.floats(-2e4, 2e4)] * 2, st.floats(-500, 500)).map(np.array))
def test_a_position_survives_latitude_and_longitude(origin: Origin, p_n: Array) -> None:
    back = ned_from_geodetic(*geodetic_from_ned(p_n[None], origin), origin)
    np.testing.assert_allclose(back[0], p_n, atol=1e-5)


@given(ORIGINS)
def test_a_small_move_follows_the_radii_of_curvature(origin: Origin) -> None:
    step_deg, a, e2 = 1e-4, 6378137.0, 0.0818191908425**2
    lat = np.radians(origin.latitude_deg)
    w = np.sqrt(1 - e2 * np.sin(lat) ** 2)
    meridian = a * (1 - e2) / w**3 + origin.height_m
    transverse = (a / w + origin.height_m) * np.cos(lat)
    p_n = ned_from_geodetic(
        origin.latitude_deg + np.array([step_deg, 0, 0]),
        origin.longitude_deg + np.array([0, step_deg, 0]),
        origin.height_m + np.array([0, 0, 5.0]),
        origin,
    )
    expected = np.diag([np.radians(step_deg) * meridian, np.radians(step_deg) * transverse, -5.0])
    np.testing.assert_allclose(p_n, expected, atol=2e-3)


@pytest.mark.parametrize(
    ("latitude_deg", "published"),
    [(0.0, 9.7803253359), (90.0, 9.8321849378), (-90.0, 9.8321849378), (45.0, 9.806199)],
)
def test_gravity_is_that_of_wgs84(latitude_deg: float, published: float) -> None:
    """NIMA TR8350.2; 45 degrees: Moritz, *Geodetic Reference System 1980*, within 1.5 um/s^2."""
    assert gravity_m_s2(latitude_deg) == pytest.approx(published, abs=1.5e-6)


@pytest.mark.parametrize("latitude_deg", [0.0, 42.0, 90.0])
def test_gravity_falls_with_height(latitude_deg: float) -> None:
    """Second-order free-air correction of Hackney and Featherstone (2003), in mGal."""
    h, s2 = 2000.0, np.sin(np.radians(latitude_deg)) ** 2
    drop_mgal = (0.3087691 - 0.0004398 * s2) * h - 7.2125e-8 * h**2
    fall = gravity_m_s2(latitude_deg) - gravity_m_s2(latitude_deg, h)
    assert fall == pytest.approx(drop_mgal * 1e-5, abs=2e-7)


def test_the_earth_turns_eastward() -> None:
    np.testing.assert_allclose(earth_rate_n(0.0), [EARTH_RATE_RAD_S, 0, 0])
    np.testing.assert_allclose(earth_rate_n(90.0), [0, 0, -EARTH_RATE_RAD_S], atol=1e-20)
    assert 2 * np.pi / EARTH_RATE_RAD_S == pytest.approx(86164.1, abs=0.1)  # a sidereal day


@pytest.mark.parametrize(
    ("place", "complaint"),
    [
        ((90.1, 0.0), "latitude_deg is 90.1"),
        ((float("nan"), 0.0), "latitude_deg is nan"),
        ((0.0, -180.5), "longitude_deg is -180.5"),
        ((0.0, 361.0), "longitude_deg is 361.0"),
        ((0.0, 0.0, float("inf")), "height_m is inf"),
    ],
)
def test_an_origin_lies_on_the_earth(place: tuple[float, ...], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        Origin(*place)
