"""ROS messages as sensors: one table entry a reading of a message type.

An entry says how a message becomes numbers (`Dialect.read`, one message at a time) and how the
stacked numbers become the columns of a series (`Dialect.convert`). Vectors in ROS's forward, left,
up axes (REP-103, REP-145) and poses in east, north, up are turned here and nowhere else; a dialect
whose instrument speaks in forward, starboard, down itself says so by ``turned=False``.

What a message states of its own noise counts, as far as it states any: a variance of 0 or -1 is
unknown, and so is one of 1e5 and more, which drivers write for what they do not measure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtsam_nav.frames import (
    ENU_FROM_NED,
    FLU_FROM_FRD,
    Array,
    rotation_from_quaternion,
    rpy_from_rotation,
)
from gtsam_nav.readers._ros_card import BagSensor

UNKNOWN_VARIANCE = 1e5
STANDARD_GRAVITY_M_S2 = 9.80665
NO_FIX = "no fix"
PD0_BAD_M_S = 32.0
"""PD0 writes -32.768 m/s for a velocity that it could not measure."""

Sample = dict[str, Any]
"""Numbers of one message."""

Columns = dict[str, Array]


@dataclass(frozen=True)
class Dialect:
    """One way to read messages of some types.

    Attributes
    ----------
    messages : tuple of str
        Types; the package may be left out.
    sensor : str
        Type of the sensor that they make.
    read : callable
        Numbers of a message, or the reason why it holds none.
    convert : callable
        Stacked numbers to columns of the series, with the unknown as NaN.
    default : bool
        Whether it is taken where nobody asks for it.
    turned : bool
        Whether the message's axes are ROS's, which ``convert`` turned.
    needs : str
        What a card must state for it, for the listing.
    """

    messages: tuple[str, ...]
    sensor: str
    read: Callable[[Any, BagSensor], Sample | str]
    convert: Callable[[Columns], Columns] = dict
    default: bool = True
    turned: bool = True
    needs: str = ""

    def reads(self, message_type: str) -> bool:
        """Whether messages of a type are read so."""
        package, _, name = message_type.rpartition("/msg/")
        return f"{package}/{name}" in self.messages or name in self.messages


def xyz(vector: Any) -> tuple[float, float, float]:
    """Components of a geometry_msgs Vector3 or Point."""
    return vector.x, vector.y, vector.z


def sigma_of(*variances: float) -> float:
    """Standard deviation of the largest of some variances; NaN where one is unknown."""
    if all(0.0 < v < UNKNOWN_VARIANCE for v in variances):
        return float(np.sqrt(max(variances)))
    return np.nan


def to_frd(*names: str) -> Callable[[Columns], Columns]:
    """Turn the named vectors from forward, left, up."""
    return lambda c: {k: v @ FLU_FROM_FRD if k in names else v for k, v in c.items()}


def _rpy(q_xyzw: Array) -> Array:
    """Roll, pitch and yaw in NED of bodies whose axes and world are ROS's; NaN stays NaN."""
    rpy = np.full((len(q_xyzw), 3), np.nan)
    known = np.all(np.isfinite(q_xyzw), axis=1)
    R_wb = rotation_from_quaternion(q_xyzw[known][:, [3, 0, 1, 2]])
    rpy[known] = rpy_from_rotation(ENU_FROM_NED @ R_wb @ FLU_FROM_FRD)
    return rpy


def _quaternion(q: Any) -> tuple[float, float, float, float] | str:
    """x y z w; a quaternion of zeros, or exactly one as messages are born with, tells nothing."""
    values = (q.x, q.y, q.z, q.w)
    if not any(values[:3]):
        return "orientation is not set"
    return values


# ---- sensor_msgs, nav_msgs, geometry_msgs ---------------------------------------------------


def _imu(m: Any, card: BagSensor) -> Sample | str:
    if m.angular_velocity_covariance[0] == -1 or m.linear_acceleration_covariance[0] == -1:
        return "says it has no rates or no acceleration"
    rates = xyz(m.angular_velocity)
    gyro_i = np.radians(rates) if card.gyro_unit == "deg/s" else rates
    return {"gyro_i": gyro_i, "accel_i": xyz(m.linear_acceleration)}


def _imu_orientation(m: Any, *axes: int) -> Sample | str:
    if m.orientation_covariance[0] == -1:
        return "says it has no orientation"
    q = _quaternion(m.orientation)
    if isinstance(q, str):
        return q
    return {"q": q, "sigma": sigma_of(*(m.orientation_covariance[4 * k] for k in axes))}


def _as_heading(c: Columns) -> Columns:
    return {"heading": _rpy(c["q"])[:, 2], "sigma": c["sigma"]}


def _as_attitude(c: Columns) -> Columns:
    roll, pitch, _ = _rpy(c["q"]).T
    return {"roll": roll, "pitch": pitch, "sigma": c["sigma"]}


def _fix(m: Any, _: BagSensor) -> Sample | str:
    if m.status.status < 0:
        return NO_FIX
    cov = m.position_covariance if m.position_covariance_type else np.zeros(9)
    place = {"latitude_deg": m.latitude, "longitude_deg": m.longitude, "height_m": m.altitude}
    # rows of the covariance are east, north, up
    return {**place, "sigma": tuple(sigma_of(cov[k]) for k in (4, 0, 8))}


def _field(m: Any, _: BagSensor) -> Sample | str:
    x, y, _z = xyz(m.magnetic_field)
    # of a level vehicle: y is to the left
    return {"heading": float(np.arctan2(y, x)), "sigma": np.nan}


def _pressure(m: Any, card: BagSensor) -> Sample | str:
    if m.fluid_pressure <= 0:
        return "no pressure"
    per_metre = card.water_density_kg_m3 * STANDARD_GRAVITY_M_S2
    depth_m = (m.fluid_pressure - card.surface_pressure_pa) / per_metre
    return {"depth_m": depth_m, "sigma": sigma_of(m.variance / per_metre**2)}


def _number(m: Any, card: BagSensor) -> Sample | str:
    return {"depth_m": card.scale * m.data + card.offset_m, "sigma": np.nan}


def _twist_sigma(covariance: Any, *axes: int) -> float:
    return sigma_of(*(covariance[7 * k] for k in axes))


def _odometry(m: Any, _: BagSensor) -> Sample | str:
    return _planar_twist(m.twist.twist, m.twist.covariance)


def _planar_twist(twist: Any, covariance: Any) -> Sample:
    return {
        "v_b": (twist.linear.x, twist.linear.y),
        "yaw_rate": twist.angular.z,
        "sigma_v": _twist_sigma(covariance, 0, 1),
        "sigma_yaw_rate": _twist_sigma(covariance, 5),
    }


def _as_odometry(c: Columns) -> Columns:
    # y is to the left and z up
    return {**c, "v_b": c["v_b"] * [1.0, -1.0], "yaw_rate": -c["yaw_rate"]}


UNSTATED = np.zeros(36)


def _twist_of(m: Any) -> tuple[Any, Any]:
    """Twist and covariance of any of the four messages that hold one."""
    inner = getattr(m, "twist", m)
    covariance = getattr(inner, "covariance", UNSTATED)
    return getattr(inner, "twist", inner), covariance


def _twist_odometry(m: Any, _: BagSensor) -> Sample | str:
    return _planar_twist(*_twist_of(m))


def _twist_dvl(m: Any, _: BagSensor) -> Sample | str:
    twist, covariance = _twist_of(m)
    sigma = _twist_sigma(covariance, 0, 1, 2)
    return _over_ground(xyz(twist.linear), sigma, covariance[0] != -1)


def _pose_of(m: Any) -> tuple[Any, Any]:
    """Pose and covariance of any of the messages that hold one."""
    inner = getattr(m, "pose", m)
    covariance = getattr(inner, "covariance", UNSTATED)
    return getattr(inner, "pose", inner), covariance


def _pose(m: Any, _: BagSensor) -> Sample | str:
    pose, covariance = _pose_of(m)
    q = _quaternion(pose.orientation)
    q = (0.0, 0.0, 0.0, 1.0) if isinstance(q, str) else q
    return {"p": xyz(pose.position), "q": q, "sigma": _twist_sigma(covariance, 0, 1)}


def _as_reference(c: Columns) -> Columns:
    found = {"p_n": c["p"] @ ENU_FROM_NED, "rpy": _rpy(c["q"])}
    # one that is not stated throughout says nothing
    return found if np.any(np.isnan(c["sigma"])) else {**found, "sigma": c["sigma"]}


def _as_local_fix(c: Columns) -> Columns:
    return {"p_n": c["p"] @ ENU_FROM_NED, "sigma": np.repeat(c["sigma"][:, None], 3, axis=1)}


def _pose_depth(m: Any, _: BagSensor) -> Sample | str:
    pose, covariance = _pose_of(m)
    return {"depth_m": -pose.position.z, "sigma": _twist_sigma(covariance, 2)}


def _scan(m: Any, _: BagSensor) -> Sample | str:
    ranges = np.asarray(m.ranges, float)
    seen = np.isfinite(ranges) & (ranges >= m.range_min) & (ranges < m.range_max)
    angle = m.angle_min + m.angle_increment * np.arange(len(ranges))[seen]
    x, y = ranges[seen] * np.cos(angle), ranges[seen] * np.sin(angle)
    return {"points": np.column_stack([x, y, np.zeros(len(x))])}


# ---- Doppler velocity logs --------------------------------------------------------------------


def _over_ground(
    velocity: tuple[float, float, float],
    sigma: float,
    valid: bool = True,
    altitude_m: float = np.nan,
    bottom: bool = True,
) -> Sample:
    known = bool(np.isfinite(altitude_m) and altitude_m > 0)
    return {
        "v_d": velocity,
        "sigma": sigma,
        "valid": float(valid),
        "bottom_lock": float(bottom),
        "altitude_m": altitude_m if known else np.nan,
    }


def _waterlinked(m: Any, _: BagSensor) -> Sample | str:
    """Figure of merit as sigma; altitude -1 is none."""
    sigma = m.fom if m.fom > 0 else np.nan
    return _over_ground(xyz(m.velocity), sigma, bool(m.velocity_valid), m.altitude)


def _marine_acoustic(m: Any, _: BagSensor) -> Sample | str:
    """Covariance -1 is unknown; modes are 1 bottom, 2 water; three beams make a velocity."""
    sigma = sigma_of(*(m.velocity_covar[4 * k] for k in range(3)))
    valid = m.num_good_beams >= 3
    return _over_ground(xyz(m.velocity), sigma, valid, m.altitude, m.velocity_mode != 2)


def _uuv(m: Any, _: BagSensor) -> Sample | str:
    """Covariance 0 is unknown, -1 marks an invalid velocity."""
    sigma = sigma_of(*(m.velocity_covariance[4 * k] for k in range(3)))
    valid = m.velocity_covariance[0] >= 0
    return _over_ground(xyz(m.velocity), sigma, valid, getattr(m, "altitude", np.nan))


def _pd0(m: Any, _: BagSensor) -> Sample | str:
    """Teledyne RDI's four velocities: starboard, forward, down, and the error velocity.

    The error velocity is the two beam pairs' disagreement; without it three beams stand alone and
    nothing checks them.
    """
    starboard, forward, down, error = (float(v) for v in m.velocity)
    if not np.isfinite(error):
        return "non-finite error velocity"
    valid = all(abs(v) < PD0_BAD_M_S for v in (starboard, forward, down))
    ranges = np.asarray(m.range)[np.isfinite(m.range)]
    altitude_m = float(np.mean(ranges)) if len(ranges) else np.nan
    return _over_ground((forward, starboard, down), np.nan, valid, altitude_m)


def _linkquest(m: Any, _: BagSensor) -> Sample | str:
    """Flag 1 is valid; the velocity through the water stands in where the bottom is lost."""
    own = {key.lower(): getattr(m, key) for key in type(m).__dataclass_fields__}
    bottom = own["velocityinstflag"] == 1
    velocity = own["velocityinst"] if bottom else own["watervelocityinst"]
    valid = bottom or own["watervelocityinstflag"] == 1
    x, y, z = (float(v) for v in velocity)
    return _over_ground((x, y, z), np.nan, valid, own["altitude"], bottom)


def _depth(m: Any, _: BagSensor) -> Sample | str:
    return {"depth_m": m.depth, "sigma": np.nan}


# ---- scanning sonars --------------------------------------------------------------------------


def _ping360(m: Any, card: BagSensor) -> Sample | str:
    if not len(m.intensities) or not m.range:
        return "no echoes"
    angle = m.angle if card.clockwise else -m.angle
    return {"angle": angle, "range_m": m.range, "intensity": m.intensities}


def _range_image_beam(m: Any, card: BagSensor) -> Sample | str:
    echoes = np.asarray(m.beam_data)
    if not len(echoes) or not m.max_range:
        return "no echoes"
    angle = m.angle_rad if card.clockwise else -m.angle_rad
    return {"angle": angle, "range_m": m.max_range, "intensity": np.clip(echoes, 0, 255)}


TWISTS = (
    "geometry_msgs/TwistStamped",
    "geometry_msgs/TwistWithCovarianceStamped",
)
BARE_TWISTS = ("geometry_msgs/Twist", "geometry_msgs/TwistWithCovariance")
POSES = (
    "geometry_msgs/PoseStamped",
    "geometry_msgs/PoseWithCovarianceStamped",
    "geometry_msgs/Pose",
    "geometry_msgs/PoseWithCovariance",
    "nav_msgs/Odometry",
)
DEPTHS = ("cirs_girona_cala_viuda/Depth", "Depth")

DIALECTS: tuple[Dialect, ...] = (
    Dialect(("sensor_msgs/Imu",), "imu", _imu, to_frd("gyro_i", "accel_i")),
    Dialect(("sensor_msgs/Imu",), "heading", lambda m, _: _imu_orientation(m, 2), _as_heading),
    Dialect(("sensor_msgs/Imu",), "attitude", lambda m, _: _imu_orientation(m, 0, 1), _as_attitude),
    Dialect(("sensor_msgs/NavSatFix",), "gnss", _fix),
    Dialect(("sensor_msgs/FluidPressure",), "depth", _pressure),
    Dialect(("sensor_msgs/LaserScan",), "scans", _scan),
    Dialect(
        ("sensor_msgs/MagneticField",), "heading", _field, default=False, needs="a level vehicle"
    ),
    Dialect(("nav_msgs/Odometry",), "odometry", _odometry, _as_odometry),
    Dialect(TWISTS, "odometry", _twist_odometry, _as_odometry),
    Dialect(TWISTS, "dvl", _twist_dvl, to_frd("v_d"), default=False),
    Dialect(BARE_TWISTS, "odometry", _twist_odometry, _as_odometry, default=False),
    Dialect(BARE_TWISTS, "dvl", _twist_dvl, to_frd("v_d"), default=False),
    Dialect(POSES, "reference", _pose, _as_reference, default=False),
    Dialect(POSES, "gnss", _pose, _as_local_fix, default=False),
    Dialect(POSES, "depth", _pose_depth, default=False),
    Dialect(
        ("std_msgs/Float64", "std_msgs/Float32"),
        "depth",
        _number,
        default=False,
        needs="scale and offset_m",
    ),
    Dialect(("dvl_msgs/DVL", "waterlinked_a50_ros_driver/DVL"), "dvl", _waterlinked, turned=False),
    Dialect(("marine_acoustic_msgs/Dvl",), "dvl", _marine_acoustic, turned=False),
    Dialect(("uuv_sensor_ros_plugins_msgs/DVL",), "dvl", _uuv, to_frd("v_d")),
    Dialect(("cola2_msgs/DVL", "stonefish_ros/DVL"), "dvl", _uuv, turned=False),
    Dialect(("PD0Packet",), "dvl", _pd0, turned=False),
    Dialect(("LinkquestDvl",), "dvl", _linkquest, turned=False),
    Dialect(DEPTHS, "depth", _depth),
    Dialect(("SonarEcho",), "beams", _ping360, turned=False),
    Dialect(("RangeImageBeam",), "beams", _range_image_beam, turned=False),
)
"""In the order of preference."""

NOT_READ: Mapping[str, str] = {
    "sensor_msgs/msg/PointCloud2": "clouds (not read from bags)",
}
"""Message types that could be sensors but are not read yet, and as what."""


def dialects_of(message_type: str) -> list[Dialect]:
    """All ways to read messages of a type."""
    return [dialect for dialect in DIALECTS if dialect.reads(message_type)]
