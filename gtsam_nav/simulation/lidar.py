"""A spinning lidar above the water: sweeps of points, each at its own time."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.mission import Sensor
from gtsam_nav.series import Cloud, CloudSeries
from gtsam_nav.settings import Settings
from gtsam_nav.simulation.motion import Motion
from gtsam_nav.simulation.world import World


class LidarSimulation(Settings):
    """The lidar and its faults.

    Attributes
    ----------
    rate_hz : float
        Turns a second; a sweep is stamped with its first ray.
    beams, fan_deg : int, float
        Rays that are fired at once, spread evenly over a fan about the sensor's plane.
    step_deg : float
        Turn between two firings.
    min_range_m, max_range_m : float
    sigma_range_m : float
        White noise.
    lost_share : float
        Share of echoes that do not come back.
    """

    rate_hz: float = Field(default=5.0, gt=0)
    xyz_m: tuple[float, float, float] = (0.6, 0.0, -2.6)
    rpy_deg: tuple[float, float, float] = (0.0, 2.0, 20.0)
    beams: int = Field(default=64, ge=1)
    fan_deg: float = Field(default=30.0, gt=0)
    step_deg: float = Field(default=1.5, gt=0)
    min_range_m: float = Field(default=1.5, ge=0)
    max_range_m: float = Field(default=80.0, gt=0)
    sigma_range_m: float = Field(default=0.02, gt=0)
    lost_share: float = Field(default=0.05, ge=0, lt=1)


def lidar(
    motion: Motion, world: World, duration_s: float, s: LidarSimulation, rng: np.random.Generator
) -> Sensor:
    """Sweeps of a whole turn each, while the vehicle moves on."""
    stamps = np.arange(rng.uniform(0, 1 / s.rate_hz), duration_s - 1 / s.rate_hz, 1 / s.rate_hz)
    xyz_b, R_bs = np.array(s.xyz_m), rotation_from_rpy(np.radians(s.rpy_deg))
    clouds = tuple(_sweep(motion, world, t, s, xyz_b, R_bs, rng) for t in stamps.tolist())
    return Sensor(
        name="lidar",
        type="clouds",
        series=CloudSeries(t=stamps, clouds=clouds),
        xyz_b=xyz_b,
        R_bs=R_bs,
        simulated=True,
    )


def _sweep(
    motion: Motion,
    world: World,
    stamp_s: float,
    s: LidarSimulation,
    xyz_b: Array,
    R_bs: Array,
    rng: np.random.Generator,
) -> Cloud:
    """One turn: the echoes, placed in the sensor's axes at the time of their ray."""
    from gtsam_nav.simulation._lidar_kernel import first_hits

    azimuth = np.radians(np.arange(0.0, 360.0, s.step_deg))
    offset_s = azimuth / (2 * np.pi * s.rate_hz)
    truth = motion.at(stamp_s + offset_s)
    elevation = np.radians(np.linspace(-0.5, 0.5, s.beams) * s.fan_deg)
    ray_s = _rays(azimuth, elevation)
    ray_n = np.einsum("aij,abj->abi", truth.R_nb @ R_bs, ray_s)
    origin_n = truth.p_n + truth.R_nb @ xyz_b
    heights = np.repeat(
        [w.height_m for w in world.walls], [len(w.corners_n) - 1 for w in world.walls]
    )
    range_m = first_hits(
        np.repeat(origin_n, s.beams, axis=0),
        ray_n.reshape(-1, 3),
        world.segments_n,
        heights.astype(float),
        world.posts_n,
        world.pile_radius_m,
        world.pile_height_m,
        world.basin_n,
        world.ground_m,
    )
    measured = range_m + rng.normal(scale=s.sigma_range_m, size=len(range_m))
    seen = (range_m > s.min_range_m) & (range_m < s.max_range_m)
    seen &= rng.uniform(size=len(range_m)) >= s.lost_share
    points_s = measured[seen, None] * ray_s.reshape(-1, 3)[seen]
    offsets = np.repeat(offset_s, s.beams)[seen]
    return Cloud(points_s.astype(np.float32), offsets.astype(np.float32))


def _rays(azimuth: Array, elevation: Array) -> Array:
    """Unit rays in the sensor's axes, clockwise from forward and up, shape (a, b, 3)."""
    a, e = azimuth[:, None], elevation[None]
    return np.stack([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), -np.sin(e) + 0 * a], axis=-1)
