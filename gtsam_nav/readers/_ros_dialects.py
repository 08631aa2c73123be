"""ROS messages as sensors: one table entry a reading of a message type.

An entry says how a message becomes numbers (`Dialect.read`, one message at a time) and how the
stacked numbers become the columns of a series (`Dialect.convert`). Vectors in ROS's forward, left,
up axes (REP-103, REP-145) and poses in east, north, up are turned here and nowhere else; a dialect
whose instrument speaks in forward, starboard, down itself says so by ``turned=False``.

What a message states of its own noise counts, as far as it states any.
"""

from __future__ import annotations

from collections.abc import Callable
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
from gtsam_nav.readers import _ros_marine as marine
from gtsam_nav.readers import _ros_messages as messages
from gtsam_nav.readers._ros_card import BagSensor
from gtsam_nav.readers._ros_messages import Sample

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
        What it takes, for the listing.
    keys : tuple of str
        What a card must state for it.
    """

    messages: tuple[str, ...]
    sensor: str
    read: Callable[[Any, BagSensor], Sample | str]
    convert: Callable[[Columns], Columns] = dict
    default: bool = True
    turned: bool = True
    needs: str = ""
    keys: tuple[str, ...] = ()

    def reads(self, message_type: str) -> bool:
        """Whether messages of a type are read so."""
        package, _, name = message_type.rpartition("/msg/")
        return f"{package}/{name}" in self.messages or name in self.messages


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


def _as_heading(c: Columns) -> Columns:
    return {"heading": _rpy(c["q"])[:, 2], "sigma": c["sigma"]}


def _as_attitude(c: Columns) -> Columns:
    roll, pitch, _ = _rpy(c["q"]).T
    return {"roll": roll, "pitch": pitch, "sigma": c["sigma"]}


def _as_odometry(c: Columns) -> Columns:
    # y is to the left and z up
    return {**c, "v_b": c["v_b"] * [1.0, -1.0], "yaw_rate": -c["yaw_rate"]}


def _as_reference(c: Columns) -> Columns:
    found = {"p_n": c["p"] @ ENU_FROM_NED}
    # what messages are born with, throughout, is an orientation that nobody set
    if np.any(np.nan_to_num(c["q"][:, :3])):
        found["rpy"] = _rpy(c["q"])
    # one that is not stated throughout says nothing
    return found if np.any(np.isnan(c["sigma"])) else {**found, "sigma": c["sigma"]}


def _as_local_fix(c: Columns) -> Columns:
    return {"p_n": c["p"] @ ENU_FROM_NED, "sigma": np.repeat(c["sigma"][:, None], 3, axis=1)}


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
    Dialect(("sensor_msgs/Imu",), "imu", messages.imu, to_frd("gyro_i", "accel_i")),
    Dialect(("sensor_msgs/Imu",), "heading", messages.imu_heading, _as_heading),
    Dialect(
        ("sensor_msgs/Imu",),
        "attitude",
        messages.imu_attitude,
        _as_attitude,
    ),
    Dialect(("sensor_msgs/NavSatFix",), "gnss", messages.fix),
    Dialect(("sensor_msgs/FluidPressure",), "depth", messages.pressure),
    Dialect(("sensor_msgs/LaserScan",), "scans", messages.scan),
    Dialect(("sensor_msgs/PointCloud2",), "clouds", messages.points, to_frd("points_s")),
    Dialect(
        ("sensor_msgs/MagneticField",),
        "heading",
        messages.field,
        default=False,
        needs="a level vehicle",
    ),
    Dialect(("nav_msgs/Odometry",), "odometry", messages.odometry, _as_odometry),
    Dialect(TWISTS, "odometry", messages.twist_odometry, _as_odometry),
    Dialect(TWISTS, "dvl", messages.twist_dvl, to_frd("v_d"), default=False),
    Dialect(BARE_TWISTS, "odometry", messages.twist_odometry, _as_odometry, default=False),
    Dialect(BARE_TWISTS, "dvl", messages.twist_dvl, to_frd("v_d"), default=False),
    Dialect(POSES, "reference", messages.pose, _as_reference, default=False),
    Dialect(POSES, "gnss", messages.pose, _as_local_fix, default=False),
    Dialect(POSES, "depth", messages.pose_depth, default=False),
    Dialect(
        ("std_msgs/Float64", "std_msgs/Float32"),
        "depth",
        messages.number,
        default=False,
        needs="scale and offset_m",
        keys=("scale", "offset_m"),
    ),
    Dialect(
        ("dvl_msgs/DVL", "waterlinked_a50_ros_driver/DVL"), "dvl", marine.waterlinked, turned=False
    ),
    Dialect(("marine_acoustic_msgs/Dvl",), "dvl", marine.marine_acoustic, turned=False),
    Dialect(("uuv_sensor_ros_plugins_msgs/DVL",), "dvl", marine.uuv, to_frd("v_d")),
    Dialect(("cola2_msgs/DVL", "stonefish_ros/DVL"), "dvl", marine.uuv, turned=False),
    Dialect(("PD0Packet",), "dvl", marine.pd0, turned=False),
    Dialect(("LinkquestDvl",), "dvl", marine.linkquest, turned=False),
    Dialect(DEPTHS, "depth", marine.depth),
    Dialect(("SonarEcho",), "beams", marine.ping360, turned=False),
    Dialect(("RangeImageBeam",), "beams", marine.range_image_beam, turned=False),
)
"""In the order of preference."""


def dialects_of(message_type: str) -> list[Dialect]:
    """All ways to read messages of a type."""
    return [dialect for dialect in DIALECTS if dialect.reads(message_type)]
