"""RTKLIB's solution files: epochs with latitude, longitude and height in degrees and metres."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date
from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.readers._gnss import Fixes
from gtsam_nav.readers._rows import parse_rows
from gtsam_nav.readers._text import read_lines
from gtsam_nav.sensors.noise import GnssNoise

COLUMNS = (
    "time", "latitude", "longitude", "height", "Q", "ns", "sdn", "sde", "sdu", "sdne", "sdeu",
    "sdun", "age", "ratio",
)  # fmt: skip
VELOCITY_COLUMNS = ("vn", "ve", "vu", "sdvn", "sdve", "sdvu", "sdvne", "sdveu", "sdvun")
COORDINATES = ("latitude(deg)", "longitude(deg)", "height(m)")

FIX_QUALITIES = (1, 2, 3, 4, 5, 6)
"""Fixed, float, SBAS, DGPS, single, PPP; 0 is none."""

EPOCH = date(1970, 1, 1)
WEEK_S = 604_800.0
GPS_EPOCH = 315_964_800.0
"""Week 0 of GPS in seconds since 1970."""

LEAP_SECONDS = (
    ("2017-01-01", 18.0),
    ("2015-07-01", 17.0),
    ("2012-07-01", 16.0),
    ("2009-01-01", 15.0),
    ("2006-01-01", 14.0),
    ("1999-01-01", 13.0),
)
"""By which GPS time leads UTC from a day on; the latest first."""


TIME_SYSTEM = re.compile(r"%\s+(GPST|UTC|JST)\s(.*)")


def leap_seconds(gps_time: float) -> float:
    """By how much GPS time leads UTC, s; ``gps_time`` counts from 1970."""
    for day, lead in LEAP_SECONDS:
        if gps_time >= _midnight(day.replace("-", "/")) + lead:
            return lead
    return 0.0


def read_fixes(path: Path, noise: GnssNoise) -> tuple[Fixes, float | None]:
    """Fixes in GPS time, s since 1970, and the stamp of a last line that was cut off.

    A standard deviation that the file gives as zero is that of the noise figures; velocities that
    are zero throughout are absent.

    Raises
    ------
    DataError
        Where the file is missing or malformed, or is not written in degrees and GPST or UTC.
    """
    lines = read_lines(path, encoding="latin-1")
    is_utc = _is_utc(lines, path)
    body = ["" if line.startswith("%") else _with_joined_stamp(line) for line in lines]
    n_fields = max((len(line.split()) for line in body), default=0)
    names = COLUMNS if n_fields <= len(COLUMNS) else COLUMNS + VELOCITY_COLUMNS
    rows = parse_rows(body, path, names, may_begin_cut=True)
    c = dict(zip(names, rows.values.T, strict=True))
    t = c["time"] + _lead_of_utc(c["time"]) if is_utc else c["time"]
    sigma = np.column_stack([c["sdn"], c["sde"], c["sdu"]])
    figures = (noise.sigma_horizontal_m, noise.sigma_horizontal_m, noise.sigma_vertical_m)
    v_n = np.column_stack([c["vn"], c["ve"], -c["vu"]]) if "vn" in c else None
    fixes = Fixes(
        t=t,
        latitude_deg=c["latitude"],
        longitude_deg=c["longitude"],
        height_m=c["height"],
        sigma=np.where(sigma == 0, figures, sigma),
        v_n=v_n if np.any(v_n) else None,
        has_fix=np.isin(c["Q"], FIX_QUALITIES),
        unread=rows.first_cut,
    )
    return fixes, rows.cut_stamp


def _is_utc(lines: Sequence[str], path: Path) -> bool:
    """Whether the header, where there is one, says UTC and not GPST."""
    for number, line in enumerate(lines, start=1):
        if heading := TIME_SYSTEM.match(line):
            system, columns = heading.groups()
            if system == "JST" or any(name not in columns for name in COORDINATES):
                raise DataError(
                    f"is written in {line.lstrip('% ')[:60].rstrip()} ...; needed are GPST or UTC"
                    f" and {', '.join(COORDINATES)}: solution format llh in degrees",
                    path,
                    number,
                )
            return system == "UTC"
    return False


def _lead_of_utc(utc: Array) -> float:
    finite = utc[np.isfinite(utc)]
    return leap_seconds(float(np.median(finite))) if len(finite) else 0.0


def _with_joined_stamp(line: str) -> str:
    """The line with its two leading fields, date and time or week and its second, as one number."""
    fields = line.split(None, 2)
    if len(fields) < 3:
        return line
    try:
        stamp = str(_gps_time(fields[0], fields[1]))
    except (ValueError, OverflowError):
        stamp = f"{fields[0]}_{fields[1]}"
    return f"{stamp} {fields[2]}"


def _gps_time(day: str, time: str) -> float:
    if "/" not in day:
        return GPS_EPOCH + WEEK_S * int(day) + float(time)
    hours, minutes, seconds = time.split(":")
    return _midnight(day) + 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds)


def _midnight(day: str) -> float:
    """Seconds from 1970 to a day, YYYY/MM/DD."""
    year, month, day_of_month = map(int, day.split("/"))
    return 86_400.0 * (date(year, month, day_of_month) - EPOCH).days
