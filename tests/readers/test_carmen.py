"""CARMEN logs: an invented robot with every fault, and the recorded ones."""

from __future__ import annotations

import bz2
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import yaml

from gtsam_nav.errors import DataError
from gtsam_nav.mission import Mission
from gtsam_nav.readers import open_mission
from gtsam_nav.readers._odometry import speeds_between
from gtsam_nav.series import OdometrySeries, ScanSeries


def odom(t: float, x: float = 0.0, y: float = 0.0, theta: float = 0.0) -> str:
    return f"ODOM {x} {y} {theta} 0 0 0 {t} robot {t}"


def laser(t: float, *ranges: float, pose: str = "0 0 0") -> str:
    return f"FLASER {len(ranges)} {' '.join(map(str, ranges))} {pose} {pose} {t} robot {t}"


def log(folder: Path, *lines: str, end: str = "\n") -> Mission:
    (folder / "log.clf").write_text("\n".join(["# CARMEN Logfile", *lines]) + end)
    return open_mission(folder / "log.clf")


def scans_of(mission: Mission) -> ScanSeries:
    series = mission.sensors["scans"].series
    assert isinstance(series, ScanSeries)
    return series


def odometry_of(mission: Mission) -> OdometrySeries:
    series = mission.sensors["odometry"].series
    assert isinstance(series, OdometrySeries)
    return series


def test_beams_go_from_right_to_left(tmp_path: Path) -> None:
    """Four beams at -90, -45, 0 and 45 degrees; the last sees nothing."""
    read = log(tmp_path, "PARAM robot_frontlaser_offset 0.5 t host 0", laser(1, 1, 2, 3, 81.83))
    r = np.sqrt(2)
    np.testing.assert_allclose(
        scans_of(read).points_b, [[0.5, 1], [0.5 + r, r], [3.5, 0]], atol=1e-12
    )


def test_a_log_states_its_own_limit(tmp_path: Path) -> None:
    read = log(tmp_path, "PARAM robot_front_laser_max 2.5 t host 0", laser(1, 1, 2, 3, 4))
    assert len(scans_of(read).points_b) == 2


def test_speeds_are_those_between_poses(tmp_path: Path) -> None:
    """A metre ahead, then a quarter turn to the left on a radius of 2 m."""
    read = log(tmp_path, odom(0), odom(0.5, 1), odom(1.5, 3, 2, np.pi / 2))
    series = odometry_of(read)
    np.testing.assert_allclose(series.t, [0.0, 0.75])
    np.testing.assert_allclose(series.v_b, [[2, 0], [np.pi, 0]], atol=1e-9)
    np.testing.assert_allclose(series.yaw_rate, [0, -np.pi / 2])


def test_speeds_lead_back_to_the_poses() -> None:
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.1, 0.3, 50))
    poses = np.cumsum(rng.normal(0, 0.3, (50, 3)), axis=0)
    _, v_b, rate = speeds_between(t, poses)
    x, y, theta = poses[0]
    for dt, (u, v), r in zip(np.diff(t), v_b, rate, strict=True):
        turn = -r * dt
        # a steady turn: the chord is shorter than the arc
        chord = np.sinc(turn / (2 * np.pi)) * dt
        c, s = np.cos(theta + turn / 2), np.sin(theta + turn / 2)
        x, y, theta = x + chord * (c * u + s * v), y + chord * (s * u - c * v), theta + turn
    np.testing.assert_allclose([x, y], poses[-1, :2], atol=1e-9)
    np.testing.assert_allclose(np.exp(1j * theta), np.exp(1j * poses[-1, 2]))


def test_poses_of_the_laser_serve_where_there_are_no_others(tmp_path: Path) -> None:
    read = log(tmp_path, laser(0, 1, 1), laser(1, 1, 1, pose="2 0 0"))
    np.testing.assert_allclose(odometry_of(read).v_b, [[2, 0]])


def test_everything_that_is_dropped_is_counted(tmp_path: Path) -> None:
    read = log(
        tmp_path,
        odom(0),
        odom(1),
        "ODOM 1 2 x 0 0 0 2 robot 2",
        odom(2, np.nan),
        odom(1),
        laser(0, 1, 2),
        laser(1, 60, 60),
        "FLASER 5 1 2 0 0 0 0 0 0 2 robot 2",
        "SYNC start",
        "FLASER 180 46.5 1.0 2.",
        end="",
    )
    assert Counter((r.sensor, r.reason) for r in read.rejections) == {
        ("odometry", "malformed line"): 1,
        ("odometry", "non-finite p_n"): 1,
        ("odometry", "repeated sample"): 1,
        ("scans", "no echo"): 1,
        ("scans", "malformed line"): 1,
        ("scans", "truncated line"): 1,
    }
    assert any("SYNC (1)" in w for w in read.warnings)


def test_a_log_without_scans_and_poses(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no whole FLASER line"):
        log(tmp_path, odom(0))


def test_a_cut_archive(tmp_path: Path) -> None:
    whole = bz2.compress("\n".join(odom(k, 0.1 * k) for k in range(2000)).encode())
    (tmp_path / "log.clf.bz2").write_bytes(whole)
    assert len(odometry_of(open_mission(tmp_path / "log.clf.bz2"))) == 1999
    (tmp_path / "log.clf.bz2").write_bytes(whole[:-10])
    cut = open_mission(tmp_path / "log.clf.bz2")
    assert len(odometry_of(cut)) > 500
    assert any("the archive is cut off" in said for said in cut.warnings)


def relations(folder: Path, *lines: str) -> Mission:
    (folder / "log.relations").write_text("\n".join(lines) + "\n")
    return log(folder, odom(5), odom(9), *(laser(5.5 + k, 1, 2) for k in range(4)))


def test_relations_beside_a_log_are_its_truth(tmp_path: Path) -> None:
    """Half a metre ahead, 0.1 m to port and a turn to the left."""
    read = relations(tmp_path, "5.5 7.5 0.5 0.1 0 0 0 0.2", "6.5 8.5 1 0 0 0 0 0")
    assert read.relations is not None
    assert read.relations.sensor == "scans"
    taken = scans_of(read).t
    np.testing.assert_allclose(read.relations.t, taken[[[0, 2], [1, 3]]])
    np.testing.assert_allclose(read.relations.q, [[0.5, -0.1, -0.2], [1, 0, 0]])
    assert tmp_path / "log.relations" in read.sources
    assert not read.warnings


def test_relations_of_other_scans_are_left_out_and_said(tmp_path: Path) -> None:
    read = relations(tmp_path, "5.5 7.5 0.5 0 0 0 0 0", "5.5 99 1 0 0 0 0 0", "7.5 5.5 1 0 0 0 0 0")
    assert read.relations is not None
    assert len(read.relations.t) == 1
    assert read.warnings == ("log.relations: 2 of 3 relations are of no two scans",)
    read = relations(tmp_path, "50 51 0.5 0 0 0 0 0")
    assert read.relations is None
    assert read.warnings


@pytest.mark.parametrize("line", ["5.5 7.5 0.5 0.1", "one two", "5.5 7.5 nan 0 0 0 0 0"])
def test_a_file_that_is_none_of_relations_is_an_error(tmp_path: Path, line: str) -> None:
    with pytest.raises(DataError, match="relation"):
        relations(tmp_path, line)


def test_scans_are_stamped_when_they_have_come_in(tmp_path: Path) -> None:
    read = log(tmp_path, odom(0), odom(1), laser(0.5, 1, 2))
    assert read.sensors["scans"].time_offset_sigma_s > 0.0
    assert read.sensors["odometry"].time_offset_sigma_s == 0.0


@pytest.mark.parametrize(("n", "last_deg"), [(180, 89.0), (181, 90.0), (360, 89.5), (361, 90.0)])
def test_rays_are_a_degree_apart_or_half_of_one(tmp_path: Path, n: int, last_deg: float) -> None:
    log(tmp_path, odom(0), odom(1), laser(0.5, *[2.0] * n))
    x, y = scans_of(open_mission(tmp_path / "log.clf")).points_b.T
    to_port_deg = np.degrees(np.arctan2(-y, x))
    np.testing.assert_allclose(to_port_deg, np.linspace(-90.0, last_deg, n), atol=1e-9)


def card(folder: Path, **sensors: object) -> Path:
    path = folder / "card.yaml"
    path.write_text(yaml.safe_dump({"mission": {"sensors": sensors}}))
    return path


def test_a_card_mounts_the_laser(tmp_path: Path) -> None:
    """Two beams, to starboard and ahead; the laser is turned to starboard and 0.2 m ahead."""
    log(tmp_path, odom(0), odom(1), laser(0.5, 1, 2))
    scans = {
        "xyz_m": [0.2, 0, 0],
        "rpy_deg": [0, 0, 90],
        "noise": {"sigma_range_m": 0.07},
        "time_offset": {"value_s": 0.25, "sigma_s": 0.3, "estimate": True},
    }
    read = open_mission(tmp_path / "log.clf", card=card(tmp_path, scans=scans))
    laser_ = read.sensors["scans"]
    np.testing.assert_allclose(scans_of(read).points_b, [[-0.8, 0], [0.2, 2]], atol=1e-12)
    assert scans_of(read).t[0] == pytest.approx(0.25)
    assert laser_.time_offset_sigma_s == 0.3
    assert laser_.noise["sigma_range_m"] == 0.07
    assert "sigma_bearing_deg" in laser_.noise
    assert tmp_path / "card.yaml" in read.sources


def test_a_card_says_how_noisy_the_odometry_is(tmp_path: Path) -> None:
    log(tmp_path, odom(0), odom(1))
    stated = {"noise": {"sigma_v_m_s": 0.7}}
    read = open_mission(tmp_path / "log.clf", card=card(tmp_path, odometry=stated))
    np.testing.assert_allclose(odometry_of(read).sigma_v, 0.7)


@pytest.mark.parametrize(
    ("sensors", "message"),
    [
        ({"lidar": {"type": "scans"}}, "no sensor 'lidar'; the choices are: odometry, scans"),
        ({"scans": {"type": "beams"}}, "'scans' is of type scans, not beams"),
        (
            {"odometry": {"type": "heading", "noise": {"sigma_deg": 3}}},
            "'odometry' is of type odometry, not heading",
        ),
        ({"scans": {"yaw_deg": 3}}, "unknown key 'yaw_deg'"),
    ],
)
def test_a_card_that_does_not_fit_is_told_the_choices(
    tmp_path: Path, sensors: dict[str, object], message: str
) -> None:
    log(tmp_path, odom(0), odom(1), laser(0.5, 1, 2))
    with pytest.raises(DataError, match=message):
        open_mission(tmp_path / "log.clf", card=card(tmp_path, **sensors))


@pytest.mark.realdata
@pytest.mark.slow
@pytest.mark.parametrize(("name", "scans", "poses"), [("aces", 7374, 7375), ("fr079", 4934, 8951)])
def test_the_recorded_logs(recorded_data: Path, name: str, scans: int, poses: int) -> None:
    path = recorded_data / "carmen" / f"{name}.clf.bz2"
    if not path.is_file():
        pytest.skip(f"{name} is not among the recorded missions")
    read = open_mission(path)
    assert len(scans_of(read)) == scans
    dropped = sum(r.sensor == "odometry" for r in read.rejections)
    assert len(odometry_of(read)) == poses - 1 - dropped
    # ipc_t is seconds since the logger began
    assert read.start_utc is None
