"""Logs of scanning-sonar beams as text: tens of megabytes, parsed in one pass."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.mission import BeamSeries, Rejection
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.readers._table import truncation
from gtsam_nav.readers._text import read_bytes
from gtsam_nav.solution import Progress

CHUNK_BYTES = 8_000_000
LEADING_FIELDS = 3
"""Stamp, the sonar's own time, head angle; bins follow."""


def read_beams(
    path: Path, sensor_name: str, resolution_m: float, progress: Progress
) -> tuple[BeamSeries | None, list[Rejection]]:
    """Beams of a log whose lines are ``t s, sensor time ms, head angle rad, bins 0..255``.

    Raises
    ------
    DataError
        Where the file is missing or a line is malformed. A last line that was cut off is rejected.
    """
    from gtsam_nav.readers._beam_text import parse_beams

    data = read_bytes(path)
    n_bins = _bins_of_first_beam(data)
    if n_bins < 1:
        return None, truncation(sensor_name, 0, np.nan if n_bins > -LEADING_FIELDS else None)
    # a bin takes two bytes at least, which bounds the beams that a file can hold
    n_lines = min(data.count(b"\n"), len(data) // (2 * n_bins)) + 2
    stamps, angles = np.empty(n_lines), np.empty(n_lines)
    intensity = np.empty((n_lines, n_bins), dtype=np.uint8)
    too_strong = np.empty(n_lines, dtype=bool)
    n, start, cut_stamp = 0, 0, None
    while start < len(data):
        stop = data.find(b"\n", start + CHUNK_BYTES) + 1 or len(data)
        text = np.frombuffer(data, dtype=np.uint8, count=stop - start, offset=start)
        parsed, fault = parse_beams(text, stamps[n:], angles[n:], intensity[n:], too_strong[n:])
        n += int(parsed)
        if fault >= 0:
            cut_stamp = _stamp_of_cut_line(data, start + int(fault), n_bins, path)
            break
        start = stop
        progress("read sonar", start / len(data))
    series, rejections = tidy(
        BeamSeries,
        sensor_name,
        {"t": stamps[:n], "angle": angles[:n], "intensity": intensity[:n]},
        refused={"echo outside 0..255": too_strong[:n]},
        resolution_m=resolution_m,
    )
    return series, rejections + truncation(sensor_name, n, cut_stamp)


def _bins_of_first_beam(data: bytes) -> int:
    """Bins of the first line that is no comment; -3 where there is no such line."""
    start = 0
    while start < len(data):
        stop = data.find(b"\n", start) + 1 or len(data)
        line = data[start:stop].strip()
        if line and not line.startswith(b"%"):
            return len(line.replace(b",", b" ").split()) - LEADING_FIELDS
        start = stop
    return -LEADING_FIELDS


def _stamp_of_cut_line(data: bytes, offset: int, n_bins: int, path: Path) -> float:
    """The stamp of a last line that was cut off; any other malformed line is an error."""
    stop = data.find(b"\n", offset) + 1 or len(data)
    fields = data[offset:stop].replace(b",", b" ").split()
    if data[stop:].strip() or len(fields) > n_bins + LEADING_FIELDS:
        raise DataError(
            f"malformed beam of {len(fields)} fields; needed are a stamp, a time, an angle and "
            f"{n_bins} bins of 0 to 255",
            path,
            data.count(b"\n", 0, offset) + 1,
        )
    try:
        return float(fields[0]) if len(fields) > 1 else float("nan")
    except ValueError:
        return float("nan")
