"""Vehicles of which nothing measures how they turn."""

from __future__ import annotations

from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.settings import MotionSettings

TURNING_TYPES = {"heading": "a heading", "imu": "an IMU", "odometry": "odometry"}
"""Sensors that measure a heading or a rate of turn."""
WITHOUT_GYRO = ("dr", "scan-match", "pose-ekf")
"""Methods whose dead reckoning takes no rates from an IMU."""
TURN_S = 5.0
"""How long a vehicle keeps a rate of turn, or thereabouts."""


def unmeasured_yaw_variance_rad2_s(settings: MotionSettings) -> float:
    """Growth of the variance of a yaw that nothing measures.

    A rate of turn that walks for `TURN_S` and then begins anew turns the vehicle by
    ``q TURN_S^3 / 3`` each time, q being the density of its acceleration.
    """
    return settings.sigma_yaw_accel_rad_s2**2 * TURN_S**2 / 3.0


def warnings_on_turns(method: str, mission: Mission) -> tuple[str, ...]:
    """What a user must hear of a mission whose heading nothing tells a method."""
    used = [kind for kind in TURNING_TYPES if kind != "imu" or method not in WITHOUT_GYRO]
    if any(mission.first(kind) for kind in used) or mission.first("dvl") is None:
        return ()
    lacking = " nor ".join(TURNING_TYPES[kind] for kind in used)
    return (
        f"nothing measures how the vehicle turns: {method} finds neither {lacking}; unless fixes or"
        " scans tell it, the yaw stays that of the start and its sigma grows to that of a direction"
        " nobody knows",
    )
