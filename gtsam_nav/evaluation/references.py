"""What a trajectory from elsewhere can be scored on: a file of positions, or a mission."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.mission import Rejection, Sensor
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.preprocess.gnss_policy import GnssSettings, split_fixes
from gtsam_nav.readers import is_trajectory, open_mission
from gtsam_nav.readers._table import read_table
from gtsam_nav.series import ReferenceSeries
from gtsam_nav.solution import Progress, no_progress
from gtsam_nav.writers.frame import Frame
from gtsam_nav.writers.trajectories import read_trajectory


def open_reference(
    path: Path, gnss: GnssSettings, progress: Progress = no_progress, frame: Frame = "ned"
) -> tuple[Sensor, list[str]]:
    """Open a reference.

    Parameters
    ----------
    path : Path
        A ``.tum``, ``.kitti`` or ``.txt`` file of poses (see `read_trajectory`) or a ``.csv`` in
        the columns of a mission folder's reference (t, n, e, d[, roll_deg, pitch_deg, yaw_deg]
        [, sigma]), in mission time and the local frame; or a mission.
    gnss : GnssSettings
        Of a mission without a reference of its own the fixes that this policy withholds are taken.
    progress : Progress, optional
    frame : {"ned", "enu"}
        Of a file of poses.

    Returns
    -------
    reference : Sensor
    warnings : list of str
        What of it is left out.

    Raises
    ------
    DataError
        Where the file or mission cannot be read, or holds nothing to score on.
    """
    if path.suffix in (".tum", ".kitti") or (path.suffix == ".txt" and is_trajectory(path)):
        trajectory = read_trajectory(path, frame)
        series = ReferenceSeries(t=trajectory.t, p_n=trajectory.p_n, rpy=trajectory.rpy)
        return Sensor(path.name, "reference", series), []
    if path.suffix == ".csv" or path.suffixes[-2:] == [".csv", ".gz"]:
        return _read_positions(path)
    mission = open_mission(path, progress)
    _, reference, _ = split_fixes(mission, gnss)
    if reference is None:
        raise DataError(
            "the mission has no reference, and the GNSS policy withholds no fix to score on; "
            "set gnss.use in the configuration",
            path,
        )
    return reference, _said_of(r for r in mission.rejections if r.sensor == reference.name)


def _read_positions(path: Path) -> tuple[Sensor, list[str]]:
    attitude = ("roll_deg", "pitch_deg", "yaw_deg")
    table = read_table(path, ("t", "n", "e", "d"), (*attitude, "sigma"))
    columns = {"t": table.columns["t"]}
    columns["p_n"] = np.column_stack([table.columns[name] for name in ("n", "e", "d")])
    if table.has(attitude):
        columns["rpy"] = np.radians(np.column_stack([table.columns[name] for name in attitude]))
    if table.has(("sigma",)):
        columns["sigma"] = table.columns["sigma"]
    series, rejections = tidy(ReferenceSeries, path.name, columns)
    rejections += table.cut(path.name)
    if series is None:
        raise DataError(f"no valid position ({len(rejections)} dropped)", path)
    return Sensor(path.name, "reference", series), _said_of(rejections)


def _said_of(rejections: Iterable[Rejection]) -> list[str]:
    reasons = Counter(rejection.reason for rejection in rejections)
    counted = ", ".join(f"{n} x {reason}" for reason, n in sorted(reasons.items()))
    return [f"positions of the reference are left out: {counted}"] if counted else []
