"""Clouds by themselves, .ply or .pcd: nobody says when they were taken, so each counts a second.

What needs true times (a speed, other sensors beside the clouds) needs a mission folder, whose
sensor of type clouds names such files with their times.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.series import CloudSeries
from gtsam_nav.solution import Progress, no_progress

NAME = "cloud files"
EXPECTS = "a .ply or .pcd file, or a folder of such, in the order of their names"

SUFFIXES = (".ply", ".pcd")
INTERVAL_S = 1.0


def can_open(path: Path) -> bool:
    """Whether the path is a cloud or a folder that holds one."""
    try:
        return bool(_files(path))
    except (OSError, ValueError):
        return False


def read(path: Path, progress: Progress = no_progress) -> Mission:
    """Name the clouds; none is opened before it is needed.

    Raises
    ------
    DataError
        Where there is none.
    """
    files = _files(path)
    if not files:
        raise DataError(f"no cloud; expected: {EXPECTS}", path)
    progress("read mission", 1.0)
    series = CloudSeries(t=INTERVAL_S * np.arange(len(files), dtype=float), clouds=files)
    mission = Mission(
        name=path.resolve().stem if path.is_file() else path.resolve().name,
        sensors={"clouds": Sensor("clouds", "clouds", series)},
        warnings=(f"the clouds have no times: each is taken {INTERVAL_S:g} s after the last",),
        sources=files,
    )
    return on_mission_time(mission, {"clouds": 0.0})


def _files(path: Path) -> tuple[Path, ...]:
    found = sorted(path.iterdir()) if path.is_dir() else [path]
    return tuple(p for p in found if p.suffix.lower() in SUFFIXES and p.is_file())
