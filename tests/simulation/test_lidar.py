"""The simulated lidar: first hits where geometry says, points at their own times."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import Array
from gtsam_nav.series import Cloud, CloudSeries
from gtsam_nav.simulation import make_scenario, simulate
from gtsam_nav.simulation._lidar_kernel import first_hits
from gtsam_nav.simulation.motion import Motion
from gtsam_nav.simulation.simulator import STREAMS

SQUARE = np.array([[-10.0, -10.0], [10.0, -10.0], [10.0, 10.0], [-10.0, 10.0]])
WALL = np.array([[[10.0, -10.0], [10.0, 10.0]]])


def hits(ray: list[float], posts: Array | None = None) -> float:
    """Range from two metres above the origin, towards a wall 1 m high with ground behind it."""
    unit = np.array(ray) / np.linalg.norm(ray)
    where = np.zeros((0, 2)) if posts is None else posts
    return float(
        first_hits(
            np.array([[0.0, 0.0, -2.0]]),
            unit[None],
            WALL,
            np.array([1.0]),
            where,
            0.5,
            3.0,
            SQUARE,
            1.0,
        )[0]
    )


@pytest.mark.parametrize(
    ("ray", "expected"),
    [
        ([10.0, 0.0, 1.5], np.hypot(10.0, 1.5)),  # the wall
        ([10.0, 0.0, 2.5], np.inf),  # the water before it
        ([20.0, 0.0, 1.0], np.hypot(20.0, 1.0)),  # the ground behind it
        ([1.0, 0.0, 0.0], np.inf),  # over everything
        ([-8.0, 0.0, 1.0], np.inf),  # no wall that way, and the water is nearer than the ground
        ([-12.0, 0.0, 1.0], np.hypot(12.0, 1.0)),
    ],
)
def test_rays_end_on_what_they_meet_first(ray: list[float], expected: float) -> None:
    assert hits(ray) == pytest.approx(expected)


def test_posts_are_round_and_end() -> None:
    post = np.array([[5.0, 0.0]])
    assert hits([1.0, 0.0, 0.0], post) == pytest.approx(4.5)
    assert hits([1.0, 0.2, 0.0], post) == np.inf
    assert hits([4.5, 0.0, -1.5], post) == np.inf


def test_points_lie_where_the_world_is() -> None:
    """Every point, placed by the vehicle's pose at its own time, is on a wall, post or ground."""
    mission = simulate("harbour", seed=4, duration_s=20.0)
    sensor, scenario = mission.sensors["lidar"], make_scenario("harbour", 4)
    stream = np.random.SeedSequence(4).spawn(len(STREAMS))[STREAMS.index("motion")]
    motion = Motion(scenario.world, scenario.settings.motion, np.random.default_rng(stream))
    assert isinstance(sensor.series, CloudSeries)
    cloud = sensor.series.clouds[-1]
    assert isinstance(cloud, Cloud)
    assert cloud.offset_s is not None
    assert 0.18 < cloud.offset_s.max() < 0.2
    truth = motion.at(sensor.series.t[-1] + cloud.offset_s)
    points_b = cloud.points_s @ sensor.R_bs.T + sensor.xyz_b
    points_n = truth.p_n + np.einsum("nij,nj->ni", truth.R_nb, points_b)
    on_ground = np.abs(points_n[:, 2] + scenario.world.ground_m) < 0.1
    upright = scenario.world.clearance(points_n[:, :2]) < 0.12
    assert np.mean(on_ground | upright) > 0.995


def test_the_same_seed_gives_the_same_clouds() -> None:
    one, other = (simulate("harbour", seed=5, duration_s=2.0).sensors["lidar"] for _ in range(2))
    assert isinstance(one.series, CloudSeries)
    assert isinstance(other.series, CloudSeries)
    for a, b in zip(one.series.clouds, other.series.clouds, strict=True):
        assert isinstance(a, Cloud)
        assert isinstance(b, Cloud)
        np.testing.assert_array_equal(a.points_s, b.points_s)
        np.testing.assert_array_equal(a.offset_s, b.offset_s)
