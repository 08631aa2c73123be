"""Missions as ROS bags, and bags message by message: what the reader of bags must read back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from gtsam_nav.frames import (
    ENU_FROM_NED,
    FLU_FROM_FRD,
    geodetic_from_ned,
    quaternion_from_rotation,
    quaternion_from_rpy,
    rotation_from_rpy,
)
from gtsam_nav.mission import Mission
from gtsam_nav.readers._ros_definitions import DEFINITIONS
from gtsam_nav.series import (
    AttitudeSeries,
    BeamSeries,
    DepthSeries,
    DvlSeries,
    GnssSeries,
    HeadingSeries,
    ImuSeries,
    OdometrySeries,
)

ZERO_S = 1_700_000_000
KINDS = ("ros1", "sqlite3", "mcap")

Message = tuple[str, str, float, Any]
"""Topic, type, log time (s since ZERO_S), and the message."""


@cache
def typestore(kind: str) -> Typestore:
    store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
    transforms = {"tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms"}
    for name, text in {**DEFINITIONS, **transforms}.items():
        if name in store.fielddefs:
            continue
        store.register(get_types_from_msg("\n".join(map(str.strip, text.splitlines())), name))
    return store


class Messages:
    """Makes messages of one kind of bag; fields that are not given are zero."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.store = typestore(kind)

    def make(self, name: str, /, **given: Any) -> Any:
        fields = {}
        for field, (node, details) in self.store.fielddefs[name][1]:
            fields[field] = given.pop(field) if field in given else self._zero(node, details)
        assert not given, f"{name} has no field {', '.join(given)}"
        return self.store.types[name](**fields)

    def _zero(self, node: Any, details: Any) -> Any:
        kind = node.name
        if kind == "BASE":
            return "" if details[0] == "string" else (0.0 if "float" in details[0] else 0)
        if kind == "NAME":
            return self.make(details)
        (element, inner), length = details
        n = length if kind == "ARRAY" else 0
        if element.name == "BASE":
            return [""] * n if inner[0] == "string" else np.zeros(n, np.dtype(inner[0]))
        return [self.make(inner) for _ in range(n)]

    def header(self, t: float | None, frame: str = "base_link") -> Any:
        """With the stamp ZERO_S + t, or the stamp zero."""
        ns = 0 if t is None else round(t * 1e9) + ZERO_S * 10**9
        name = "builtin_interfaces/msg/Time"
        stamp = self.make(name, sec=ns // 10**9, nanosec=ns % 10**9)
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def vector(self, values: Iterable[float], name: str = "geometry_msgs/msg/Vector3") -> Any:
        x, y, z = (float(v) for v in values)
        return self.make(name, x=x, y=y, z=z)

    def quaternion(self, wxyz: Iterable[float]) -> Any:
        w, x, y, z = (float(v) for v in wxyz)
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def static_transform(
        self, parent: str, child: str, xyz: Iterable[float], rpy: Iterable[float]
    ) -> Message:
        """In ROS's axes."""
        transform = self.make(
            "geometry_msgs/msg/Transform",
            translation=self.vector(xyz),
            rotation=self.quaternion(quaternion_from_rpy(list(rpy))),
        )
        stamped = self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(0.0, parent),
            child_frame_id=child,
            transform=transform,
        )
        name = "tf2_msgs/msg/TFMessage"
        return "/tf_static", name, 0.0, self.make(name, transforms=[stamped])

    def imu(
        self,
        t: float | None,
        gyro: Any = (0, 0, 0),
        accel: Any = (0, 0, 9.81),
        wxyz: Any = None,
        sigma_tilt: float = 0.0,
        sigma_heading: float = 0.0,
        frame: str = "base_link",
    ) -> Any:
        """In ROS's axes."""
        cov = np.zeros(9)
        cov[[0, 4]], cov[8] = sigma_tilt**2, sigma_heading**2
        return self.make(
            "sensor_msgs/msg/Imu",
            header=self.header(t, frame),
            orientation=self.quaternion((1, 0, 0, 0) if wxyz is None else wxyz),
            orientation_covariance=cov,
            angular_velocity=self.vector(gyro),
            linear_acceleration=self.vector(accel),
        )


def write_bag(path: Path, kind: str, messages: Iterable[Message]) -> Path:
    """Write messages in the order of their log times; ``path`` gets the ending of the kind."""
    path = path.with_suffix(".bag") if kind == "ros1" else path
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    store = typestore(kind)
    writer: Any = (
        Writer1(path) if kind == "ros1" else Writer2(path, version=9, storage_plugin=plugin)
    )
    serialize = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
    with writer:
        connections: dict[str, Any] = {}
        for topic, name, t, message in sorted(messages, key=lambda m: m[2]):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            log_ns = round(t * 1e9) + ZERO_S * 10**9
            writer.write(connections[topic], log_ns, bytes(serialize(message, name)))
    return path


def messages_of(mission: Mission, kind: str) -> Iterator[Message]:
    """A mission's samples in ROS's words and axes.

    Heading and attitude go with the IMU's messages, whose stamps they share.
    """
    m = Messages(kind)
    sensors = SimpleNamespace(**{name: s.series for name, s in mission.sensors.items()})
    assert isinstance(sensors.imu, ImuSeries)
    assert isinstance(sensors.heading, HeadingSeries)
    assert isinstance(sensors.attitude, AttitudeSeries)
    tilt = np.column_stack([sensors.attitude.roll, sensors.attitude.pitch])
    R_nb = rotation_from_rpy(np.column_stack([tilt, sensors.heading.heading]))
    wxyz = quaternion_from_rotation(ENU_FROM_NED @ R_nb @ FLU_FROM_FRD)
    for k, t in enumerate(sensors.imu.t):
        message = m.imu(
            t,
            sensors.imu.gyro_i[k] @ FLU_FROM_FRD,
            sensors.imu.accel_i[k] @ FLU_FROM_FRD,
            wxyz[k],
            sensors.attitude.sigma[k],
            sensors.heading.sigma[k],
        )
        yield "/imu/data", "sensor_msgs/msg/Imu", t + 0.003, message
    yield from _dvl(m, sensors.dvl)
    yield from _odometry(m, sensors.odometry)
    yield from _gnss(m, sensors.gnss, mission)
    yield from _depth(m, sensors.depth)
    yield from _beams(m, sensors.sonar)


def _dvl(m: Messages, series: DvlSeries) -> Iterator[Message]:
    assert series.altitude_m is not None
    name = "marine_acoustic_msgs/msg/Dvl"
    for k, t in enumerate(series.t):
        message = m.make(
            name,
            header=m.header(t),
            velocity=m.vector(series.v_d[k]),
            velocity_covar=np.eye(3).ravel() * series.sigma[k] ** 2,
            velocity_mode=1 if series.bottom_lock[k] else 2,
            num_good_beams=4 if series.valid[k] else 1,
            altitude=float(series.altitude_m[k]),
        )
        yield "/dvl", name, t + 0.01, message


def _odometry(m: Messages, series: OdometrySeries) -> Iterator[Message]:
    name = "nav_msgs/msg/Odometry"
    for k, t in enumerate(series.t):
        x, y = series.v_b[k]
        cov = np.zeros(36)
        cov[[0, 7]], cov[35] = series.sigma_v[k] ** 2, series.sigma_yaw_rate[k] ** 2
        twist = m.make(
            "geometry_msgs/msg/Twist",
            linear=m.vector((x, -y, 0)),
            angular=m.vector((0, 0, -series.yaw_rate[k])),
        )
        stated = m.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=cov)
        yield "/odom", name, t, m.make(name, header=m.header(t, "odom"), twist=stated)


def _gnss(m: Messages, series: GnssSeries, mission: Mission) -> Iterator[Message]:
    assert mission.origin is not None
    name = "sensor_msgs/msg/NavSatFix"
    place = np.column_stack(geodetic_from_ned(series.p_n, mission.origin))
    for k, t in enumerate(series.t):
        n, e, d = series.sigma[k] ** 2
        latitude, longitude, height = (float(v) for v in place[k])
        message = m.make(
            name,
            header=m.header(t),
            latitude=latitude,
            longitude=longitude,
            altitude=height,
            position_covariance=np.diag([e, n, d]).ravel(),
            position_covariance_type=2,
        )
        yield "/fix", name, t + 0.1, message


def _depth(m: Messages, series: DepthSeries) -> Iterator[Message]:
    name = "sensor_msgs/msg/FluidPressure"
    per_metre = 1025.0 * 9.80665
    for k, t in enumerate(series.t):
        message = m.make(
            name,
            header=m.header(t),
            fluid_pressure=float(101325.0 + per_metre * series.depth_m[k]),
            variance=float((per_metre * series.sigma[k]) ** 2),
        )
        yield "/pressure", name, t, message


def _beams(m: Messages, series: BeamSeries) -> Iterator[Message]:
    name = "cirs_girona_cala_viuda/msg/RangeImageBeam"
    n_bins = series.intensity.shape[1]
    for k, t in enumerate(series.t):
        message = m.make(
            name,
            header=m.header(t),
            angle_rad=float(series.angle[k]),
            nbins=n_bins,
            max_range=round(n_bins * series.resolution_m),
            beam_data=series.intensity[k].astype(np.int32),
        )
        yield "/sonar", name, t, message
