"""CSV files whose columns a card names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from missions import one_sensor_folder

from gtsam_nav.errors import ConfigError, DataError
from gtsam_nav.readers import describe, open_mission
from gtsam_nav.series import DepthSeries, DvlSeries, HeadingSeries, ImuSeries

IMU = {
    "file": "flight.csv",
    "columns": {
        "t": "#timestamp [ns]", "gx": "w x", "gy": "w y", "gz": "w z", "ax": "a", "ay": "b",
        "az": "c",
    },
    "scale": {"t": 1e-9, "gx": 0.5, "az": -1},
}  # fmt: skip
DEPTH = {"file": "depth.csv"}


def files(folder: Path) -> Path:
    rows = [f"{10**9 * k},{k},2,3,4,5,6,9" for k in range(5)]
    (folder / "flight.csv").write_text("\n".join(["#timestamp [ns],w x,w y,w z,a,b,c,t", *rows]))
    (folder / "depth.csv").write_text("t,depth_m\n0,1\n1,2\n2,3\n")
    return folder


def card(folder: Path, **sensors: Any) -> Path:
    path = folder / "card.yaml"
    path.write_text(yaml.safe_dump({"seed": 3, "mission": {"sensors": sensors}}))
    return path


def test_columns_are_renamed_and_scaled(tmp_path: Path) -> None:
    read = open_mission(files(tmp_path), card=card(tmp_path, imu=IMU, depth=DEPTH))
    imu, depth = read.sensors["imu"].series, read.sensors["depth"].series
    assert isinstance(imu, ImuSeries)
    assert isinstance(depth, DepthSeries)
    np.testing.assert_allclose(imu.t, np.arange(5))
    np.testing.assert_allclose(imu.gyro_i[3], [1.5, 2, 3])
    np.testing.assert_allclose(imu.accel_i[3], [4, 5, -6])
    np.testing.assert_allclose(depth.depth_m, [1, 2, 3])
    assert tmp_path / "card.yaml" in read.sources


def test_units_of_an_imu_come_on_top_of_the_scale(tmp_path: Path) -> None:
    """Fast turns in deg/s are no implausible rad/s: the unit counts before any check."""
    entry = IMU | {"gyro_unit": "deg/s", "accel_unit": "g", "scale": {"t": 1e-9, "gx": 200}}
    read = open_mission(files(tmp_path), card=card(tmp_path, imu=entry))
    imu = read.sensors["imu"].series
    assert isinstance(imu, ImuSeries)
    np.testing.assert_allclose(imu.gyro_i[3], np.radians([600, 2, 3]))
    np.testing.assert_allclose(imu.accel_i[3], 9.80665 * np.array([4, 5, 6]))
    assert read.rejections == ()


def test_units_are_of_an_imu_alone(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="gyro_unit is of an imu; a depth has columns to scale"):
        open_mission(files(tmp_path), card=card(tmp_path, depth=DEPTH | {"gyro_unit": "deg/s"}))


def test_repeated_messages_are_dropped_where_the_card_says_so(tmp_path: Path) -> None:
    (tmp_path / "compass.csv").write_text("t,heading_deg\n0,5\n1,5\n2,6\n3,5\n")
    entry = {"file": "compass.csv"}
    for drops, stamps in ((False, [0, 1, 2, 3]), (True, [0, 2, 3])):
        stated = {"sensors": {"heading": entry | {"drop_repeats": drops}}}
        (tmp_path / "mission.yaml").write_text(yaml.safe_dump(stated))
        read = open_mission(tmp_path)
        assert read.sensors["heading"].series.t.tolist() == stamps
        reasons = [(r.index, r.reason) for r in read.rejections]
        assert reasons == ([(1, "repeats the sample before")] if drops else [])


def test_one_file_will_do(tmp_path: Path) -> None:
    stated = card(tmp_path, imu=IMU)
    assert list(open_mission(files(tmp_path) / "flight.csv", card=stated).sensors) == ["imu"]


def test_a_mission_folder_may_map_its_columns_too(tmp_path: Path) -> None:
    (tmp_path / "compass.csv").write_text("s,yaw\n0,0.5\n1,1.0\n")
    entry = {"file": "compass.csv", "columns": {"t": "s", "heading_deg": "yaw"}}
    entry |= {"scale": {"heading_deg": 180 / np.pi}}
    (tmp_path / "mission.yaml").write_text(yaml.safe_dump({"sensors": {"heading": entry}}))
    heading = open_mission(tmp_path).sensors["heading"].series
    assert isinstance(heading, HeadingSeries)
    np.testing.assert_allclose(heading.heading, [0.5, 1.0])


def test_a_dvl_without_a_column_for_it_is_valid_throughout(tmp_path: Path) -> None:
    (tmp_path / "dvl.csv").write_text("t,vx,vy,vz\n0,1,2,3\n1,1,2,3\n2,1,2,3\n")
    dvl = open_mission(tmp_path, card=card(tmp_path, dvl={"file": "dvl.csv"})).sensors["dvl"].series
    assert isinstance(dvl, DvlSeries)
    assert dvl.valid.tolist() == [True] * 3


def test_without_a_card_the_files_are_listed(tmp_path: Path) -> None:
    with pytest.raises(
        DataError, match=r"a card must say .* -c, as in mission: \{sensors: .*depth.csv"
    ):
        open_mission(files(tmp_path))
    contents = describe(tmp_path)
    assert contents is not None
    assert {s.name: s.could_be for s in contents.streams} == {
        "depth.csv": ("depth",), "flight.csv": (),
    }  # fmt: skip
    assert yaml.safe_load(contents.card) == {"mission": {"sensors": {"depth": DEPTH}}}


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({**IMU, "columns": {"t": "time"}}, r"no column 'time'.* the header names #timestamp"),
        ({**IMU, "columns": {"gyro": "w x"}}, "a imu has no column 'gyro'; the choices are: t, gx"),
        ({**IMU, "columns": {"t": "#timestamp [ns]"}}, "column 'gx' is missing"),
        ({**IMU, "file": "other.csv"}, "file 'other.csv' is missing"),
        ({**IMU, "file": "../flight.csv"}, "leads out of the mission folder"),
    ],
)
def test_a_map_that_does_not_fit_is_told_the_choices(
    tmp_path: Path, entry: dict[str, Any], message: str
) -> None:
    with pytest.raises(DataError, match=message):
        open_mission(files(tmp_path), card=card(tmp_path, imu=entry))


def test_a_folder_that_describes_itself_takes_no_card(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    one_sensor_folder(folder, "depth", "t,depth_m,sigma\n0,1,0.1\n1,2,0.1\n")
    with pytest.raises(ConfigError, match="'mission' is for a ROS bag, CSV with a card") as refusal:
        open_mission(folder, card=card(tmp_path, imu=IMU))
    assert str(refusal.value).endswith("is a mission folder, whose card is its mission.yaml")
