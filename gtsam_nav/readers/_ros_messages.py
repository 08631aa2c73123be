"""The numbers in the messages of sensor_msgs, nav_msgs, geometry_msgs and std_msgs.

Each function takes a message and the card of its sensor, and gives the numbers as they stand, in
ROS's axes (`_ros_dialects` turns them), or the reason why there are none. A variance of 0 or -1 is
unknown, and so is one of 1e5 and more, which drivers write for what they do not measure.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import STANDARD_GRAVITY_M_S2
from gtsam_nav.readers._pointcloud2 import NANOSECOND_S, cloud_of_message
from gtsam_nav.readers._ros_card import BagSensor

UNKNOWN_VARIANCE = 1e5
NO_FIX = "no fix"

Sample = dict[str, Any]
"""Numbers of one message."""


def xyz(vector: Any) -> tuple[float, float, float]:
    """Components of a geometry_msgs Vector3 or Point."""
    return vector.x, vector.y, vector.z


def sigma_of(*variances: float) -> float:
    """Standard deviation of the largest of some variances; NaN where one is unknown."""
    if all(0.0 < v < UNKNOWN_VARIANCE for v in variances):
        return float(np.sqrt(max(variances)))
    return np.nan


def quaternion(q: Any) -> tuple[float, float, float, float] | str:
    """x y z w; a quaternion of zeros, or exactly one as messages are born with, tells nothing."""
    values = (q.x, q.y, q.z, q.w)
    if not any(values[:3]):
        return "orientation is not set"
    return values


def imu(m: Any, card: BagSensor) -> Sample | str:
    """Rates and specific force; a covariance that begins with -1 says that there are none."""
    if m.angular_velocity_covariance[0] == -1 or m.linear_acceleration_covariance[0] == -1:
        return "says it has no rates or no acceleration"
    return {
        "gyro_i": card.gyro_factor * np.array(xyz(m.angular_velocity)),
        "accel_i": card.accel_factor * np.array(xyz(m.linear_acceleration)),
    }


def _orientation(m: Any, *axes: int) -> Sample | str:
    if m.orientation_covariance[0] == -1:
        return "says it has no orientation"
    q = quaternion(m.orientation)
    if isinstance(q, str):
        return q
    return {"q": q, "sigma": sigma_of(*(m.orientation_covariance[4 * k] for k in axes))}


def imu_heading(m: Any, _: BagSensor) -> Sample | str:
    """Orientation, with the sigma of its yaw."""
    return _orientation(m, 2)


def imu_attitude(m: Any, _: BagSensor) -> Sample | str:
    """Orientation, with the sigma of its roll and pitch."""
    return _orientation(m, 0, 1)


def fix(m: Any, _: BagSensor) -> Sample | str:
    """Geodetic fix; the covariance is in east, north, up."""
    if m.status.status < 0:
        return NO_FIX
    cov = m.position_covariance if m.position_covariance_type else np.zeros(9)
    place = {"latitude_deg": m.latitude, "longitude_deg": m.longitude, "height_m": m.altitude}
    # rows of the covariance are east, north, up
    return {**place, "sigma": tuple(sigma_of(cov[k]) for k in (4, 0, 8))}


def field(m: Any, _: BagSensor) -> Sample | str:
    """Magnetic heading of a level vehicle."""
    x, y, _z = xyz(m.magnetic_field)
    # of a level vehicle: y is to the left
    return {"heading": float(np.arctan2(y, x)), "sigma": np.nan}


def pressure(m: Any, card: BagSensor) -> Sample | str:
    """Depth by the card's surface pressure and density."""
    if m.fluid_pressure <= 0:
        return "no pressure"
    per_metre = card.water_density_kg_m3 * STANDARD_GRAVITY_M_S2
    depth_m = (m.fluid_pressure - card.surface_pressure_pa) / per_metre
    return {"depth_m": depth_m, "sigma": sigma_of(m.variance / per_metre**2)}


def number(m: Any, card: BagSensor) -> Sample | str:
    """Depth by the card's scale and offset."""
    return {"depth_m": card.scale * m.data + card.offset_m, "sigma": np.nan}


def twist_sigma(covariance: Any, *axes: int) -> float:
    """Of some of the six axes of a covariance."""
    return sigma_of(*(covariance[7 * k] for k in axes))


def odometry(m: Any, _: BagSensor) -> Sample | str:
    """Twist of an odometry, forward and to the left."""
    return planar_twist(m.twist.twist, m.twist.covariance)


def planar_twist(twist: Any, covariance: Any) -> Sample:
    """Numbers of a planar odometry."""
    return {
        "v_b": (twist.linear.x, twist.linear.y),
        "yaw_rate": twist.angular.z,
        "sigma_v": twist_sigma(covariance, 0, 1),
        "sigma_yaw_rate": twist_sigma(covariance, 5),
    }


UNSTATED = np.zeros(36)


def twist_of(m: Any) -> tuple[Any, Any]:
    """Twist and covariance of any of the four messages that hold one."""
    inner = getattr(m, "twist", m)
    covariance = getattr(inner, "covariance", UNSTATED)
    return getattr(inner, "twist", inner), covariance


def twist_odometry(m: Any, _: BagSensor) -> Sample | str:
    """Twist as planar odometry."""
    return planar_twist(*twist_of(m))


def twist_dvl(m: Any, _: BagSensor) -> Sample | str:
    """Twist as velocity over ground; a covariance that begins with -1 marks it invalid."""
    twist, covariance = twist_of(m)
    sigma = twist_sigma(covariance, 0, 1, 2)
    return over_ground(xyz(twist.linear), sigma, covariance[0] != -1)


def pose_of(m: Any) -> tuple[Any, Any]:
    """Pose and covariance of any of the messages that hold one."""
    inner = getattr(m, "pose", m)
    covariance = getattr(inner, "covariance", UNSTATED)
    return getattr(inner, "pose", inner), covariance


def pose(m: Any, _: BagSensor) -> Sample | str:
    """Position and orientation, which of one pose may well be what messages are born with."""
    pose, covariance = pose_of(m)
    q = np.array([getattr(pose.orientation, axis) for axis in "xyzw"])
    known = q if np.any(q) else np.full(4, np.nan)
    return {"p": xyz(pose.position), "q": known, "sigma": twist_sigma(covariance, 0, 1)}


def pose_depth(m: Any, _: BagSensor) -> Sample | str:
    """Depth of a position whose z is up from the surface."""
    pose, covariance = pose_of(m)
    return {"depth_m": -pose.position.z, "sigma": twist_sigma(covariance, 2)}


def scan(m: Any, _: BagSensor) -> Sample | str:
    """Points of the rays that met something."""
    ranges = np.asarray(m.ranges, float)
    seen = np.isfinite(ranges) & (ranges >= m.range_min) & (ranges < m.range_max) & (ranges > 0)
    angle = m.angle_min + m.angle_increment * np.arange(len(ranges))[seen]
    x, y = ranges[seen] * np.cos(angle), ranges[seen] * np.sin(angle)
    return {"points": np.column_stack([x, y, np.zeros(len(x))])}


def points(m: Any, _: BagSensor) -> Sample | str:
    """Points of a cloud with their times, or what is odd about its fields."""
    stamp = m.header.stamp
    try:
        cloud = cloud_of_message(m, stamp.sec + NANOSECOND_S * stamp.nanosec)
    except DataError as error:
        return str(error)
    if not len(cloud):
        return "no finite point"
    return {"points_s": cloud.points_s, "offset_s": cloud.offset_s}


def over_ground(
    velocity: tuple[float, float, float],
    sigma: float,
    valid: bool = True,
    altitude_m: float = np.nan,
    bottom: bool = True,
) -> Sample:
    """Numbers of a DVL; an altitude that is not positive is none."""
    known = bool(np.isfinite(altitude_m) and altitude_m > 0)
    return {
        "v_d": velocity,
        "sigma": sigma,
        "valid": float(valid),
        "bottom_lock": float(bottom),
        "altitude_m": altitude_m if known else np.nan,
    }
