"""The joint state of vehicle and landmarks: its covariance against differences and sampling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rovers import SIGMA_BEARING_RAD, SIGMA_RANGE_M, rover

from gtsam_nav.ekf.landmark_filter import Landmark, LandmarkFilter
from gtsam_nav.ekf.planar_vehicle import PlanarVehicle
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.alignment import Alignment
from gtsam_nav.preprocess.planar_motion import PlanarMotion, planar_motion
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.sensors.landmarks import Sighting

SIGMA_P, SIGMA_YAW = 0.2, 0.1
T = np.array([0.0, 0.1, 0.3, 0.6])
NO_ERROR = Alignment(0.0, np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), georeferenced=True)


@pytest.fixture(scope="module")
def mission() -> Mission:
    return rover(duration_s=5.0)


def vehicle(mission: Mission) -> PlanarVehicle:
    motion = planar_motion(mission, MotionSettings())
    assert motion is not None
    start = Alignment(
        0.0,
        np.array([1.0, -2.0, 0.0]),
        np.full(3, SIGMA_P),
        np.array([0.0, 0.0, 0.5]),
        np.full(3, SIGMA_YAW),
        georeferenced=True,
    )
    return PlanarVehicle(mission, motion, start, T)


def slam(mission: Mission) -> LandmarkFilter:
    return LandmarkFilter(vehicle(mission), mission.sensors["landmarks"], elevation=False)


def state(filtered: LandmarkFilter) -> Array:
    assert isinstance(filtered.vehicle, PlanarVehicle)
    return np.concatenate([filtered.vehicle.x, filtered.p_n[:, :2].ravel()])


def seen(range_m: float = 3.0, bearing: float = 0.4) -> Sighting:
    return Sighting(range_m, bearing, None, SIGMA_RANGE_M, SIGMA_BEARING_RAD)


def test_the_motion_jacobian_is_that_of_the_step(mission: Mission) -> None:
    def after(change: Array) -> Array:
        moved = vehicle(mission)
        moved.correct(change)
        for _ in T[1:]:
            moved.advance(moved.P_start)
        return moved.x

    base = np.array([0.0, 0.0, 0.0, 0.02, 0.03, 0.05, 0.01, 0.04])
    A, exact = np.eye(8), vehicle(mission)
    exact.correct(base)
    for _ in T[1:]:
        A = exact.advance(exact.P_start)[0] @ A
    numeric = [(after(base + e) - after(base - e)) / 2e-5 for e in 1e-5 * np.eye(8)]
    np.testing.assert_allclose(A, np.array(numeric).T, atol=1e-6)


def test_noise_of_the_odometry_adds_up(mission: Mission) -> None:
    motion = planar_motion(mission, MotionSettings())
    assert motion is not None
    filtered = slam(mission)
    before = filtered.P.copy()
    filtered.P[:] = 0.0
    for _ in T[1:]:
        filtered.advance()
    _, _, variance = motion.at(T[[0, -1]])
    assert np.all(before[:3, :3].diagonal() > 0)
    assert filtered.P[2, 2] == pytest.approx(np.diff(variance[:, 2])[0])
    assert np.trace(filtered.P[:2, :2]) == pytest.approx(2 * np.diff(variance[:, 0])[0], rel=0.05)


def straight(length_s: float, turn_density: float) -> PlanarMotion:
    """A vehicle that odometry sends straight ahead at 1 m/s, with noise of its turns alone."""
    t = np.arange(0.0, length_s + 0.5)
    variance = np.column_stack([np.zeros((len(t), 2)), turn_density**2 * t])
    p, course = np.column_stack([t, 0 * t]), np.zeros(len(t))
    return PlanarMotion(
        t, p, course, variance, False, scale_sigma=0.0, curvature_sigma=0.0, bent_m=t
    )


def test_a_course_that_wanders_bends_the_way(mission: Mission) -> None:
    """Ahead, the position is off by second order in the course, and on average it falls short."""
    motion, start = straight(100.0, 0.015), replace(NO_ERROR, sigma_rpy=np.full(3, 0.1))
    filtered = LandmarkFilter(
        PlanarVehicle(Mission("m", {}), motion, start, motion.t),
        mission.sensors["landmarks"],
        elevation=False,
    )
    for _ in motion.t[1:]:
        filtered.advance()
    rng, n = np.random.default_rng(3), 5_000
    turns = np.hstack([0.1 * rng.normal(size=(n, 1)), 0.015 * rng.normal(size=(n, 99))])
    courses = np.cumsum(turns, axis=1)
    reached = np.column_stack([np.cos(courses).sum(axis=1), np.sin(courses).sum(axis=1)])
    assert 100.0 - reached[:, 0].mean() > 0.5
    np.testing.assert_allclose(state(filtered)[:2], reached.mean(axis=0), atol=0.2)
    spread = np.cov(reached.T)
    np.testing.assert_allclose(filtered.P[:2, :2].diagonal(), spread.diagonal(), rtol=0.1)


@pytest.mark.parametrize("turned", [-0.3, 0.3])
def test_a_drive_past_a_new_landmark_tells_no_course(mission: Mission, turned: float) -> None:
    """Whatever its sightings correct: only of the way between them they tell something."""
    motion, start = straight(20.0, 1e-4), replace(NO_ERROR, sigma_rpy=np.full(3, 0.2))
    moved = PlanarVehicle(Mission("m", {}), motion, start, motion.t)
    filtered = LandmarkFilter(moved, mission.sensors["landmarks"], elevation=False)
    filtered.P[:2, :2] = 4.0 * np.eye(2)
    buoy = np.array([10.0, 4.0])
    filtered.augment(Landmark(7), Sighting(10.0, 0.4, None, 0.5, 0.05))
    for k in range(1, 20):
        filtered.advance()
        offset = buoy - [k, 0.0]
        measured = np.array([[np.hypot(*offset), np.arctan2(offset[1], offset[0])]])
        measured[0, 1] += 0.05 * (-1) ** k + turned / 10
        filtered.update(measured, np.diag([0.5, 0.05])[None] ** 2, np.array([0]))
    assert np.sqrt(filtered.P[2, 2]) >= 0.2


def test_augmentation_keeps_all_correlations(mission: Mission) -> None:
    rng = np.random.default_rng(1)
    filtered = slam(mission)
    filtered.advance()
    P = filtered.P[:3, :3].copy()
    filtered.augment(Landmark(7), seen())
    x = state(filtered)[:3]
    # the same by sampling
    n = 200_000
    drawn = x + rng.multivariate_normal(np.zeros(3), P, n)
    range_m = 3.0 + SIGMA_RANGE_M * rng.normal(size=n)
    angle = drawn[:, 2] + 0.4 + SIGMA_BEARING_RAD * rng.normal(size=n)
    placed = drawn[:, :2] + range_m[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    sampled = np.cov(np.column_stack([drawn, placed]).T)
    own = np.r_[0:3, 8:10]
    np.testing.assert_allclose(filtered.P[np.ix_(own, own)], sampled, atol=3e-3)
    assert filtered.landmark_cov(0)[2, 2] == 0.0


def test_the_scale_of_the_ranges_is_an_error_of_all_of_them(mission: Mission) -> None:
    sensor = replace(mission.sensors["landmarks"], noise={"range_scale_sigma": 0.1})
    filtered = LandmarkFilter(vehicle(mission), sensor, elevation=False)
    n = filtered.vehicle.size
    filtered.augment(Landmark(7), seen())
    # a share by which the range is too long puts the landmark nearer by as much
    away = filtered.p_n[0] - filtered.vehicle.body.p_n
    np.testing.assert_allclose(filtered.P[n + 1 :, n], -(0.1**2) * away[:2], rtol=1e-6)
    filtered.survey(8, np.array([3.0, 0.0, 0.0]), 1e-6)
    filtered.range_scale = 0.2
    _, H = filtered._predicted(np.array([[3.0, 0.4]]), np.array([1]))
    before, _ = filtered._predicted(np.array([[3.0, 0.4]]), np.array([1]))
    filtered.range_scale += 1e-6
    after, _ = filtered._predicted(np.array([[3.0, 0.4]]), np.array([1]))
    np.testing.assert_allclose((after - before) / 1e-6, H[:, n], atol=1e-6)


def test_a_landmark_seen_again_at_once_changes_no_pose(mission: Mission) -> None:
    filtered = slam(mission)
    filtered.augment(Landmark(7), seen())
    before, P = state(filtered), filtered.P.copy()
    one = seen()
    filtered.update(one.measured[None], one.cov[None], np.array([0]))
    np.testing.assert_allclose(state(filtered), before, atol=1e-12)
    # two equal looks from one place say nothing of that place, and halve the landmark's own error
    np.testing.assert_allclose(filtered.P[:3, :3], P[:3, :3], atol=1e-12)
    assert np.trace(filtered.landmark_cov(0)) < np.trace(P[8:, 8:])


def test_the_update_is_the_least_squares_one(mission: Mission) -> None:
    filtered = slam(mission)
    filtered.survey(3, np.array([3.0, 0.5, 0.0]), 1e-2)
    before, P = state(filtered), filtered.P.copy()
    z = filtered.compare(np.zeros((1, 2)), np.zeros((1, 2, 2)), np.array([0])).residual[0, 0]
    measured, noise = z + np.array([0.03, -0.01]), np.diag([SIGMA_RANGE_M, SIGMA_BEARING_RAD]) ** 2

    def residual(x: Array) -> Array:
        offset = x[8:10] - x[:2]
        angle = np.arctan2(offset[1], offset[0]) - x[2]
        return np.array([np.hypot(*offset), wrap_angle(angle)]) - measured

    some = np.r_[0:3, 8:10]
    x, information = before.copy(), np.linalg.inv(P[np.ix_(some, some)])
    for _ in range(20):
        steps = 1e-6 * np.eye(10)
        H = np.array([(residual(x + e) - residual(x - e)) / 2e-6 for e in steps]).T[:, some]
        gradient = information @ (x - before)[some] + H.T @ np.linalg.solve(noise, residual(x))
        normal = information + H.T @ np.linalg.solve(noise, H)
        x[some] -= np.linalg.solve(normal, gradient)
    filtered.update(measured[None], noise[None], np.array([0]))
    np.testing.assert_allclose(state(filtered), x, atol=1e-4)
    np.testing.assert_allclose(filtered.P[np.ix_(some, some)], np.linalg.inv(normal), atol=3e-4)


def test_covariances_stay_symmetric_and_positive(mission: Mission) -> None:
    rng = np.random.default_rng(0)
    filtered = slam(mission)
    for k in range(3):
        filtered.augment(Landmark(k), seen(2.0 + k, 0.3 * k))
    for _ in range(300):
        k = int(rng.integers(3))
        one = seen(2.0 + k, 0.3 * k)
        filtered.update(one.measured[None], one.cov[None], np.array([k]))
    np.testing.assert_array_equal(filtered.P, filtered.P.T)
    assert np.linalg.eigvalsh(filtered.P)[0] > -1e-12


def test_a_removed_landmark_leaves_the_rest_as_it_was(mission: Mission) -> None:
    filtered = slam(mission)
    for k in range(3):
        filtered.augment(Landmark(k), seen(2.0 + k, 0.3 * k))
    x, P = state(filtered), filtered.P.copy()
    filtered.remove(1)
    rest = np.r_[0:10, 12:14]
    np.testing.assert_array_equal(state(filtered), x[rest])
    np.testing.assert_array_equal(filtered.P, P[np.ix_(rest, rest)])
    assert [landmark.id for landmark in filtered.landmarks] == [0, 2]


def test_a_singular_innovation_changes_nothing(mission: Mission) -> None:
    filtered = slam(mission)
    filtered.P[:] = 0.0
    filtered.survey(0, np.array([3.0, 0.5, 0.0]), 0.0)
    before = state(filtered)
    with pytest.raises(np.linalg.LinAlgError):
        filtered.update(np.array([[3.0, 0.1]]), np.zeros((1, 2, 2)), np.array([0]))
    np.testing.assert_array_equal(state(filtered), before)


def test_a_landmark_at_the_sensor_tells_no_bearing(mission: Mission) -> None:
    filtered = slam(mission)
    filtered.survey(0, np.append(state(filtered)[:2], 0.0), 1e-3)
    before = filtered.P.copy()
    one = seen(0.0, 2.0)
    filtered.update(one.measured[None], one.cov[None], np.array([0]))
    assert np.all(np.isfinite(state(filtered)))
    np.testing.assert_allclose(filtered.P, before)


TIME_S = 20.0
"""In which a compass forgets its error."""


def by_compass(**sigmas: float) -> PlanarMotion:
    """A vehicle that stands, for 400 s."""
    t = np.arange(0.0, 400.0, 0.1)
    return PlanarMotion(
        t,
        np.zeros((len(t), 2)),
        np.zeros(len(t)),
        np.zeros((len(t), 3)),
        course_is_heading=True,
        scale_sigma=0.0,
        curvature_sigma=0.0,
        bent_m=np.zeros(len(t)),
        disturbance_time_s=TIME_S,
        **sigmas,
    )


def test_a_compass_that_wanders_makes_the_course_no_worse_than_itself() -> None:
    """Its error forgets itself: the turn since the start is wrong by two draws of it, not more."""
    sigma, steps = 0.03, np.arange(0.0, 300.0, 1.0)
    moving = PlanarVehicle(Mission("m", {}), by_compass(disturbance_sigma=sigma), NO_ERROR, steps)
    P = moving.P_start.copy()
    for elapsed in steps[1:]:
        A, noise = moving.advance(P)
        P = A @ P @ A.T + noise
        expected = 2 * sigma**2 * (1 - np.exp(-elapsed / TIME_S))
        assert P[2, 2] == pytest.approx(expected, rel=1e-6)
        assert P[5, 5] == pytest.approx(sigma**2, rel=1e-6)


def test_a_course_that_was_stated_has_the_noise_of_the_first_and_of_the_last_reading() -> None:
    white, stated = 0.01, replace(NO_ERROR, sigma_rpy=np.full(3, 0.02))
    motion = by_compass(white_sigma=white)
    moving = PlanarVehicle(Mission("m", {}), motion, stated, np.arange(0.0, 5.0))
    expected = pytest.approx(0.02**2 + 2 * white**2, rel=1e-6)
    assert moving.pose_cov(moving.P_start)[5, 5] == expected
