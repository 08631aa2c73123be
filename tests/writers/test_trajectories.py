"""Trajectories in files: exact where promised, and readable by evo."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import solutions
from evo.tools import file_interface
from hypothesis import given, settings
from hypothesis import strategies as st

from gtsam_nav.errors import DataError
from gtsam_nav.frames import (
    ENU_FROM_NED,
    FLU_FROM_FRD,
    ned_from_geodetic,
    quaternion_from_rpy,
    rotation_from_quaternion,
)
from gtsam_nav.trajectory import Trajectory
from gtsam_nav.writers.frame import Frame
from gtsam_nav.writers.tables import read_table, write_records
from gtsam_nav.writers.trajectories import (
    KITTI_TIMES,
    read_kitti,
    read_trajectory,
    read_trajectory_csv,
    read_tum,
    write_kitti,
    write_nav,
    write_trajectory_csv,
    write_tum,
)

COLUMNS = (
    "t,n,e,d,vn,ve,vd,roll_deg,pitch_deg,yaw_deg,sigma_n,sigma_e,sigma_d,cov_ne,"
    "sigma_vn,sigma_ve,sigma_vd,sigma_roll_deg,sigma_pitch_deg,sigma_yaw_deg,keyframe"
)


@pytest.fixture(scope="module")
def trajectory() -> Trajectory:
    return solutions.wandering(np.arange(0.0, 60.0, 0.1), 0.1, seed=3)


def bare(trajectory: Trajectory) -> Trajectory:
    return Trajectory(t=trajectory.t, p_n=trajectory.p_n, q_nb_wxyz=trajectory.q_nb_wxyz)


@settings(deadline=None, max_examples=25)
@given(
    t0=st.floats(0, 1e6),
    p_n=st.tuples(*[st.floats(-1e5, 1e5)] * 3),
    rpy=st.tuples(st.floats(-3, 3), st.floats(-1.5, 1.5), st.floats(-3, 3)),
)
def test_tum_is_exact(
    tmp_path_factory: pytest.TempPathFactory,
    t0: float,
    p_n: tuple[float, float, float],
    rpy: tuple[float, float, float],
) -> None:
    path = tmp_path_factory.getbasetemp() / "exact.tum"
    one = Trajectory(t=np.array([t0]), p_n=[p_n], q_nb_wxyz=quaternion_from_rpy([rpy]))  # type: ignore[arg-type]
    write_tum(one, path)
    back = read_tum(path)
    np.testing.assert_array_equal(back.t, one.t)
    np.testing.assert_array_equal(back.p_n, one.p_n)
    np.testing.assert_allclose(back.q_nb_wxyz, one.q_nb_wxyz, rtol=0, atol=2.3e-16)


def test_evo_reads_tum(trajectory: Trajectory, tmp_path: Path) -> None:
    write_tum(trajectory, tmp_path / "trajectory.tum")
    evo = file_interface.read_tum_trajectory_file(tmp_path / "trajectory.tum")
    assert evo.check()[0]
    np.testing.assert_array_equal(evo.timestamps, trajectory.t)
    np.testing.assert_array_equal(evo.positions_xyz, trajectory.p_n)
    np.testing.assert_allclose(evo.orientations_quat_wxyz, trajectory.q_nb_wxyz, atol=1e-15)


@pytest.mark.parametrize("frame", ["ned", "enu"])
def test_evo_reads_kitti(trajectory: Trajectory, tmp_path: Path, frame: str) -> None:
    write_kitti(trajectory, tmp_path / "trajectory.kitti", frame)  # type: ignore[arg-type]
    evo = file_interface.read_kitti_poses_file(tmp_path / "trajectory.kitti")
    assert evo.check()[0]
    R, p_n = np.array(evo.poses_se3)[:, :3, :3], evo.positions_xyz
    if frame == "enu":
        p_n, R = p_n @ ENU_FROM_NED, ENU_FROM_NED @ R @ FLU_FROM_FRD
    np.testing.assert_allclose(p_n, trajectory.p_n, atol=1e-12)
    np.testing.assert_allclose(R, trajectory.R_nb, atol=1e-12)


def test_enu_tum_has_east_first_and_yaw_from_east(tmp_path: Path) -> None:
    heading_north = Trajectory(
        t=np.zeros(1), p_n=np.array([[1.0, 2.0, 3.0]]), q_nb_wxyz=np.array([[1.0, 0, 0, 0]])
    )
    write_tum(heading_north, tmp_path / "a.tum", "enu")
    values = np.loadtxt(tmp_path / "a.tum")
    np.testing.assert_allclose(values[1:4], [2.0, 1.0, -3.0])
    R = rotation_from_quaternion(values[[7, 4, 5, 6]])
    np.testing.assert_allclose(R @ [1.0, 0, 0], [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(R @ [0, 0, 1.0], [0.0, 0.0, 1.0], atol=1e-12)


def test_csv_has_the_columns_of_the_design(trajectory: Trajectory, tmp_path: Path) -> None:
    write_trajectory_csv(trajectory, tmp_path / "t.csv")
    assert (tmp_path / "t.csv").read_text().splitlines()[0] == COLUMNS


def test_csv_round_trip(trajectory: Trajectory, tmp_path: Path) -> None:
    assert trajectory.cov_pose_n is not None
    correlated = trajectory.cov_pose_n.copy()
    correlated[:, 0, 1] = correlated[:, 1, 0] = 0.3 * correlated[:, 0, 0]
    written = replace(trajectory, cov_pose_n=correlated)
    write_trajectory_csv(written, tmp_path / "t.csv")
    back = read_trajectory_csv(tmp_path / "t.csv")
    np.testing.assert_array_equal(back.t, written.t)
    np.testing.assert_allclose(back.p_n, written.p_n, atol=1e-6)
    np.testing.assert_allclose(back.q_nb_wxyz, written.q_nb_wxyz, atol=1e-9)
    assert back.cov_pose_n is not None
    assert back.v_n is not None
    assert written.v_n is not None
    np.testing.assert_allclose(back.v_n, written.v_n, atol=1e-6)
    np.testing.assert_allclose(back.cov_pose_n[:, :2, :2], correlated[:, :2, :2], rtol=2e-5)
    np.testing.assert_allclose(back.sigma_p_n, written.sigma_p_n, rtol=1e-5)  # type: ignore[arg-type]
    np.testing.assert_allclose(back.sigma_rpy, written.sigma_rpy, rtol=1e-5)  # type: ignore[arg-type]
    np.testing.assert_allclose(back.sigma_v_n, written.sigma_v_n, rtol=1e-5)  # type: ignore[arg-type]
    np.testing.assert_array_equal(back.keyframe, written.keyframe)  # type: ignore[arg-type]


def test_csv_keeps_the_unknown_unknown(trajectory: Trajectory, tmp_path: Path) -> None:
    write_trajectory_csv(bare(trajectory), tmp_path / "t.csv")
    back = read_trajectory_csv(tmp_path / "t.csv")
    assert back.cov_pose_n is None
    assert back.v_n is None
    assert back.sigma_v_n is None
    assert back.keyframe is not None
    assert not np.any(back.keyframe)


def test_read_trajectory_goes_by_the_ending(trajectory: Trajectory, tmp_path: Path) -> None:
    write_tum(trajectory, tmp_path / "a.tum")
    write_trajectory_csv(trajectory, tmp_path / "a.csv")
    assert len(read_trajectory(tmp_path / "a.tum")) == len(read_trajectory(tmp_path / "a.csv"))
    with pytest.raises(DataError, match=r"\.tum"):
        read_trajectory(tmp_path / "a.bag")


POSE = "t,n,e,d,roll_deg,pitch_deg,yaw_deg"
SIGMAS = "sigma_n,sigma_e,sigma_d,cov_ne,sigma_roll_deg,sigma_pitch_deg,sigma_yaw_deg"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.tum", "1 2 3\n", "eight numbers"),
        ("a.tum", "", "eight numbers"),
        ("a.tum", "x y z\n", "not a TUM"),
        ("a.tum", "0 0 0 0 0 0 0 5\n", "unit length"),
        ("a.tum", "1 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1\n", "strictly increase"),
        ("a.csv", "t,n,e\n0,1,2\n", "d, roll_deg"),
        ("a.csv", "t,n\n0,1,2\n", "column names"),
        ("a.csv", "t,n\n0,one\n", "table of numbers"),
        ("a.csv", f"{POSE}\n0,0,0,0,0,inf,0\n", "attitude holds NaN or infinity"),
        ("a.csv", f"{POSE},{SIGMAS}\n0,0,0,0,0,0,0,1e200,1,1,0,1,1,1\n", "cov_pose_n holds"),
        ("a.csv", f"{POSE},{SIGMAS}\n0,0,0,0,0,0,0,1,1,1,0,1,1,inf\n", "cov_pose_n holds"),
    ],
)
def test_bad_files_are_data_errors(tmp_path: Path, name: str, content: str, message: str) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(DataError, match=message):
        read_trajectory(tmp_path / name)
    with pytest.raises(DataError):
        read_trajectory(tmp_path / f"missing_{name}")


def test_nav_is_geodetic(trajectory: Trajectory, tmp_path: Path) -> None:
    write_nav(trajectory, solutions.ORIGIN, tmp_path / "nav.csv")
    table = read_table(tmp_path / "nav.csv")
    assert ",".join(table) == "t,lat,lon,h,vn,ve,vd,roll,pitch,yaw"
    p_n = ned_from_geodetic(table["lat"], table["lon"], table["h"], solutions.ORIGIN)
    np.testing.assert_allclose(p_n, trajectory.p_n, atol=1e-4)
    np.testing.assert_allclose(np.radians(table["yaw"]), trajectory.rpy[:, 2], atol=1e-8)


def test_records_quote_text_and_leave_the_unknown_empty(tmp_path: Path) -> None:
    write_records(
        tmp_path / "r.csv", ("a", "b", "c"), [(0.1, 'x, "y"', None), (float("nan"), "", 3)]
    )
    assert (tmp_path / "r.csv").read_text() == 'a,b,c\n0.1,"x, ""y""",\n,,3\n'


@pytest.mark.parametrize("frame", ["ned", "enu"])
def test_text_trajectories_come_back_from_both_frames(
    tmp_path: Path, trajectory: Trajectory, frame: Frame
) -> None:
    write_tum(trajectory, tmp_path / "a.tum", frame)
    write_kitti(trajectory, tmp_path / "a.kitti", frame)
    (tmp_path / KITTI_TIMES).write_text("\n".join(map(repr, trajectory.t.tolist())))
    (tmp_path / "poses.txt").write_text((tmp_path / "a.kitti").read_text())
    for name in ("a.tum", "a.kitti", "poses.txt"):
        back = read_trajectory(tmp_path / name, frame)
        np.testing.assert_array_equal(back.t, trajectory.t)
        np.testing.assert_allclose(back.p_n, trajectory.p_n, atol=1e-12)
        np.testing.assert_allclose(back.R_nb, trajectory.R_nb, atol=1e-12)


def test_kitti_needs_its_times_and_rotations(tmp_path: Path, trajectory: Trajectory) -> None:
    path = tmp_path / "a.kitti"
    write_kitti(trajectory, path)
    (tmp_path / "times.txt").unlink()
    with pytest.raises(DataError, match=r"times.txt beside it is needed"):
        read_kitti(path)
    (tmp_path / KITTI_TIMES).write_text("0\n1\n")
    with pytest.raises(DataError, match=r"poses in a.kitti, but 2 times"):
        read_kitti(path)
    path.write_text("1 0 0 0 0 1 0 0 0 0 2 0\n" * 2)
    with pytest.raises(DataError, match="is no rotation"):
        read_kitti(path)
    path.write_text("1 2 3\n")
    with pytest.raises(DataError, match="twelve numbers"):
        read_kitti(path)
