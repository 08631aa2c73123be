"""The command line on the formats that people have: bags with their cards, conversion, frames."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bags import Message, Messages, write_bag
from test_cli import run_main

from gtsam_nav.frames import quaternion_from_rpy
from gtsam_nav.readers import open_mission
from gtsam_nav.trajectory import Trajectory
from gtsam_nav.writers.trajectories import write_tum


def drive(kind: str = "ros1") -> list[Message]:
    """Half a minute to the north at 1 m/s by odometry, with an AHRS, and a second IMU."""
    m = Messages(kind)
    name = "nav_msgs/msg/Odometry"
    north = quaternion_from_rpy([0.0, 0.0, np.pi / 2])  # in east, north, up
    twist = m.make(
        "geometry_msgs/msg/TwistWithCovariance",
        twist=m.make("geometry_msgs/msg/Twist", linear=m.vector((1, 0, 0))),
    )
    messages: list[Message] = []
    for t in np.arange(0.0, 30.0, 0.1).tolist():
        messages += [
            ("/imu/data", "sensor_msgs/msg/Imu", t, m.imu(t, wxyz=north)),
            ("/imu/raw", "sensor_msgs/msg/Imu", t, m.imu(t)),
            ("/odom", name, t, m.make(name, header=m.header(t, "odom"), twist=twist)),
        ]
    return messages


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return write_bag(tmp_path / "drive", "ros1", drive())


@pytest.fixture
def no_report(monkeypatch: pytest.MonkeyPatch) -> None:
    module: Any = import_module("gtsam_nav.evaluation.report")

    def stand_in(_solutions: object, out: Path, _config: object) -> Path:
        return out / "report.html"

    monkeypatch.setattr(module, "write_report", stand_in)


def test_inspect_lists_a_bag_and_prints_a_card(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("inspect", bag) == 0
    printed = capsys.readouterr()
    assert "/imu/raw" in printed.out
    assert "imu, heading, attitude" in printed.out
    assert "also possible: imu: /imu/raw" in printed.err
    card = yaml.safe_load(printed.out[printed.out.index("mission:\n  sensors:") :])
    assert card["mission"]["sensors"]["odometry"] == {"topic": "/odom", "stamp": "header"}
    assert run_main("inspect", bag, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert [s["name"] for s in document["contents"]["streams"]] == [
        "/imu/data",
        "/imu/raw",
        "/odom",
    ]
    assert yaml.safe_load(document["contents"]["card"]) == card


@pytest.mark.usefixtures("no_report")
def test_run_takes_card_and_settings_from_one_file(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sensors = {"heading": {"topic": "/imu/data"}, "odometry": {}}
    both = {"seed": 7, "motion": {"rate_hz": 20}, "mission": {"sensors": sensors}}
    (tmp_path / "card.yaml").write_text(yaml.safe_dump(both))
    out = tmp_path / "out"
    assert run_main("run", bag, "-c", tmp_path / "card.yaml", "-m", "dr", "--out", out) == 0
    resolved = yaml.safe_load((out / "dr" / "config.yaml").read_text())
    assert resolved["motion"]["rate_hz"] == 20
    assert "mission" not in resolved
    end = [float(x) for x in (out / "dr" / "trajectory.tum").read_text().splitlines()[-1].split()]
    np.testing.assert_allclose(end[1:4], [29.9, 0, 0], atol=0.1)
    assert "without a card" not in capsys.readouterr().err


def test_a_card_for_a_topic_that_is_not_there(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "card.yaml").write_text("mission: {sensors: {imu: {topic: /no}}}")
    assert run_main("run", bag, "-c", tmp_path / "card.yaml", "--out", tmp_path / "out") == 3
    assert "no topic '/no'; the topics are: /imu/data, /imu/raw, /odom" in capsys.readouterr().err


def test_convert_writes_a_folder_that_reads_back(bag: Path, tmp_path: Path) -> None:
    assert run_main("convert", bag, "--out", tmp_path / "folder") == 0
    one, two = open_mission(bag), open_mission(tmp_path / "folder")
    assert list(one.sensors) == list(two.sensors)
    for name, sensor in one.sensors.items():
        np.testing.assert_array_equal(sensor.series.t, two.sensors[name].series.t)


def test_convert_counts_what_it_drops(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "depth.csv").write_text("t,depth_m\n0,1\n1,nan\n2,nan\n3,2\n4,2\n5,2\n6,2\n")
    (tmp_path / "card.yaml").write_text("mission: {sensors: {depth: {file: depth.csv}}}")
    source, folder = tmp_path / "depth.csv", tmp_path / "folder"
    assert run_main("convert", source, "-c", tmp_path / "card.yaml", "--out", folder) == 0
    assert "dropped: depth: 2 x non-finite depth_m" in capsys.readouterr().out
    assert open_mission(folder).dropped == {("depth", "non-finite depth_m"): 2}


def test_convert_says_what_a_folder_has_no_place_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scans = [f"FLASER 2 1 2 {k} 0 0 {k} 0 0 {k}.0 robot {k}.0" for k in range(3)]
    (tmp_path / "hall.clf").write_text("\n".join(scans) + "\n")
    (tmp_path / "hall.relations").write_text("0 1 1 0 0 0 0 0\n0 2 2 0 0 0 0 0\n")
    assert run_main("convert", tmp_path / "hall.clf", "--out", tmp_path / "folder") == 0
    assert "warning: 2 surveyed relations have no place in a folder" in capsys.readouterr().err


def test_evaluate_takes_texts_and_says_what_it_leaves_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    poses = "".join(f"{k} {k} 0 0 0 0 0 1\n" for k in range(9))
    (tmp_path / "a.txt").write_text(poses)
    (tmp_path / "b.csv").write_text("t,n,e,d\n" + "".join(f"{k},{k},0,0\n" for k in range(9)) + "x")
    assert run_main("evaluate", tmp_path / "a.txt", tmp_path / "a.txt") == 0
    assert capsys.readouterr().err == ""
    assert run_main("evaluate", tmp_path / "a.txt", tmp_path / "b.csv") == 0
    assert "left out: 1 x truncated line" in capsys.readouterr().err


def test_convert_refuses_what_is_no_mission(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.bag").write_bytes(b"nothing")
    assert run_main("convert", tmp_path / "a.bag", "--out", tmp_path / "folder") == 3
    assert "cannot be opened" in capsys.readouterr().err
    assert not (tmp_path / "folder").exists()


def test_evaluate_in_east_north_up(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.arange(0.0, 60.0, 0.5)
    p_n = np.column_stack([t, 0.1 * t**1.5, np.zeros_like(t)])
    trajectory = Trajectory(t=t, p_n=p_n, q_nb_wxyz=np.tile([1.0, 0, 0, 0], (len(t), 1)))
    write_tum(trajectory, tmp_path / "estimate.tum", "enu")
    write_tum(trajectory, tmp_path / "truth.tum", "enu")
    files = tmp_path / "estimate.tum", tmp_path / "truth.tum"
    assert run_main("evaluate", *files, "--frame", "enu", "--json") == 0
    assert json.loads(capsys.readouterr().out)["ate"]["none"]["max"] < 1e-9
    write_tum(trajectory, tmp_path / "truth.tum", "ned")
    frames = ("--frame", "enu", "--reference-frame", "ned")
    assert run_main("evaluate", *files, *frames, "--json") == 0
    told = capsys.readouterr()
    assert json.loads(told.out)["ate"]["none"]["max"] < 1e-9
    assert told.err == ""
    assert run_main("evaluate", *files) == 0
    told = capsys.readouterr()
    assert "ate none" in told.out
    assert "as if north and east are exchanged (ENU read as NED)" in told.err
    assert "--frame and --reference-frame say in which axes" in told.err
    assert run_main("evaluate", *files, "--frame", "nwu") == 2
    assert "unknown frame 'nwu'; the choices are: ned, enu" in capsys.readouterr().err


def test_evaluate_at_other_times(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.arange(0.0, 60.0, 0.5)
    p_n = np.column_stack([t, 0.1 * t**1.5, np.zeros_like(t)])
    trajectory = Trajectory(t=t, p_n=p_n, q_nb_wxyz=np.tile([1.0, 0, 0, 0], (len(t), 1)))
    write_tum(trajectory, tmp_path / "truth.tum", "ned")
    write_tum(replace(trajectory, t=t + 1.75e9), tmp_path / "posix.tum", "ned")
    assert run_main("evaluate", tmp_path / "posix.tum", tmp_path / "truth.tum") == 0
    told = capsys.readouterr()
    assert "no score: the estimate covers nothing of the reference" in told.out
    assert "ate none" not in told.out
    assert "spans 1750000000.0 to 1750000059.5 s, the reference spans 0.0 to 59.5 s" in told.err


@pytest.mark.parametrize("command", ["inspect", "run", "convert"])
@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "cannot read the configuration"),
        ("foo: 1", "unknown config key 'foo'"),
        ("sensors: {odometry: {}}", "unknown config key 'sensors'; the choices are: seed"),
    ],
)
def test_every_command_refuses_a_file_of_settings_that_is_none(
    bag: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    command: str,
    text: str | None,
    said: str,
) -> None:
    card = tmp_path / "card.yaml"
    if text is not None:
        card.write_text(text)
    out = () if command == "inspect" else ("--out", tmp_path / "out")
    assert run_main(command, bag, "-c", card, *out) == 2
    err = capsys.readouterr().err
    assert said in err
    if text is not None:
        assert "mission (a mission's card" in err
    assert not (tmp_path / "out").exists()


def test_brackets_in_a_header_are_no_markup(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "log.csv").write_text("t,heading_deg,Vx [cm/s]\n0,10,1\n1,11,1\n2,12,1\n")
    (tmp_path / "card.yaml").write_text("mission: {sensors: {heading: {file: log.csv}}}")
    assert run_main("inspect", tmp_path / "log.csv", "-c", tmp_path / "card.yaml") == 0
    assert "Vx [cm/s]" in capsys.readouterr().out
