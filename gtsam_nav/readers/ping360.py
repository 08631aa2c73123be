"""Text dumps of a Blue Robotics Ping360: a folder of files with one line a beam.

======================  ==========================================================================
angle.dat               head angle, gradians (400 to the turn), clockwise seen from above
data.dat                echo bytes as ``0x00 0x1f ..``
number_of_samples.dat   how many of them the beam has; fewer than most have: a cut message
sample_period.dat       ticks of 25 ns; a sample is this times half the speed of sound long
timestamp.dat           time of day, hh mm ss mmm, every digit written as ``0x00d``
======================  ==========================================================================
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.readers._text import read_lines
from gtsam_nav.series import BeamSeries, BoolArray
from gtsam_nav.solution import Progress, no_progress

NAME = "Ping360 dump"
FILES = ("angle.dat", "data.dat", "number_of_samples.dat", "sample_period.dat", "timestamp.dat")
EXPECTS = f"a folder with {', '.join(FILES)}"

SOUND_SPEED_M_S = 1500.0
"""The sonar's own default, which its range settings go by."""
TICK_S = 25e-9
GRADIAN_RAD = np.pi / 200.0
DIGITS = 9
DIGIT_S = np.array([36000.0, 3600.0, 600.0, 60.0, 10.0, 1.0, 0.1, 0.01, 0.001])
DAY_S = 86400.0

CUT, MALFORMED, OTHER_RANGE = "cut message", "malformed line", "another range"


def can_open(path: Path) -> bool:
    """Whether the path is a folder with the angles and the echoes."""
    try:
        return all((path / name).is_file() for name in FILES[:2])
    except (OSError, ValueError):
        return False


def read(path: Path, progress: Progress = no_progress) -> Mission:
    """Read a dump.

    Raises
    ------
    DataError
        Where a file is missing, or no beam is whole.
    """
    progress("read mission", 0.0)
    missing = [name for name in FILES if not (path / name).is_file()]
    if missing:
        raise DataError(f"{missing[0]} is missing; {NAME} is {EXPECTS}", path)
    lines = {name: [x for x in read_lines(path / name) if x.strip()] for name in FILES}
    n = min(len(rows) for rows in lines.values())
    warnings = [
        f"{name} has {len(rows)} lines, {len(rows) - n} more than the shortest file: left out"
        for name, rows in lines.items()
        if len(rows) > n
    ]
    angle, n_samples, period = (_numbers(lines[FILES[k]][:n]) for k in (0, 2, 3))
    t = _unrolled(np.array([_seconds(line) for line in lines["timestamp.dat"][:n]]))
    echoes = [_echoes(line) for line in lines["data.dat"][:n]]

    held = np.array([-1 if e is None else len(e) for e in echoes])
    n_bins = _commonest(held[held > 0], path)
    usual = _commonest(period[np.isfinite(period) & (period >= 1)], path)
    refused: dict[str, BoolArray] = {
        MALFORMED: (held < 0) | ~np.isfinite(angle) | ~np.isfinite(n_samples),
        CUT: (n_samples < n_bins) | (held < n_bins),
        OTHER_RANGE: (period != usual) | (n_samples > n_bins) | (held > n_bins),
    }
    whole = ~np.any([*refused.values()], axis=0)
    intensity = np.zeros((n, int(n_bins)), dtype=np.uint8)
    for k in np.flatnonzero(whole).tolist():
        if (echo := echoes[k]) is not None:
            intensity[k] = echo
    series, rejections = tidy(
        BeamSeries,
        "sonar",
        {"t": t, "angle": angle * GRADIAN_RAD, "intensity": intensity},
        refused=refused,
        resolution_m=usual * TICK_S * SOUND_SPEED_M_S / 2,
    )
    progress("read mission", 1.0)
    if series is None:
        raise DataError(f"no beam is whole ({len(rejections)} dropped)", path)
    mission = Mission(
        name=path.resolve().name,
        sensors={"sonar": Sensor("sonar", "beams", series)},
        rejections=tuple(rejections),
        warnings=(f"sound speed is taken as {SOUND_SPEED_M_S:.0f} m/s", *warnings),
        sources=tuple(path / name for name in FILES),
    )
    return on_mission_time(mission, {"sonar": 0.0})


def _numbers(lines: list[str]) -> Array:
    """One number a line; NaN where there is none."""
    found = []
    for line in lines:
        try:
            found.append(float(line))
        except ValueError:
            found.append(np.nan)
    return np.array(found)


def _seconds(line: str) -> float:
    """Time of day; NaN where the nine digits are not there."""
    try:
        digits = [int(word, 16) for word in line.split()]
    except ValueError:
        return np.nan
    if len(digits) != DIGITS or not all(0 <= digit <= 9 for digit in digits):
        return np.nan
    return float(DIGIT_S @ digits)


def _unrolled(t: Array) -> Array:
    """Times of day that go on after midnight."""
    steps = np.diff(t, prepend=t[:1])
    return t + DAY_S * np.cumsum(steps < -DAY_S / 2)


def _echoes(line: str) -> Array | None:
    """Echo bytes; None where one is none."""
    try:
        values = [int(word, 16) for word in line.split()]
    except ValueError:
        return None
    return np.array(values) if values and min(values) >= 0 and max(values) < 256 else None


def _commonest(values: Array, path: Path) -> float:
    """The value of most; of several such, the smallest."""
    counted = Counter(values.tolist())
    if not counted:
        raise DataError("no beam holds echoes and a sample period", path)
    return float(min(counted, key=lambda value: (-counted[value], value)))
