"""Vehicles of which nothing measures how they turn."""

from __future__ import annotations

from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.settings import MotionSettings

TURNING_TYPES = ("heading", "imu", "odometry")
"""Sensors that measure a heading or a rate of turn."""
TURN_S = 5.0
"""How long a vehicle keeps a rate of turn, or thereabouts."""


def measures_turns(mission: Mission) -> bool:
    """Whether a sensor measures how the vehicle turns."""
    return any(mission.first(kind) is not None for kind in TURNING_TYPES)


def unmeasured_yaw_variance_rad2_s(settings: MotionSettings) -> float:
    """Growth of the variance of a yaw that nothing measures.

    A rate of turn that walks for `TURN_S` and then begins anew turns the vehicle by
    ``q TURN_S^3 / 3`` each time, q being the density of its acceleration.
    """
    return settings.sigma_yaw_accel_rad_s2**2 * TURN_S**2 / 3.0


def warnings_on_turns(mission: Mission) -> tuple[str, ...]:
    """What a user must hear of a mission whose heading nothing tells."""
    if measures_turns(mission) or mission.first("dvl") is None:
        return ()
    return (
        "nothing measures how the vehicle turns: it has neither a heading nor an IMU nor odometry;"
        " unless fixes or scans tell it, the yaw stays that of the start and its sigma grows to"
        " that of a direction nobody knows",
    )
