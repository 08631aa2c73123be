"""ROS bags: invented ones of all three kinds with every trap, and the recorded ones."""

from __future__ import annotations

import contextlib
import re
import sqlite3
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bags import KINDS, ZERO_S, Message, Messages, messages_of, write_bag
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Origin, quaternion_from_rpy, rotation_from_rpy
from gtsam_nav.methods import estimate
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.readers import describe, open_mission
from gtsam_nav.readers._ros_bag import _add_missing, _spare_types
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
    ReferenceSeries,
    ScanSeries,
    Series,
)

IMU = "sensor_msgs/msg/Imu"


def mission() -> Mission:
    """Twenty seconds with a sensor of every type that the round trip covers."""
    rng = np.random.default_rng(1)
    n = 40
    t = np.round(np.cumsum(rng.uniform(0.2, 0.8, n)), 6)
    t -= t[0]
    tilt = rng.uniform(-0.4, 0.4, (2, n))
    series: dict[str, Series] = {
        "imu": ImuSeries(t=t, gyro_i=rng.normal(size=(n, 3)), accel_i=rng.normal(size=(n, 3))),
        "heading": HeadingSeries(t=t, heading=rng.uniform(-3, 3, n), sigma=np.full(n, 0.02)),
        "attitude": AttitudeSeries(t=t, roll=tilt[0], pitch=tilt[1], sigma=np.full(n, 0.01)),
        "dvl": DvlSeries(
            t=t + 0.1,
            v_d=rng.normal(size=(n, 3)),
            sigma=rng.uniform(0.01, 0.1, n),
            valid=np.arange(n) % 5 != 3,
            bottom_lock=np.arange(n) % 4 != 2,
            altitude_m=rng.uniform(1, 20, n),
        ),
        "odometry": OdometrySeries(
            t=t + 0.2,
            v_b=rng.normal(size=(n, 2)),
            yaw_rate=rng.normal(size=n),
            sigma_v=rng.uniform(0.01, 0.1, n),
            sigma_yaw_rate=rng.uniform(0.01, 0.1, n),
        ),
        "gnss": GnssSeries(t=t, p_n=30 * rng.normal(size=(n, 3)), sigma=rng.uniform(1, 3, (n, 3))),
        "depth": DepthSeries(t=t, depth_m=rng.uniform(1, 9, n), sigma=rng.uniform(0.01, 0.1, n)),
        "sonar": BeamSeries(
            t=t,
            angle=rng.uniform(0, 6, n),
            intensity=rng.integers(0, 256, (n, 30), dtype=np.uint8),
            resolution_m=0.1,
        ),
    }
    kinds = {name: Sensor(name, one.TYPE, one) for name, one in series.items()}
    return Mission("round", kinds, origin=Origin(42.0, 3.0, 10.0))


def card(folder: Path, sensors: dict[str, Any], **others: Any) -> Path:
    path = folder / "card.yaml"
    path.write_text(yaml.safe_dump({"mission": {"sensors": sensors, **others}}))
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_a_mission_comes_back_from_a_bag(tmp_path: Path, kind: str) -> None:
    written = mission()
    path = write_bag(tmp_path / "round", kind, messages_of(written, kind))
    described = card(
        tmp_path,
        {
            "imu": {"topic": "/imu/data"},
            "heading": {"topic": "/imu/data"},
            "attitude": {"topic": "/imu/data"},
            "dvl": {},
            "odometry": {"topic": "/odom"},
            "gnss": {"topic": "/fix"},
            "depth": {"topic": "/pressure"},
            "sonar": {"type": "beams", "topic": "/sonar"},
        },
        origin={"latitude_deg": 42.0, "longitude_deg": 3.0, "height_m": 10.0},
    )
    read = open_mission(path, card=described)
    assert read.rejections == ()
    assert read.start_utc == ZERO_S
    assert read.sensors.keys() == written.sensors.keys()
    for name, sensor in written.sensors.items():
        np.testing.assert_allclose(read.sensors[name].R_bs, np.eye(3), atol=1e-12)
        series = read.sensors[name].series
        for column in series.column_specs():
            expected, found = getattr(sensor.series, column), getattr(series, column)
            assert (expected is None) == (found is None), (name, column)
            if expected is not None:
                # a metre of latitude is 1e-5 degrees, of which a double holds 1e-14
                atol = 1e-7 if column == "p_n" else 1e-8
                what = f"{name} {column}"
                np.testing.assert_allclose(found, expected, atol=atol, rtol=0, err_msg=what)


@pytest.mark.parametrize("kind", KINDS)
def test_the_printed_card_is_the_choice_without_one(tmp_path: Path, kind: str) -> None:
    path = write_bag(tmp_path / "round", kind, messages_of(mission(), kind))
    contents = describe(path)
    assert contents is not None
    (tmp_path / "printed.yaml").write_text(contents.card)
    bare, carded = open_mission(path), open_mission(path, card=tmp_path / "printed.yaml")
    assert list(bare.sensors) == list(carded.sensors)
    for name, sensor in bare.sensors.items():
        np.testing.assert_array_equal(sensor.series.t, carded.sensors[name].series.t)
        np.testing.assert_array_equal(sensor.R_bs, carded.sensors[name].R_bs)
    listed = {stream.name: stream for stream in contents.streams}
    assert listed["/imu/data"].could_be == ("imu", "heading", "attitude")
    assert "log 3.0 ms behind the header" in listed["/imu/data"].clock
    (note,) = [w for w in bare.warnings if w.startswith("without a card")]
    assert "imu from /imu/data" in note
    assert not any(w.startswith("without a card") for w in carded.warnings)


def test_several_ros1_files_are_one_bag(tmp_path: Path) -> None:
    messages = sorted(messages_of(mission(), "ros1"), key=lambda m: m[2])
    half = len(messages) // 2
    folder = tmp_path / "split"
    folder.mkdir()
    write_bag(folder / "a", "ros1", messages[:half])
    write_bag(folder / "b", "ros1", messages[half:])
    whole = write_bag(tmp_path / "whole", "ros1", messages)
    one, two = open_mission(whole), open_mission(folder)
    for name, sensor in one.sensors.items():
        np.testing.assert_array_equal(sensor.series.t, two.sensors[name].series.t)
    assert {p.name for p in two.sources} == {"a.bag", "b.bag"}


def test_bags_of_several_outings_are_several_missions(tmp_path: Path) -> None:
    m = Messages("ros1")
    later = [("/imu/data", IMU, 500.0 + 0.1 * k, m.imu(500.0 + 0.1 * k)) for k in range(30)]
    write_bag(tmp_path / "a", "ros1", still(m))
    write_bag(tmp_path / "b", "ros1", later)
    for reads in (open_mission, describe):
        with pytest.raises(DataError, match=r"holds 2 missions.*name one.*: a\.bag; b\.bag"):
            reads(tmp_path)


def still(m: Messages, topic: str = "/imu/data", n: int = 30, **given: Any) -> list[Message]:
    """An IMU at 10 Hz."""
    return [(topic, IMU, 0.1 * k, m.imu(0.1 * k, **given)) for k in range(n)]


def bag_of(folder: Path, make: Callable[[Messages], Sequence[Message]], kind: str = "ros1") -> Path:
    return write_bag(folder / "bag", kind, make(Messages(kind)))


def test_vectors_are_turned_into_forward_starboard_down(tmp_path: Path) -> None:
    wxyz = quaternion_from_rpy([0.1, -0.2, np.radians(30)])  # of a body in east, north, up
    path = bag_of(tmp_path, lambda m: still(m, gyro=(1, 2, 3), accel=(4, 5, 6), wxyz=wxyz))
    read = open_mission(path)
    imu, heading, attitude = (read.sensors[n].series for n in ("imu", "heading", "attitude"))
    assert isinstance(imu, ImuSeries)
    assert isinstance(heading, HeadingSeries)
    assert isinstance(attitude, AttitudeSeries)
    np.testing.assert_allclose(imu.gyro_i[0], [1, -2, -3])
    np.testing.assert_allclose(imu.accel_i[0], [4, -5, -6])
    np.testing.assert_allclose(np.degrees(heading.heading), 60.0)
    np.testing.assert_allclose(attitude.roll, 0.1)
    np.testing.assert_allclose(attitude.pitch, 0.2)
    # zeros in a covariance are unknown: the noise model's figure serves
    np.testing.assert_allclose(np.degrees(heading.sigma), 0.5)


def test_an_imu_without_orientation_is_no_compass(tmp_path: Path) -> None:
    read = open_mission(bag_of(tmp_path, still))
    assert list(read.sensors) == ["imu"]


def test_the_card_says_that_a_gyro_is_in_degrees(tmp_path: Path) -> None:
    path = bag_of(tmp_path, lambda m: still(m, gyro=(180, 0, 0)))
    stated = card(tmp_path, {"imu": {"topic": "/imu/data", "gyro_unit": "deg/s"}})
    series = open_mission(path, card=stated).sensors["imu"].series
    assert isinstance(series, ImuSeries)
    np.testing.assert_allclose(series.gyro_i[:, 0], np.pi)


def test_the_card_says_that_an_accelerometer_is_in_g(tmp_path: Path) -> None:
    path = bag_of(tmp_path, lambda m: still(m, accel=(0, 0, 1)))
    entry = {"topic": "/imu/data", "accel_unit": "g", "drop_repeats": True}
    read = open_mission(path, card=card(tmp_path, {"imu": entry}))
    series = read.sensors["imu"].series
    assert isinstance(series, ImuSeries)
    np.testing.assert_allclose(np.abs(series.accel_i[:, 2]), 9.80665)
    assert len(series) == 1
    assert {r.reason for r in read.rejections} == {"repeats the sample before"}


def test_the_card_says_that_a_clock_is_doubted(tmp_path: Path) -> None:
    entry = {"topic": "/imu/data", "time_offset": {"sigma_s": 0.4, "estimate": True}}
    read = open_mission(bag_of(tmp_path, still), card=card(tmp_path, {"imu": entry}))
    assert read.sensors["imu"].time_offset_sigma_s == 0.4


def truth(
    folder: Path, quaternions: Sequence[Sequence[float]], **mounting: Any
) -> tuple[Mission, ReferenceSeries]:
    """Poses (w, x, y, z) of a vehicle on its way to the north at 1 m/s, beside its IMU."""

    def make(m: Messages) -> list[Message]:
        name = "geometry_msgs/msg/PoseStamped"
        poses = [
            m.make(
                name,
                header=m.header(0.1 * k),
                pose=m.make(
                    "geometry_msgs/msg/Pose",
                    position=m.vector((0.0, 0.1 * k, 0.0), "geometry_msgs/msg/Point"),
                    orientation=m.quaternion(wxyz),
                ),
            )
            for k, wxyz in enumerate(quaternions)
        ]
        return [*still(m), *(("/truth", name, 0.1 * k, pose) for k, pose in enumerate(poses))]

    sensors = {"imu": {"topic": "/imu/data"}, "reference": {"topic": "/truth", **mounting}}
    read = open_mission(bag_of(folder, make), card=card(folder, sensors))
    series = read.sensors["reference"].series
    assert isinstance(series, ReferenceSeries)
    return read, series


BORN, UNSET = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)
NORTH = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))


@pytest.mark.parametrize("wxyz", [BORN, UNSET])
def test_truth_whose_orientation_nobody_set_has_none(
    tmp_path: Path, wxyz: tuple[float, ...]
) -> None:
    read, series = truth(tmp_path, [wxyz] * 20)
    assert len(series) == 20
    assert series.rpy is None
    assert read.rejections == ()


def test_truth_may_pass_the_orientation_that_messages_are_born_with(tmp_path: Path) -> None:
    read, series = truth(tmp_path, [BORN, NORTH, UNSET, NORTH])
    assert series.rpy is not None
    np.testing.assert_allclose(np.degrees(series.rpy[:, 2]), [90.0, 0.0, 0.0], atol=1e-9)
    assert [(r.index, r.reason) for r in read.rejections] == [(2, "non-finite rpy")]


def test_the_card_says_how_the_truth_is_mounted(tmp_path: Path) -> None:
    read, series = truth(tmp_path, [NORTH] * 4, rpy_deg=[0, 0, 30], xyz_m=[1, 0, 0])
    assert series.rpy is not None
    np.testing.assert_allclose(np.degrees(series.rpy[:, 2]), -30.0)
    np.testing.assert_allclose(read.sensors["reference"].xyz_b, [1, 0, 0])


def test_of_two_imus_the_first_is_taken_and_said(tmp_path: Path) -> None:
    path = bag_of(tmp_path, lambda m: still(m, "/imu/a") + still(m, "/imu/b"))
    (note,) = [w for w in open_mission(path).warnings if w.startswith("without a card")]
    assert "imu from /imu/a; also possible: imu: /imu/b" in note
    with pytest.raises(DataError, match="name one by topic: /imu/a, /imu/b"):
        open_mission(path, card=card(tmp_path, {"imu": {}}))


@pytest.mark.parametrize(
    ("sensors", "others", "message"),
    [
        ({"imu": {"topic": "/no"}}, {}, "no topic '/no'; the topics are: /imu/data, /tf_static"),
        ({"gnss": {"topic": "/imu/data"}}, {}, "the choices are: imu, heading, attitude"),
        ({"imu": {"topic": "/imu/data"}}, {"body_frame": "hull"}, "'hull': base_link, imu_link"),
        ({"imu": {"topc": "/imu/data"}}, {}, "unknown key 'topc'; the choices are: type, xyz_m"),
        ({}, {}, "sensors"),
    ],
)
def test_a_card_that_does_not_fit_is_told_the_choices(
    tmp_path: Path, sensors: dict[str, Any], others: dict[str, Any], message: str
) -> None:
    def make(m: Messages) -> list[Message]:
        turn = m.static_transform("base_link", "imu_link", (0, 0, 0), (0, 0, 0))
        return [turn, *still(m, frame="imu_link")]

    path = bag_of(tmp_path, make)
    with pytest.raises(DataError, match=message):
        open_mission(path, card=card(tmp_path, sensors, **others))


def test_static_transforms_are_mountings(tmp_path: Path) -> None:
    """A chain base_link - mast - imu_link, in ROS's axes; quarter turn to the left on the mast."""

    def make(m: Messages) -> list[Message]:
        return [
            m.static_transform("base_link", "mast", (1, 2, 3), (0, 0, np.pi / 2)),
            m.static_transform("mast", "imu_link", (0.5, 0, 0), (0.1, 0, 0)),
            *still(m, frame="imu_link"),
        ]

    imu = open_mission(bag_of(tmp_path, make)).sensors["imu"]
    np.testing.assert_allclose(imu.xyz_b, [1, -2.5, -3], atol=1e-12)
    expected = rotation_from_rpy([0, 0, -np.pi / 2]) @ rotation_from_rpy([0.1, 0, 0])
    np.testing.assert_allclose(imu.R_bs, expected, atol=1e-12)


def test_a_static_transform_out_of_the_world_is_refused(tmp_path: Path) -> None:
    def make(m: Messages) -> list[Message]:
        away = m.static_transform("base_link", "imu_link", (0, 0, 5e5), (0, 0, 0))
        return [away, *still(m, frame="imu_link")]

    path = bag_of(tmp_path, make)
    with pytest.raises(DataError, match=r"sensor 'imu' by the static .*500000 m is no place"):
        open_mission(path)
    stated = card(tmp_path, {"imu": {"xyz_m": [1, 2, 3]}})
    np.testing.assert_array_equal(open_mission(path, card=stated).sensors["imu"].xyz_b, [1, 2, 3])


def test_a_missing_transform_is_said_and_a_card_helps(tmp_path: Path) -> None:
    path = bag_of(tmp_path, lambda m: still(m, frame="imu_link"))
    (note,) = [w for w in open_mission(path).warnings if "static transform" in w]
    assert "imu ('imu_link')" in note
    stated = card(tmp_path, {"imu": {"xyz_m": [1, 2, 3], "rpy_deg": [0, 0, 90]}})
    read = open_mission(path, card=stated)
    np.testing.assert_array_equal(read.sensors["imu"].xyz_b, [1, 2, 3])
    assert not any("static transform" in w for w in read.warnings)


def test_headers_of_another_clock_give_way_to_the_log(tmp_path: Path) -> None:
    """An IMU on the log's clock, a DVL whose headers are of last year."""

    def make(m: Messages) -> list[Message]:
        name = "dvl_msgs/msg/DVL"
        dvl = [
            ("/dvl", name, 0.5 * k, m.make(name, header=m.header(0.5 * k - 3e7), velocity_valid=1))
            for k in range(20)
        ]
        return [*still(m, n=100), *dvl]

    path = bag_of(tmp_path, make)
    read = open_mission(path)
    np.testing.assert_allclose(read.sensors["dvl"].series.t, 0.5 * np.arange(20), atol=1e-6)
    (note,) = [w for w in read.warnings if "headers are not used" in w]
    assert "sensor 'dvl'" in note
    assert "30000000.0 s behind the header: another clock" in note


def test_headers_without_a_time_give_way_to_the_log(tmp_path: Path) -> None:
    path = bag_of(tmp_path, lambda m: [("/imu/data", IMU, 0.1 * k, m.imu(None)) for k in range(20)])
    read = open_mission(path)
    np.testing.assert_allclose(read.sensors["imu"].series.t, 0.1 * np.arange(20), atol=1e-9)
    assert any("headers hold no time" in w for w in read.warnings)


def test_a_bag_recorded_from_another_keeps_its_headers(tmp_path: Path) -> None:
    def make(m: Messages) -> list[Message]:
        return [("/imu/data", IMU, 0.1 * k, m.imu(0.1 * k - 1e6)) for k in range(20)]

    assert open_mission(bag_of(tmp_path, make)).start_utc == pytest.approx(ZERO_S - 1e6)


def read_one(folder: Path, topic: str, name: str, sensor: str, given: Any, **entry: Any) -> Sensor:
    """One sensor of a bag of ten equal messages beside a still IMU."""

    def make(m: Messages) -> list[Message]:
        fields = dict(given(m))
        stamped = "header" in dict(m.store.fielddefs[name][1])
        messages = []
        for k in range(10):
            header = {"header": m.header(0.5 * k)} if stamped else {}
            messages.append((topic, name, 0.5 * k, m.make(name, **header, **fields)))
        return [*still(m, n=50), *messages]

    path = bag_of(folder, make, "sqlite3")
    return open_mission(path, card=card(folder, {sensor: {"topic": topic, **entry}})).sensors[
        sensor
    ]


def test_dvls_keep_their_own_conventions(tmp_path: Path) -> None:
    cases: list[tuple[str, Any, list[float], float, bool]] = [
        (
            "dvl_msgs/msg/DVL",
            lambda m: {"velocity": m.vector((1, 2, 3)), "fom": 0.02, "velocity_valid": 1},
            [1, 2, 3], 0.02, True,
        ),
        (
            "marine_acoustic_msgs/msg/Dvl",
            lambda m: {
                "velocity": m.vector((1, 2, 3)),
                "velocity_covar": np.full(9, -1.0),
                "velocity_mode": 2,
                "num_good_beams": 3,
            },
            [1, 2, 3], 0.05, False,
        ),
        (
            "provider_dvl/msg/PD0Packet",
            lambda _: {"velocity": np.array([2.0, 1.0, 3.0, 0.001])},
            [1, 2, 3], 0.05, True,
        ),
        (
            "cirs_girona_cala_viuda/msg/LinkquestDvl",
            lambda _: {"watervelocityinst": np.array([1.0, 2.0, 3.0]), "watervelocityinstflag": 1},
            [1, 2, 3], 0.05, False,
        ),
        (
            "geometry_msgs/msg/TwistStamped",
            lambda m: {"twist": m.make("geometry_msgs/msg/Twist", linear=m.vector((1, -2, -3)))},
            [1, 2, 3], 0.05, True,
        ),
    ]  # fmt: skip
    for k, (name, given, v_d, sigma, bottom) in enumerate(cases):
        folder = tmp_path / str(k)
        folder.mkdir()
        series = read_one(folder, "/dvl", name, "dvl", given).series
        assert isinstance(series, DvlSeries)
        np.testing.assert_allclose(series.v_d[0], v_d, err_msg=name)
        np.testing.assert_allclose(series.sigma, sigma, rtol=1e-6, err_msg=name)
        assert np.all(series.valid)
        assert np.all(series.bottom_lock == bottom), name


def test_sonars_and_scans(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    echo = {"angle": 0.5, "range": 5, "intensities": np.arange(50, dtype=np.uint8)}
    beams = read_one(
        tmp_path / "a", "/ping", "ping360_sonar_msgs/msg/SonarEcho", "beams", lambda _: echo,
        clockwise=False,
    ).series  # fmt: skip
    assert isinstance(beams, BeamSeries)
    assert beams.resolution_m == pytest.approx(0.1)
    np.testing.assert_allclose(beams.angle, -0.5)
    np.testing.assert_array_equal(beams.intensity[0], np.arange(50))
    laser = {
        "angle_min": -np.pi / 2, "angle_increment": np.pi / 2, "range_min": 0.0, "range_max": 9.0,
        "ranges": np.array([1.0, 2.0, 9.0, np.nan, 0.0], dtype=np.float32),
    }  # fmt: skip
    scans = read_one(
        tmp_path / "b", "/scan", "sensor_msgs/msg/LaserScan", "scans", lambda _: laser,
        xyz_m=[0.5, 0, 0],
    ).series  # fmt: skip
    assert isinstance(scans, ScanSeries)
    # the first ray looks to the right
    np.testing.assert_allclose(scans.points_b[:2], [[0.5, 1.0], [2.5, 0.0]], atol=1e-6)
    np.testing.assert_array_equal(np.diff(scans.first), 2)


def test_numbers_become_depths_by_the_card(tmp_path: Path) -> None:
    depth = read_one(
        tmp_path, "/counts", "std_msgs/msg/Float64", "depth", lambda _: {"data": 177.0},
        scale=0.01, offset_m=-1.0,
    ).series  # fmt: skip
    assert isinstance(depth, DepthSeries)
    np.testing.assert_allclose(depth.depth_m, 0.77)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({}, "lacks scale and offset_m: depth = scale"),
        ({"scale": 0.01}, "lacks offset_m"),
        ({"scale": 0.01, "offset_m": 0.0, "stamp": "header"}, "have no header; .* are: log"),
    ],
)
def test_bare_numbers_are_no_metres_unless_a_card_says_so(
    tmp_path: Path, entry: dict[str, Any], said: str
) -> None:
    name = "std_msgs/msg/Float64"
    with pytest.raises(DataError, match=f"'depth': .*'/counts'.* {said}"):
        read_one(tmp_path, "/counts", name, "depth", lambda _: {"data": 177.0}, **entry)


def test_what_a_message_says_it_does_not_have_is_counted(tmp_path: Path) -> None:
    name = "sensor_msgs/msg/NavSatFix"

    def make(m: Messages) -> list[Message]:
        messages = still(m)
        for k in range(6):
            status = m.make("sensor_msgs/msg/NavSatStatus", status=-1 if k < 2 else 0)
            fields = {"latitude": 42.0 if k != 4 else np.nan, "longitude": 3.0, "altitude": 1.0}
            fix = m.make(name, header=m.header(0.5 * k), status=status, **fields)
            messages.append(("/fix", name, 0.5 * k, fix))
        return messages

    read = open_mission(bag_of(tmp_path, make))
    assert len(read.sensors["gnss"].series) == 3
    reasons = Counter(r.reason for r in read.rejections)
    assert reasons == {"no fix": 2, "non-finite p_n": 1}
    assert read.origin == Origin(42.0, 3.0, 1.0)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 0.95])
def test_a_bag_that_is_cut_off_is_an_error_with_a_remedy(
    tmp_path: Path, kind: str, share: float
) -> None:
    path = bag_of(tmp_path, lambda m: still(m, n=400), kind)
    file = path if path.is_file() else next(p for p in path.iterdir() if p.suffix != ".yaml")
    whole = file.read_bytes()
    file.write_bytes(whole[: int(share * len(whole))])
    remedy = "reindex" if share else "is empty"
    with pytest.raises(DataError, match=f"(damaged|cannot be opened).*{remedy}"):
        open_mission(path)


def test_bytes_that_are_no_bag(tmp_path: Path) -> None:
    (tmp_path / "x.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(range(256)) * 20)
    with pytest.raises(DataError, match="cannot be opened"):
        open_mission(tmp_path / "x.bag")
    (tmp_path / "x.bag").write_text("a letter to my bank")
    with pytest.raises(DataError, match=r"does not begin like one$"):
        open_mission(tmp_path / "x.bag")


def test_metadata_with_a_time_beyond_any_clock(tmp_path: Path) -> None:
    path = bag_of(tmp_path, lambda m: [*still(m)], "sqlite3")
    metadata = path / "metadata.yaml"
    key = "nanoseconds_since_epoch: "
    digits = key + "-" + "8" * 400
    metadata.write_text(re.sub(key + r"\d+", digits, metadata.read_text()))
    with pytest.raises(DataError, match="cannot be opened: its start or duration is no time"):
        open_mission(path)


@pytest.mark.parametrize("column", ["timestamp", "data"])
@pytest.mark.parametrize("value", [b"\x00\x07", "noon", 0.5, None])
def test_a_row_of_another_type_is_damage(tmp_path: Path, column: str, value: Any) -> None:
    if column == "data" and isinstance(value, bytes):
        value = 7
    path = bag_of(tmp_path, still, "sqlite3")
    (file,) = path.glob("*.db3")
    with contextlib.closing(sqlite3.connect(file)) as database, database:
        database.execute("CREATE TABLE rows AS SELECT * FROM messages")
        database.execute("DROP TABLE messages")
        database.execute("ALTER TABLE rows RENAME TO messages")
        database.execute(f"UPDATE messages SET {column} = ? WHERE id = 9", (value,))
    with pytest.raises(DataError, match=r"the bag is damaged: .*reindex"):
        open_mission(path)


@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
def test_files_without_their_metadata_are_read_and_several_are_one(
    tmp_path: Path, kind: str
) -> None:
    messages = sorted(messages_of(mission(), kind), key=lambda m: m[2])
    whole = write_bag(tmp_path / "whole", kind, messages)
    folder = tmp_path / "bare"
    folder.mkdir()
    for name, part in (("a", messages[:150]), ("b", messages[150:])):
        written = write_bag(tmp_path / name, kind, part)
        (file,) = (p for p in written.iterdir() if p.suffix != ".yaml")
        file.rename(folder / file.name)
    one, two = open_mission(whole), open_mission(folder)
    for name, sensor in one.sensors.items():
        np.testing.assert_array_equal(sensor.series.t, two.sensors[name].series.t)
    assert len(open_mission(two.sources[0]).sensors["imu"].series) < len(one.sensors["imu"].series)


def test_an_unknown_message_type_is_named(tmp_path: Path) -> None:
    """A ROS 2 bag of the older sort without definitions, of a package that nobody knows."""
    path = bag_of(tmp_path, lambda m: [*still(m), *still(m, "/secret")], "sqlite3")
    import sqlite3

    (file,) = path.glob("*.db3")
    with sqlite3.connect(file) as database:
        database.execute("UPDATE topics SET type='their_msgs/msg/Secret' WHERE name='/secret'")
        database.execute("DELETE FROM message_definitions")
    text = (path / "metadata.yaml").read_text()
    described = yaml.safe_load(text)
    for topic in described["rosbag2_bagfile_information"]["topics_with_message_count"]:
        meta = topic["topic_metadata"]
        meta["type_description_hash"] = ""
        if meta["name"] == "/secret":
            meta["type"] = "their_msgs/msg/Secret"
    (path / "metadata.yaml").write_text(yaml.safe_dump(described))
    read = open_mission(path)
    assert list(read.sensors) == ["imu"]
    assert any("/secret (their_msgs/msg/Secret)" in w for w in read.warnings)
    with pytest.raises(DataError, match=r"their_msgs/msg/Secret.*can be read: /imu/data"):
        open_mission(path, card=card(tmp_path, {"imu": {"topic": "/secret"}}))


def test_a_bag_without_sensors_lists_what_it_holds(tmp_path: Path) -> None:
    name = "std_msgs/msg/String"
    path = bag_of(tmp_path, lambda m: [("/words", name, 0.0, m.make(name, data="hello"))])
    with pytest.raises(DataError, match=r"the bag holds: /words \(std_msgs/msg/String\)"):
        open_mission(path)
    contents = describe(path)
    assert contents is not None
    assert contents.card == ""


def recorded(folder: Path, name: str) -> Path:
    path = folder / "bags" / name
    if not path.is_file():
        pytest.skip(f"{name} is not among the recorded missions")
    return path


@pytest.mark.slow
@pytest.mark.realdata
def test_dead_reckoning_ends_where_robot_localization_says(recorded_data: Path) -> None:
    read = open_mission(recorded(recorded_data, "robot_localization_test2.bag"))
    n, e, d = estimate(read, "dr").trajectory.p_n[-1]
    assert np.linalg.norm(np.array([e, n, -d]) - [1.0206, 3.4292, 0.7419]) < 0.138


@pytest.mark.realdata
def test_sonia_rejects_what_is_not_finite_and_uses_the_rest(recorded_data: Path) -> None:
    read = open_mission(recorded(recorded_data, "sonia_imu_dvl_depth.bag"))
    assert Counter(r.reason for r in read.rejections) == {"non-finite error velocity": 9}
    assert len(read.sensors["dvl"].series) == 672
    assert any("/auv6/pressure (depth (needs scale and offset_m))" in w for w in read.warnings)
    assert len(estimate(read, "dr").trajectory) > 1900


@pytest.mark.realdata
def test_razor_speaks_in_degrees(recorded_data: Path) -> None:
    from gtsam_nav.audit import audit

    found = audit(open_mission(recorded(recorded_data, "sparkfun_razor.bag")))
    (gyro,) = [f for f in found.findings if f.check == "gyro unit"]
    assert gyro.severity == "warning"
    assert "deg/s" in gyro.message


@pytest.mark.realdata
def test_fixes_have_the_sigmas_of_the_receiver(recorded_data: Path) -> None:
    gnss = open_mission(recorded(recorded_data, "navsatfix.bag")).sensors["gnss"].series
    assert isinstance(gnss, GnssSeries)
    assert len(gnss) == 151
    np.testing.assert_allclose(gnss.sigma[0] ** 2, [3.956121, 3.956121, 7.650756])


def test_a_type_that_a_bag_defines_is_its_own_and_what_it_lacks_is_added() -> None:
    name = "geometry_msgs/msg/Point"
    store, spare = get_typestore(Stores.EMPTY), _spare_types()
    store.register(get_types_from_msg("float64 x", name))
    _add_missing(store, spare)
    assert [field for field, _ in store.fielddefs[name][1]] == ["x"]
    assert [field for field, _ in spare.fielddefs[name][1]] == ["x", "y", "z"]
    assert store.fielddefs.keys() >= {*spare.fielddefs, *DEFINITIONS}
    assert store.types["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0).y == 2.0
