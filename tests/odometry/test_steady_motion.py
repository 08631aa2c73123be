"""A motion that goes on: along a circle, not its chord."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra.numpy import arrays
from hypothesis.strategies import floats
from scipy.spatial.transform import Rotation

from gtsam_nav.odometry.steady_motion import AT_REST, SteadyMotion, Wake
from gtsam_nav.registration.open3d_icp import homogeneous


def on_circle(t: float, radius_m: float = 5.0, rate_rad_s: float = 0.3) -> np.ndarray:
    """Pose of what drives ahead and turns to starboard for a time, in where it began."""
    turn = rate_rad_s * t
    R = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    return homogeneous(R, radius_m * np.array([np.sin(turn), 1 - np.cos(turn), 0.0]))


def test_it_stays_on_its_circle() -> None:
    motion = SteadyMotion.through(on_circle(0.2), 0.2)
    for t in (0.0, 0.05, 0.2, 3.0):
        np.testing.assert_allclose(motion.over(t), on_circle(t), atol=1e-9)


@settings(max_examples=50, deadline=None)
@given(
    turn=arrays(float, 3, elements=floats(-1.8, 1.8)),
    shift=arrays(float, 3, elements=floats(-9.0, 9.0)),
    share=floats(0.0, 1.0),
)
def test_the_parts_of_a_motion_make_the_whole(
    turn: np.ndarray, shift: np.ndarray, share: float
) -> None:
    there = homogeneous(Rotation.from_rotvec(turn).as_matrix(), shift)
    motion = SteadyMotion.through(there, 0.2)
    np.testing.assert_allclose(motion.over(0.2), there, atol=1e-9)
    parts = motion.over(0.2 * share) @ motion.over(0.2 * (1 - share))
    np.testing.assert_allclose(parts, there, atol=1e-9)


def test_a_motion_is_the_same_whatever_numpy_draws() -> None:
    rng = np.random.default_rng(0)
    for _ in range(100):
        turn = Rotation.from_rotvec(rng.normal(0, 0.02, 3)).as_matrix()
        there = homogeneous(turn, rng.normal(0, 0.3, 3))
        found = set()
        for seed in range(10):
            np.random.seed(seed)  # noqa: NPY002  the legacy generator is the one scipy draws from
            found.add(SteadyMotion.through(there, 0.1).over(0.1).tobytes())
        assert len(found) == 1


def test_a_body_at_rest_stays() -> None:
    np.testing.assert_array_equal(AT_REST.over(10.0), np.eye(4))


def test_however_long_it_goes_on_it_stays_rigid() -> None:
    rounded = on_circle(0.1) + 1e-7 * np.ones((4, 4))
    T = SteadyMotion.through(rounded, 0.1).over(3600.0)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(T[3], [0.0, 0.0, 0.0, 1.0], atol=1e-12)


def speeds_by(stamps: np.ndarray) -> np.ndarray:
    """Of what moves 0.2 m from each pose to the next, as its wake tells after a few, m/s."""
    wake, found = Wake(), []
    for k, t in enumerate(stamps):
        T = homogeneous(np.eye(3), np.array([0.2 * k, 0.0, 0.0]))
        if k:
            found.append(float(wake.motion_to(t, T, 0.0).velocity[0]))
        wake.add(t, T)
    return np.array(found[3:])


@pytest.mark.parametrize("late_s", [0.08, 0.09, 0.099])
@pytest.mark.parametrize("which", [0, 1])
def test_stamps_in_pairs_tell_no_faster_motion(late_s: float, which: int) -> None:
    stamps = 0.1 * np.arange(20)
    stamps[which::2] += late_s
    speeds = speeds_by(stamps)
    assert speeds.max() < 2.5
    assert speeds.min() > 1.0


def test_jitter_of_stamps_is_not_blown_up() -> None:
    jitter = np.random.default_rng(0).uniform(-0.045, 0.045, 200)
    assert speeds_by(0.1 * np.arange(200) + jitter).max() < 4.5  # ten times without


def test_a_motion_takes_as_long_as_its_sweep() -> None:
    wake = Wake()
    wake.add(0.0, np.eye(4))
    there = homogeneous(np.eye(3), np.array([0.2, 0.0, 0.0]))
    assert wake.motion_to(0.001, there, 0.1).velocity[0] == pytest.approx(0.2 / 0.09)


def test_clouds_that_are_really_unevenly_apart_tell_each_motion() -> None:
    wake = Wake()
    for t in (0.0, 0.2, 0.6, 0.8, 1.2, 1.4):
        wake.add(t, on_circle(t))
    np.testing.assert_allclose(wake.motion_to(1.8, on_circle(1.8), 0.2).over(0.4), on_circle(0.4))
    assert wake.motion_to(1.6, on_circle(1.6), 0.2).span_s == pytest.approx(0.2)


def test_one_gap_is_no_pace() -> None:
    wake = Wake()
    for t in (0.0, 0.2, 0.4, 0.6, 5.0):
        wake.add(t, np.eye(4))
    assert wake.pace_s == pytest.approx(0.2)
    wake.break_off(9.0, np.eye(4))
    assert wake.pace_s == pytest.approx(4.0)
