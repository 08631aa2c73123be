"""Trajectories as TUM, KITTI, CSV and geodetic navigation files, and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import (
    Array,
    Origin,
    geodetic_from_ned,
    quaternion_from_rotation,
    quaternion_from_rpy,
    rotation_from_quaternion,
)
from gtsam_nav.series import BoolArray
from gtsam_nav.trajectory import Trajectory
from gtsam_nav.writers.frame import Frame, express_points, express_rotations
from gtsam_nav.writers.tables import EXACT, format_rows, read_table, write_table

KITTI_TIMES = "times.txt"
"""What the KITTI odometry benchmark calls the file of a sequence's times, one a line, s."""


def write_tum(trajectory: Trajectory, path: Path, frame: Frame = "ned") -> None:
    """Write ``t x y z qx qy qz qw``, one pose a line, exactly; t in mission seconds."""
    q_wxyz = quaternion_from_rotation(express_rotations(trajectory.R_nb, frame))
    if frame == "ned":
        q_wxyz = trajectory.q_nb_wxyz
    columns = [
        trajectory.t,
        *express_points(trajectory.p_n, frame).T,
        *q_wxyz[:, [1, 2, 3, 0]].T,
    ]
    path.write_text(format_rows(columns, [EXACT] * 8, " "), encoding="utf-8", newline="\n")


def read_tum(path: Path, frame: Frame = "ned") -> Trajectory:
    """Read a TUM file in a frame's axes; lines that start with # are comments.

    Raises
    ------
    DataError
        Where the file is missing or does not hold eight numbers a line.
    """
    values = _numbers(path, "TUM")
    if not len(values) or values.shape[1] != 8:
        raise DataError("a TUM trajectory has eight numbers a line: t x y z qx qy qz qw", path)
    q_wxyz = values[:, [7, 4, 5, 6]]
    if frame != "ned" and np.all(np.linalg.norm(q_wxyz, axis=1) > 0):
        # the turns are their own inverse
        R_nb = express_rotations(rotation_from_quaternion(q_wxyz), frame)
        q_wxyz = quaternion_from_rotation(R_nb)
    p_n = express_points(values[:, 1:4], frame)
    return _valid(path, t=values[:, 0], p_n=p_n, q_nb_wxyz=q_wxyz)


def read_kitti(path: Path, frame: Frame = "ned") -> Trajectory:
    """Read a KITTI file in a frame's axes, with the times of ``times.txt`` beside it.

    Raises
    ------
    DataError
        Where a file is missing, does not hold twelve numbers a line, or there is not one time for
        each pose.
    """
    values = _numbers(path, "KITTI")
    if not len(values) or values.shape[1] != 12:
        raise DataError("a KITTI trajectory has twelve numbers a line: the rows of [R|p]", path)
    beside = path.with_name(KITTI_TIMES)
    if not beside.is_file():
        raise DataError(f"a KITTI trajectory has no times; {KITTI_TIMES} beside it is needed", path)
    times = _numbers(beside, "list of times")
    if times.shape != (len(values), 1):
        raise DataError(f"{len(values)} poses in {path.name}, but {times.size} times", beside)
    poses = values.reshape(-1, 3, 4)
    if not np.allclose(np.linalg.det(poses[:, :, :3]), 1.0, atol=1e-3):
        raise DataError("the left of [R|p] is no rotation", path)
    return _valid(
        path,
        t=times[:, 0],
        p_n=express_points(poses[:, :, 3], frame),
        q_nb_wxyz=quaternion_from_rotation(express_rotations(poses[:, :, :3], frame)),
    )


def _numbers(path: Path, kind: str) -> Array:
    try:
        lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
        return np.loadtxt(lines, ndmin=2) if lines else np.empty((0, 0))
    except FileNotFoundError as error:
        raise DataError("no such file", path) from error
    except (OSError, ValueError) as error:
        raise DataError(f"not a {kind} trajectory: {error}", path) from error


def write_kitti(trajectory: Trajectory, path: Path, frame: Frame = "ned") -> None:
    """Write the twelve numbers of [R|p], row by row, one pose a line; times beside, exactly."""
    R = express_rotations(trajectory.R_nb, frame)
    p = express_points(trajectory.p_n, frame)
    rows = np.concatenate([R, p[:, :, None]], axis=2).reshape(-1, 12)
    path.write_text(format_rows(list(rows.T), [EXACT] * 12, " "), encoding="utf-8", newline="\n")
    times = format_rows([trajectory.t], [EXACT])
    path.with_name(KITTI_TIMES).write_text(times, encoding="utf-8", newline="\n")


def write_trajectory_csv(trajectory: Trajectory, path: Path) -> None:
    """Write pose, velocity and their standard deviations; what is unknown is ``nan``.

    Columns: t, n, e, d (m), vn, ve, vd (m/s), roll_deg, pitch_deg, yaw_deg, sigma_n, sigma_e,
    sigma_d (m), cov_ne (m^2), sigma_vn, sigma_ve, sigma_vd (m/s), sigma_roll_deg, sigma_pitch_deg,
    sigma_yaw_deg, keyframe (0 or 1).
    """
    unknown = np.full((len(trajectory), 3), np.nan)
    cov = trajectory.cov_pose_n
    sigma_rpy = trajectory.sigma_rpy
    sigma_p = trajectory.sigma_p_n
    keyframe = trajectory.keyframe
    groups: list[tuple[str, Array, str]] = [
        ("t", trajectory.t, EXACT),
        ("n,e,d", trajectory.p_n, "%.6f"),
        ("vn,ve,vd", unknown if trajectory.v_n is None else trajectory.v_n, "%.6f"),
        ("roll_deg,pitch_deg,yaw_deg", np.degrees(trajectory.rpy), "%.8f"),
        ("sigma_n,sigma_e,sigma_d", unknown if sigma_p is None else sigma_p, "%.6g"),
        ("cov_ne", unknown[:, 0] if cov is None else cov[:, 0, 1], "%.6g"),
        (
            "sigma_vn,sigma_ve,sigma_vd",
            unknown if trajectory.sigma_v_n is None else trajectory.sigma_v_n,
            "%.6g",
        ),
        (
            "sigma_roll_deg,sigma_pitch_deg,sigma_yaw_deg",
            unknown if sigma_rpy is None else np.degrees(sigma_rpy),
            "%.6g",
        ),
        (
            "keyframe",
            np.zeros(len(trajectory.t)) if keyframe is None else keyframe.astype(float),
            "%.0f",
        ),
    ]
    columns = {
        name: (values, fmt)
        for names, block, fmt in groups
        for name, values in zip(names.split(","), np.atleast_2d(block.T), strict=True)
    }
    write_table(path, columns)


def read_trajectory_csv(path: Path) -> Trajectory:
    """Read what `write_trajectory_csv` wrote; only t, n, e, d and the attitude must be there.

    The covariance is rebuilt from the standard deviations and ``cov_ne``: other correlations are
    not in the file.

    Raises
    ------
    DataError
        Where a column is missing or a value is not valid.
    """
    table = read_table(path)
    needed = ("t", "n", "e", "d", "roll_deg", "pitch_deg", "yaw_deg")
    if missing := [name for name in needed if name not in table]:
        raise DataError(f"column {', '.join(missing)} is missing of {', '.join(needed)}", path)

    def block(*names: str) -> Array | None:
        columns = [table[name] for name in names if name in table]
        known = len(columns) == len(names) and not np.any(np.isnan(columns))
        return np.column_stack(columns) if known else None

    rpy = np.radians(np.column_stack([table[name] for name in needed[4:]]))
    if not np.all(np.isfinite(rpy)):
        raise DataError("not a valid trajectory: its attitude holds NaN or infinity", path)
    sigmas = block("sigma_n", "sigma_e", "sigma_d", "cov_ne")
    sigma_rpy_deg = block("sigma_roll_deg", "sigma_pitch_deg", "sigma_yaw_deg")
    keyframe = block("keyframe")
    return _valid(
        path,
        t=table["t"],
        p_n=np.column_stack([table[name] for name in needed[1:4]]),
        q_nb_wxyz=quaternion_from_rpy(rpy),
        v_n=block("vn", "ve", "vd"),
        sigma_v_n=block("sigma_vn", "sigma_ve", "sigma_vd"),
        cov_pose_n=(
            None
            if sigmas is None or sigma_rpy_deg is None
            else _covariance(rpy, sigmas, np.radians(sigma_rpy_deg))
        ),
        keyframe=None if keyframe is None else keyframe[:, 0] > 0,
    )


def read_trajectory(path: Path, frame: Frame = "ned") -> Trajectory:
    """Read a trajectory from a TUM, KITTI or CSV file.

    Parameters
    ----------
    path : Path
        ``.tum``, ``.kitti`` (with ``times.txt``) or ``.csv``; a ``.txt`` is KITTI where its lines
        have twelve numbers, else TUM.
    frame : {"ned", "enu"}
        Of a TUM or KITTI file; the columns of CSV say theirs.

    Raises
    ------
    DataError
        For another ending or a file that is not valid.
    """
    if path.suffix == ".csv":
        return read_trajectory_csv(path)
    is_text = path.suffix == ".txt" and path.is_file()
    if path.suffix == ".kitti" or (is_text and _numbers(path, "TUM or KITTI").shape[1] == 12):
        return read_kitti(path, frame)
    if path.suffix in (".tum", ".txt"):
        return read_tum(path, frame)
    raise DataError("a trajectory is a .tum, .kitti, .txt (either of both) or .csv file", path)


def write_nav(trajectory: Trajectory, origin: Origin, path: Path) -> None:
    """Write t, lat, lon (deg), h (m), vn, ve, vd (m/s), roll, pitch, yaw (deg)."""
    latitude, longitude, height = geodetic_from_ned(trajectory.p_n, origin)
    v_n = trajectory.v_n
    vn, ve, vd = np.full((3, len(trajectory)), np.nan) if v_n is None else v_n.T
    roll, pitch, yaw = np.degrees(trajectory.rpy).T
    columns = {
        "t": (trajectory.t, EXACT),
        "lat": (latitude, "%.10f"),
        "lon": (longitude, "%.10f"),
        "h": (height, "%.4f"),
        "vn": (vn, "%.5f"),
        "ve": (ve, "%.5f"),
        "vd": (vd, "%.5f"),
        "roll": (roll, "%.6f"),
        "pitch": (pitch, "%.6f"),
        "yaw": (yaw, "%.6f"),
    }
    write_table(path, columns)


def _covariance(rpy: Array, sigmas: Array, sigma_rpy: Array) -> Array:
    """Pose covariance whose `Trajectory.sigma_p_n` and `Trajectory.sigma_rpy` are as given."""
    cov = np.zeros((len(rpy), 6, 6))
    cov[:, 0, 1] = cov[:, 1, 0] = sigmas[:, 3]
    _, pitch, yaw = rpy.T
    c, s, o = np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)
    # columns: navigation-axis rotation for a small change of roll, of pitch, of yaw
    J = np.stack(
        [
            np.stack([c * np.cos(pitch), s * np.cos(pitch), -np.sin(pitch)], -1),
            np.stack([-s, c, o], -1),
            np.stack([o, o, o + 1], -1),
        ],
        axis=2,
    )
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows is not valid: seen later
        for axis in range(3):
            cov[:, axis, axis] = sigmas[:, axis] ** 2
        cov[:, 3:, 3:] = (J * sigma_rpy[:, None, :] ** 2) @ np.swapaxes(J, 1, 2)
    return cov


def _valid(path: Path, **columns: Array | BoolArray | None) -> Trajectory:
    try:
        return Trajectory(**columns)  # type: ignore[arg-type]
    except ValueError as error:
        raise DataError(f"not a valid trajectory: {error}", path) from error
