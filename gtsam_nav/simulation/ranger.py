"""A small ground robot with a cheap inertial unit and an ultrasonic ranger on a servo.

After the inertial navigation system aided by landmark SLAM: two landmarks are observed at rest, the
robot drives less than a metre, and they are observed again. The end points are those of the paper's
five runs, its x to starboard and its y ahead; seed k takes row k modulo 5 and draws the errors.
What the paper leaves open is chosen here.

The ranger: an error of up to 3 % of the range is taken for one sigma, and so is a bearing step of
1 %, of the servo's half turn: 1.8 deg. A landmark is found in nearly every sweep of 1 s, and the
servo sweeps only while the robot stands.

The inertial unit: densities of an MPU-6050's data sheet. The biases are those that calibration
before the run leaves; with its whole turn-on bias (20 deg/s) the unit is no inertial navigation
system at all. Levelled over the 3 s of rest, integration alone ends 0.10 m away (mean of 50 seeds;
published: 0.112 m).
"""

from __future__ import annotations

import numpy as np

from gtsam_nav.simulation.motion import MotionSettings
from gtsam_nav.simulation.scenario import Scenario
from gtsam_nav.simulation.settings import (
    ImuSimulation,
    LandmarkSimulation,
    SimulationSettings,
    StartSimulation,
)
from gtsam_nav.simulation.world import Course, World

END_POINTS_M = ((0.04, 0.43), (0.02, 0.54), (-0.07, 0.70), (-0.02, 0.58), (0.10, 0.69))
"""Where the published runs truly ended: x to starboard, y ahead."""

LANDMARKS_N = np.array([[1.2, -0.5, 0.0], [1.0, 0.6, 0.0]])
SERVO_TRAVEL_DEG = 180.0

SETTINGS = SimulationSettings(
    motion=MotionSettings(
        speed_m_s=0.25,
        rest_s=3.0,
        ramp_s=0.5,
        depth_m=0.0,
        depth_swing_m=0.0,
        roll_deg=0.0,
        pitch_deg=0.0,
        yaw_deg=0.0,
        heave_m=0.0,
    ),
    start=StartSimulation(sigma_position_m=1e-3, sigma_heading_deg=0.1),
    imu=ImuSimulation(
        gyro_noise_density_rad_s_sqrt_hz=8.7e-5,
        accel_noise_density_m_s2_sqrt_hz=3.9e-3,
        gyro_bias_walk_rad_s2_sqrt_hz=1e-5,
        accel_bias_walk_m_s3_sqrt_hz=1e-4,
        gyro_bias_sigma_rad_s=5e-5,
        accel_bias_sigma_m_s2=0.02,
    ),
    landmarks=LandmarkSimulation(
        rate_hz=1.0,
        max_range_m=3.0,
        sigma_range_m=3e-3,
        sigma_range_share=0.03,
        sigma_bearing_deg=0.01 * SERVO_TRAVEL_DEG,
        detection_share=0.95,
        only_at_rest=True,
    ),
    dvl=None,
    heading=None,
    attitude=None,
    depth=None,
    gnss=None,
    odometry=None,
    sonar=None,
)


def ranger(seed: int) -> Scenario:
    """The published run that a seed stands for."""
    world = World(
        name="ranger",
        origin=None,
        course=_course(*END_POINTS_M[seed % len(END_POINTS_M)]),
        landmark_id=np.arange(1, len(LANDMARKS_N) + 1),
        landmarks_n=LANDMARKS_N,
    )
    return Scenario(world, SETTINGS, duration_s=8.4)


def _course(x_m: float, y_m: float) -> Course:
    """From the origin, heading north, to a point ahead, heading north again."""
    share = np.linspace(0.0, 1.0, 41)
    sideways = share**3 * (6 * share**2 - 15 * share + 10)
    return Course(np.column_stack([y_m * share, x_m * sideways]), closed=False)
