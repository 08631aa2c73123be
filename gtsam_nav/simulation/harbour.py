"""A small surface vessel that goes round a harbour with a spinning lidar on its mast.

A basin of 100 m by 64 m with a recess and a jetty, quay sheds behind it, moored barges and pontoons
in it and dolphins along the way; the vessel makes a round of some 176 m at 2 m/s and meets its
own way again before the two minutes are over. Stand-alone GNSS, a MEMS inertial unit, a compass
that steel disturbs. Ground, quay and sheds are what a lidar sees; water gives no echo.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gtsam_nav.frames import Array, Origin
from gtsam_nav.simulation.lidar import LidarSimulation
from gtsam_nav.simulation.motion import MotionSettings
from gtsam_nav.simulation.scenario import Scenario
from gtsam_nav.simulation.settings import (
    GnssSimulation,
    HeadingSimulation,
    ImuSimulation,
    SimulationSettings,
)
from gtsam_nav.simulation.world import Course, Wall, World

ORIGIN = Origin(latitude_deg=41.2, longitude_deg=1.7)
LONG_SIDE_AZIMUTH_DEG = 35.0
QUAY_M, BARGE_M, PONTOON_M, SHED_M = 1.4, 3.2, 0.8, 9.0
"""Heights above the water."""

# plan coordinates, m: x along the long side, y to its right
_BASIN = (
    *((-50, -32), (-12, -32), (-12, -40), (4, -40), (4, -32), (50, -32), (50, 12), (58, 12)),
    *((58, 24), (50, 24), (50, 32), (20, 32), (20, 22), (16, 22), (16, 32), (-50, 32)),
)
_BARGES = ((-30, -27, 14, 4.5), (30, -27.5, 10, 4), (-22, 28, 16, 5), (44.5, -6, 4, 12))
"""Centre, length and width of what is moored alongside."""
_PONTOONS = ((-46, 6, 6, 2), (-46, -8, 6, 2), (36, 28, 2, 6))
_SHEDS = (
    *((-34, 42, 20, 8), (-8, 41, 14, 9), (32, 40, 18, 7), (62, -14, 9, 26), (66, 22, 8, 12)),
    *((-62, 10, 10, 22), (-60, -20, 8, 18), (-28, -42, 20, 9), (24, -43, 22, 9)),
)
_PILES = ((-8, 4), (0, -6), (10, 3), (-20, -1), (24, -2), (40, 8), (-40, 20), (40, -22))
_ROUND = (
    *((-30, -14), (-14, -18), (4, -19), (22, -16), (33, -6), (32, 8), (20, 15), (4, 14)),
    *((-14, 15), (-29, 13), (-37, 0)),
)

SETTINGS = SimulationSettings(
    reference_rate_hz=20.0,
    motion=MotionSettings(
        speed_m_s=2.0,
        rest_s=5.0,
        ramp_s=6.0,
        depth_m=0.0,
        depth_swing_m=0.0,
        roll_deg=1.5,
        pitch_deg=0.8,
        yaw_deg=0.5,
        heave_m=0.05,
        wave_period_s=4.0,
        sheltered_rest=True,
    ),
    imu=ImuSimulation(
        gyro_noise_density_rad_s_sqrt_hz=3e-4,
        accel_noise_density_m_s2_sqrt_hz=1.5e-3,
        gyro_bias_walk_rad_s2_sqrt_hz=1e-5,
        accel_bias_walk_m_s3_sqrt_hz=1e-4,
        gyro_bias_sigma_rad_s=5e-3,
        accel_bias_sigma_m_s2=0.03,
    ),
    heading=HeadingSimulation(wall_peak_deg=0.0, drift_sigma_deg=2.0, drift_time_s=60.0),
    gnss=GnssSimulation(
        xyz_m=(-0.4, 0.0, -2.8), sigma_white_m=0.8, sigma_drift_m=0.8, outlier_share=0.0
    ),
    lidar=LidarSimulation(),
    dvl=None,
    attitude=None,
    depth=None,
    odometry=None,
    landmarks=None,
    sonar=None,
)


def harbour(seed: int) -> Scenario:
    """The harbour and its round, the same for every seed."""
    del seed
    closed = [*_BASIN, _BASIN[0]]
    boxes = [(BARGE_M, _BARGES), (PONTOON_M, _PONTOONS), (SHED_M, _SHEDS)]
    walls = [Wall(_local(closed), 0.0, QUAY_M)]
    walls += [Wall(_local(_box(*box)), 0.0, height) for height, group in boxes for box in group]
    world = World(
        name="harbour",
        origin=ORIGIN,
        course=Course(_local(_ROUND), closed=True),
        walls=tuple(walls),
        piles_n=_local(_PILES),
        pile_radius_m=0.35,
        basin_n=_local(_BASIN),
        ground_m=QUAY_M,
    )
    return Scenario(world, SETTINGS, duration_s=120.0)


def _box(x: float, y: float, length: float, width: float) -> Array:
    """Outline of a box in plan coordinates, its first corner twice."""
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    return np.asarray(np.array([x, y]) + 0.5 * signs * np.array([length, width]))


def _local(plan: ArrayLike) -> Array:
    """North and east of plan coordinates, shape (k, 2)."""
    azimuth = np.radians(LONG_SIDE_AZIMUTH_DEG)
    c, s = np.cos(azimuth), np.sin(azimuth)
    return np.asarray(np.asarray(plan, dtype=float) @ np.array([[c, s], [-s, c]]))
