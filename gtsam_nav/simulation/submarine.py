"""Half an hour of a submarine with a navigation-grade inertial unit, a depth gauge and beacons.

After the quoted inertial navigation system of a submarine, whose mean position error reaches 650 m
after 30 min. What is not quoted is chosen here: the submarine leaves a known place at rest, its
heading known from gyrocompassing, and repeats a round of about 3.4 km at 3 m/s and 60 m of depth.
The errors of the inertial unit let it drift that far (650 m over 12 seeds), three quarters of the
variance through accelerometer biases of 47 ug: levelling hides them until the vehicle turns. The
rest are gyro biases of 0.01 deg/h and a heading that is off by 0.05 deg. Beacons stand along the
round, so that one or two are in reach of the sonar nearly all the time, and half of them are met
again a lap later; it tells them apart and measures range, bearing and elevation.
"""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array, Origin
from gtsam_nav.simulation.motion import MotionSettings
from gtsam_nav.simulation.scenario import Scenario
from gtsam_nav.simulation.settings import (
    DepthSimulation,
    ImuSimulation,
    LandmarkSimulation,
    SimulationSettings,
    StartSimulation,
)
from gtsam_nav.simulation.world import Course, World

ORIGIN = Origin(latitude_deg=59.4, longitude_deg=10.5)
DEG_H = float(np.radians(1.0) / 3600)
MICRO_G_M_S2 = 9.80665e-6
HALF_AXES_M = (600.0, 480.0)
BEACONS = 8
BEACON_DEPTH_M = 80.0

SETTINGS = SimulationSettings(
    reference_rate_hz=10.0,
    motion=MotionSettings(
        speed_m_s=3.0,
        rest_s=60.0,
        ramp_s=30.0,
        depth_m=60.0,
        depth_swing_m=10.0,
        depth_period_s=600.0,
        roll_deg=0.6,
        pitch_deg=0.3,
        yaw_deg=0.2,
        heave_m=0.1,
        wave_period_s=15.0,
        sheltered_rest=True,
    ),
    start=StartSimulation(sigma_position_m=1.0, sigma_heading_deg=0.05),
    imu=ImuSimulation(
        rate_hz=50.0,
        gyro_noise_density_rad_s_sqrt_hz=0.002 * DEG_H * 60,
        accel_noise_density_m_s2_sqrt_hz=10 * MICRO_G_M_S2,
        gyro_bias_walk_rad_s2_sqrt_hz=1e-4 * DEG_H,
        accel_bias_walk_m_s3_sqrt_hz=0.1 * MICRO_G_M_S2,
        gyro_bias_sigma_rad_s=0.01 * DEG_H,
        accel_bias_sigma_m_s2=47 * MICRO_G_M_S2,
    ),
    depth=DepthSimulation(rate_hz=1.0, sigma_m=0.3),
    landmarks=LandmarkSimulation(
        rate_hz=0.2,
        max_range_m=400.0,
        sigma_range_m=1.0,
        sigma_bearing_deg=1.0,
        detection_share=0.9,
        elevation=True,
    ),
    dvl=None,
    heading=None,
    attitude=None,
    gnss=None,
    odometry=None,
    sonar=None,
)


def submarine(seed: int) -> Scenario:
    """The patrol, the same for every seed."""
    del seed
    beacon_angle = 2 * np.pi * np.arange(BEACONS) / BEACONS
    beacons_n = np.column_stack([_round(beacon_angle, 1.15), np.full(BEACONS, BEACON_DEPTH_M)])
    waypoint_angle = np.linspace(0.0, 2 * np.pi, 72, endpoint=False)
    world = World(
        name="submarine",
        origin=ORIGIN,
        course=Course(_round(waypoint_angle), closed=True),
        landmark_id=np.arange(1, BEACONS + 1),
        landmarks_n=beacons_n,
    )
    return Scenario(world, SETTINGS, duration_s=1800.0)


def _round(angle: Array, scale: float = 1.0) -> Array:
    """Points of the ellipse from the origin clockwise: north and east, shape (k, 2), m.

    ``scale`` widens it about its centre.
    """
    north, east = HALF_AXES_M
    return np.column_stack([scale * north * np.sin(angle), east - scale * east * np.cos(angle)])
