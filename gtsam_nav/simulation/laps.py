"""Two laps of a small surface vessel with a MEMS inertial unit, a compass and stand-alone GNSS.

After the GPS/INS filter with outlier rejection for surface vessels: two laps that start at
[0 0 0] and end at [0 90 0] m, inertial unit at 100 Hz, compass at 30 Hz, GNSS position and velocity
at 1 Hz. What that paper leaves open is chosen here: each lap is a circle of 80 m to starboard that
drifts 45 m east; the start is quiet for 20 s, waves come with the speed. All errors are white or
constant but for the inertial unit's slow biases, so that each sensor's stated noise is the whole
truth. A loosely coupled EKF reaches some [0.5 0.5 0.7] m RMS (published: [0.7 1.46 0.71] m).
"""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Origin
from gtsam_nav.simulation.motion import MotionSettings
from gtsam_nav.simulation.scenario import Scenario
from gtsam_nav.simulation.settings import (
    GnssSimulation,
    HeadingSimulation,
    ImuSimulation,
    SimulationSettings,
)
from gtsam_nav.simulation.world import Course, World

LAPS = 2
RADIUS_M = 40.0
EAST_PER_LAP_M = 45.0
ORIGIN = Origin(latitude_deg=43.1, longitude_deg=5.9)

SETTINGS = SimulationSettings(
    reference_rate_hz=20.0,
    motion=MotionSettings(
        speed_m_s=2.5,
        rest_s=20.0,
        ramp_s=6.0,
        depth_m=0.0,
        depth_swing_m=0.0,
        heave_m=0.05,
        sheltered_rest=True,
    ),
    # a unit of the price of the vessel's GNSS receiver
    imu=ImuSimulation(
        gyro_noise_density_rad_s_sqrt_hz=3e-4,
        accel_noise_density_m_s2_sqrt_hz=1.5e-3,
        gyro_bias_walk_rad_s2_sqrt_hz=1e-5,
        accel_bias_walk_m_s3_sqrt_hz=1e-4,
        gyro_bias_sigma_rad_s=5e-3,
        accel_bias_sigma_m_s2=0.03,
    ),
    heading=HeadingSimulation(rate_hz=30.0, sigma_deg=1.0, bias_sigma_deg=0.0, wall_peak_deg=0.0),
    # stand-alone: 1.2 m horizontally and 2.4 m vertically, velocities from the Doppler shift
    gnss=GnssSimulation(
        xyz_m=(-0.3, 0.0, -1.2),
        sigma_white_m=1.2,
        sigma_drift_m=0.0,
        sigma_velocity_m_s=0.2,
        outlier_share=0.0,
    ),
    dvl=None,
    attitude=None,
    depth=None,
    odometry=None,
    landmarks=None,
    sonar=None,
)


def laps(seed: int) -> Scenario:
    """The two laps, the same for every seed."""
    del seed
    return Scenario(World("laps", ORIGIN, _course()), SETTINGS, duration_s=240.0)


def _course() -> Course:
    """Circles that drift to the east, from the origin to 90 m east of it."""
    angle = np.linspace(0.0, 2 * np.pi * LAPS, 120 * LAPS + 1)
    north = RADIUS_M * np.sin(angle)
    east = RADIUS_M * (1 - np.cos(angle)) + EAST_PER_LAP_M * angle / (2 * np.pi)
    return Course(np.column_stack([north, east]), closed=False)
