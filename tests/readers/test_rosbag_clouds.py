"""PointCloud2 in bags: the simulated harbour's lidar there and back, and every odd message."""

from __future__ import annotations

import pickle
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bags import KINDS, Message, Messages, write_bag

import gtsam_nav as gn
from gtsam_nav.errors import DataError
from gtsam_nav.frames import FLU_FROM_FRD, rpy_from_rotation
from gtsam_nav.mission import Mission
from gtsam_nav.readers import describe, open_mission
from gtsam_nav.readers._ros_clouds import BagCloud
from gtsam_nav.readers.clouds import load
from gtsam_nav.series import Cloud, CloudSeries
from gtsam_nav.simulation import simulate
from gtsam_nav.writers.mission_folder import write_mission

NAME = "sensor_msgs/msg/PointCloud2"
TOPIC = "/lidar/points"
FLOAT32, UINT32 = 7, 6
CLOUD = Cloud(np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), np.array([0.0, 0.1]))


@pytest.fixture(scope="module")
def harbour() -> Mission:
    return simulate("harbour", seed=1, duration_s=2.0)


def series_of(mission: Mission, name: str = "clouds") -> CloudSeries:
    series = mission.sensors[name].series
    assert isinstance(series, CloudSeries)
    return series


def message(
    m: Messages,
    t: float | None,
    cloud: Cloud,
    *,
    big: bool = False,
    names: tuple[str, ...] = ("x", "y", "z", "t"),
    datatype: int = FLOAT32,
    lost: int = 0,
    frame: str = "lidar",
) -> Any:
    """A cloud (forward, starboard, down) as a lidar's driver says it, after some lost rays."""
    n = lost + len(cloud)
    order = ">" if big else "<"
    kinds = [{FLOAT32: "f4", 5: "i4"}[datatype]] * 3 + ["u4"]
    records = np.zeros(n, np.dtype([(k, order + f) for k, f in zip("xyzt", kinds, strict=True)]))
    for axis, column in zip("xyz", (cloud.points_s @ FLU_FROM_FRD).T, strict=True):
        if datatype == FLOAT32:
            records[axis][:lost] = np.nan
        records[axis][lost:] = column
    if cloud.offset_s is not None:
        records["t"][lost:] = np.round(cloud.offset_s * 1e9)
    told = [(name, "xyzt".index(name)) for name in names]
    fields = [
        m.make(
            "sensor_msgs/msg/PointField",
            name=name,
            offset=4 * k,
            datatype=UINT32 if name == "t" else datatype,
            count=1,
        )
        for name, k in told
    ]
    return m.make(
        NAME,
        header=m.header(t, frame),
        height=1,
        width=n,
        fields=fields,
        is_bigendian=big,
        point_step=16,
        row_step=16 * n,
        data=np.frombuffer(records.tobytes(), np.uint8),
        is_dense=not lost,
    )


def sweeps(mission: Mission, kind: str) -> Iterator[Message]:
    """The lidar's clouds 20 ms after their stamps, with its mounting; every other big-endian."""
    m = Messages(kind)
    lidar = mission.sensors["lidar"]
    R_bs = FLU_FROM_FRD @ lidar.R_bs @ FLU_FROM_FRD
    yield m.static_transform(
        "base_link", "lidar", FLU_FROM_FRD @ lidar.xyz_b, rpy_from_rotation(R_bs)
    )
    series = series_of(mission, "lidar")
    for k, (t, source) in enumerate(zip(series.t.tolist(), series.clouds, strict=True)):
        made = message(m, t, load(source), big=k % 2 == 1, lost=k)
        yield TOPIC, NAME, t + 0.02, made


def bag_of(folder: Path, messages: list[Message], kind: str = "ros1") -> Path:
    return write_bag(folder / "bag", kind, messages)


@pytest.mark.parametrize("kind", KINDS)
def test_sweeps_come_back_from_a_bag_and_from_the_folder_made_of_it(
    tmp_path: Path, harbour: Mission, kind: str
) -> None:
    read = open_mission(bag_of(tmp_path, list(sweeps(harbour, kind)), kind))
    assert list(read.sensors) == ["clouds"]
    assert not any("static transform" in w for w in read.warnings)
    write_mission(read, tmp_path / "folder")
    copied = open_mission(tmp_path / "folder")
    lidar = harbour.sensors["lidar"]
    written = series_of(harbour, "lidar")
    for mission in (read, copied):
        sensor = mission.sensors["clouds"]
        np.testing.assert_allclose(sensor.xyz_b, lidar.xyz_b, atol=1e-12)
        np.testing.assert_allclose(sensor.R_bs, lidar.R_bs, atol=1e-12)
        np.testing.assert_allclose(sensor.series.t, written.t - written.t[0], atol=1e-8)
        for found, expected in zip(series_of(mission).clouds, written.clouds, strict=True):
            cloud, original = load(found), load(expected)
            # messages hold float32 and nanoseconds
            np.testing.assert_array_equal(cloud.points_s, original.points_s.astype(np.float32))
            assert cloud.offset_s is not None
            assert original.offset_s is not None
            np.testing.assert_allclose(cloud.offset_s, original.offset_s, atol=1e-9)


def test_a_cloud_in_ros_axes_is_turned(tmp_path: Path) -> None:
    m = Messages("ros1")
    made = message(m, 1.0, Cloud(np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]) @ FLU_FROM_FRD))
    read = open_mission(bag_of(tmp_path, [(TOPIC, NAME, 1.0, made)]))
    np.testing.assert_array_equal(
        load(series_of(read).clouds[0]).points_s, np.diag([1.0, -1.0, -1.0])
    )


@pytest.mark.slow
def test_clouds_stay_in_the_bag_and_go_to_other_processes(tmp_path: Path, harbour: Mission) -> None:
    read = open_mission(bag_of(tmp_path, list(sweeps(harbour, "sqlite3")), "sqlite3"))
    series = series_of(read)
    assert all(isinstance(source, BagCloud) for source in series.clouds)
    assert len(pickle.dumps(series)) < 10_000
    copies = pickle.loads(pickle.dumps(series)).clouds
    # backwards: each is found wherever the one before it was
    for source, copy in zip(reversed(series.clouds), reversed(copies), strict=True):
        np.testing.assert_array_equal(load(copy).points_s, load(source).points_s)


@pytest.mark.parametrize("kind", KINDS)
def test_messages_logged_at_the_same_time_are_told_apart(tmp_path: Path, kind: str) -> None:
    m = Messages(kind)
    clouds = [Cloud(np.full((3, 3), float(k))) for k in range(3)]
    messages = [(TOPIC, NAME, 5.0, message(m, 0.1 * k, c)) for k, c in enumerate(clouds)]
    read = series_of(open_mission(bag_of(tmp_path, messages, kind)))
    found = [load(source).points_s[0, 0] for source in read.clouds]
    np.testing.assert_allclose(found, [0, 1, 2])


def test_inspect_prints_a_card_and_the_log_time_may_count(tmp_path: Path) -> None:
    m = Messages("mcap")
    messages = [
        (TOPIC, NAME, 0.1 * k + 0.01 * (k % 3), message(m, 0.1 * k, CLOUD)) for k in range(9)
    ]
    path = bag_of(tmp_path, messages, "mcap")
    contents = describe(path)
    assert contents is not None
    assert contents.streams[0].could_be == ("clouds",)
    printed = yaml.safe_load(contents.card)
    entry = printed["mission"]["sensors"]["clouds"]
    assert entry["topic"] == TOPIC
    assert entry["stamp"] == "header"
    # nothing says where the lidar sits
    assert entry["xyz_m"] == [0.0, 0.0, 0.0]
    entry |= {"stamp": "log", "xyz_m": [1.0, 2.0, 3.0]}
    (tmp_path / "card.yaml").write_text(yaml.safe_dump(printed))
    sensor = open_mission(path, card=tmp_path / "card.yaml").sensors["clouds"]
    np.testing.assert_allclose(sensor.series.t, [t for _, _, t, _ in messages], atol=1e-6)
    np.testing.assert_array_equal(sensor.xyz_b, [1, 2, 3])


@pytest.mark.parametrize(
    ("odd", "complaint"),
    [
        ({"names": ("x", "y", "t")}, "2 x PointCloud2 without z; its fields are: x, y, t"),
        ({"datatype": 5}, "field 'x' has datatype 5.*float32"),
    ],
)
def test_odd_fields_are_named(tmp_path: Path, odd: dict[str, Any], complaint: str) -> None:
    m = Messages("ros1")
    messages: list[Message] = [(TOPIC, NAME, t, message(m, t, CLOUD, **odd)) for t in (0.0, 0.1)]
    with pytest.raises(DataError, match=complaint):
        open_mission(bag_of(tmp_path, messages))
    others: list[Message] = [("/imu", "sensor_msgs/msg/Imu", 0.0, m.imu(0.1 * k)) for k in range(9)]
    (tmp_path / "two").mkdir()
    read = open_mission(bag_of(tmp_path / "two", messages + others))
    assert list(read.sensors) == ["imu"]
    assert any("'clouds' is left out" in w and TOPIC in w for w in read.warnings)


def test_clouds_without_a_finite_point_are_counted(tmp_path: Path) -> None:
    m = Messages("ros1")
    lost = Cloud(np.empty((0, 3)))
    messages = [
        (TOPIC, NAME, 0.1 * k, message(m, 0.1 * k, lost if k == 3 else CLOUD, lost=2))
        for k in range(6)
    ]
    read = open_mission(bag_of(tmp_path, messages))
    assert Counter(r.reason for r in read.rejections) == {"no finite point": 1}
    np.testing.assert_array_equal(series_of(read).row, [0, 1, 2, 4, 5])
    assert [len(load(source)) for source in series_of(read).clouds] == [2] * 5


def test_a_cloud_that_is_gone(tmp_path: Path) -> None:
    path = bag_of(tmp_path, [(TOPIC, NAME, 0.0, message(Messages("ros1"), 0.0, CLOUD))])
    for place in (BagCloud(path, TOPIC, 0.5, 0), BagCloud(path, "/other", 0.0, 0)):
        with pytest.raises(DataError, match="is gone"):
            place.read()
    assert len(BagCloud(path, TOPIC, 0.0, 0).read()) == 2


@pytest.mark.slow
def test_cloud_odometry_from_a_bag_is_that_from_memory(tmp_path: Path, harbour: Mission) -> None:
    lidar = harbour.sensors["lidar"]
    alone = Mission("alone", {"clouds": lidar})
    read = open_mission(bag_of(tmp_path, list(sweeps(harbour, "mcap")), "mcap"))
    from_bag, from_memory = (gn.estimate(m, "kiss").trajectory for m in (read, alone))
    np.testing.assert_allclose(from_bag.p_n, from_memory.p_n, atol=1e-4)
