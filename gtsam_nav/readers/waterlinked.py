"""Velocity reports of a Water Linked DVL (A50, A125) as it sends them: one JSON object a line.

``time`` is the number of milliseconds since the report before, so that stamps are sums; newer
firmware also states ``time_of_validity`` in microseconds of UTC, which then counts. Velocities are
along the instrument's axes, forward, starboard, down; ``fom``, the figure of merit, is their sigma;
an altitude of -1 is none. Clients that poll write the same report again: repetitions are no samples
and take no time. A damaged report takes the time that it still tells, else as long as most.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.readers._figures import NO_FIGURES, Figures
from gtsam_nav.readers._text import TRUNCATED, first_lines, said_of_end, stream_lines
from gtsam_nav.sensors.noise import DvlNoise
from gtsam_nav.series import BoolArray, DvlSeries
from gtsam_nav.solution import Progress, no_progress

NAME = "Water Linked JSON"
EXPECTS = "a text file of a Water Linked DVL's JSON reports, one a line, plain, .gz or .bz2"
BY_FIGURES = {"dvl": "dvl"}

NEEDED = ("vx", "vy", "vz", "fom", "altitude", "velocity_valid", "time")
LINES_TO_KNOW_IT_BY = 5
TIME = re.compile(r'"time"\s*:\s*(\d+(?:\.\d+)?)\s*[,}]')
REPEATED, MALFORMED = "repeated report", "malformed report"


def can_open(path: Path) -> bool:
    """Whether the path is a text file that begins with such reports."""
    return any(_report(line) is not None for line in first_lines(path, LINES_TO_KNOW_IT_BY))


def read(path: Path, progress: Progress = no_progress, figures: Figures = NO_FIGURES) -> Mission:
    """Read the reports.

    Raises
    ------
    DataError
        Where no velocity is valid.
    """
    noise = DvlNoise.model_validate(figures.get("dvl", {}))
    rows: list[list[float]] = []
    reasons: list[str] = []
    utc: list[float] = []
    before = line = ""
    last = False
    for line, fraction in stream_lines(path, whole=False):
        progress("read mission", fraction)
        if not line.strip():
            continue
        report = _report(line)
        last = report is None
        if report is None:
            if _is_other_report(line):
                continue
            reason = MALFORMED
        else:
            reason = REPEATED if line == before else ""
        if reason == "" and reasons and reasons[-1] == MALFORMED and _is_part(before, line):
            rows[-1][0] = 0.0  # a log that was polled too often: the time is its intact copy's
        if report is None or reason:
            is_copy = report is not None or _is_part(line, before)
            interval_ms = 0.0 if is_copy else _damaged_interval_ms(line)
            rows.append([interval_ms, *[np.nan] * 4, 0.0, np.nan])
            utc.append(np.nan)
        else:
            rows.append([report["time"], *_numbers(report, noise)])
            utc.append(1e-6 * report.get("time_of_validity", np.nan))
        reasons.append(reason)
        before = line
    if last and reasons and reasons[-1] == MALFORMED:
        reasons[-1] = TRUNCATED
    mission = _mission(path, rows, reasons, utc, noise)
    return replace(mission, warnings=(*mission.warnings, *said_of_end(line)))


def _mission(
    path: Path, rows: list[list[float]], reasons: list[str], utc: list[float], noise: DvlNoise
) -> Mission:
    interval_ms, vx, vy, vz, sigma, valid, altitude_m = np.array(rows).reshape(-1, 7).T
    reported = np.array(reasons) == ""
    told = np.isfinite(interval_ms)
    usual_ms = np.median(interval_ms[reported & told]) if np.any(reported & told) else 0.0
    t = 1e-3 * np.cumsum(np.where(told, interval_ms, usual_ms))
    # the reports' own UTC, where all of them state it
    stamps = np.array(utc)
    dated = bool(np.any(reported)) and bool(np.all(np.isfinite(stamps[reported])))
    columns = {
        "t": stamps if dated else t,
        "v_d": np.column_stack([vx, vy, vz]),
        "sigma": sigma,
        "valid": valid,
        "bottom_lock": np.ones(len(t)),
        "altitude_m": altitude_m,
    }
    refused: dict[str, BoolArray] = {
        reason: np.array(reasons) == reason for reason in sorted({*reasons} - {""})
    }
    series, rejections = tidy(
        DvlSeries, "dvl", columns, refused=refused, max_speed_m_s=noise.max_speed_m_s
    )
    if series is None:
        raise DataError(f"no report holds a valid velocity ({len(rejections)} dropped)", path)
    mission = Mission(
        name=path.name.removesuffix(".gz").removesuffix(".bz2").removesuffix(".txt"),
        sensors={"dvl": Sensor("dvl", "dvl", series)},
        start_utc=0.0 if dated else None,
        rejections=tuple(rejections),
        sources=(path,),
    )
    return on_mission_time(mission, {"dvl": 0.0})


def _report(line: str) -> dict[str, Any] | None:
    """A velocity report; None of what is none, or not whole."""
    try:
        report = json.loads(line, parse_int=float)
    except (ValueError, RecursionError):
        return None
    if not isinstance(report, dict) or any(key not in report for key in NEEDED):
        return None
    numbers = [report[key] for key in NEEDED] + [report.get("time_of_validity", 0)]
    return report if all(isinstance(value, int | float) for value in numbers) else None


def _is_other_report(line: str) -> bool:
    """Whether a line is whole, but of another kind: the position that newer firmware estimates."""
    try:
        report = json.loads(line, parse_int=float)
    except (ValueError, RecursionError):
        return False
    return isinstance(report, dict) and "vx" not in report


def _is_part(line: str, whole: str) -> bool:
    """Whether a damaged line is the larger part of a whole one: what is shorter may be of any."""
    return 2 * len(line) > len(whole) and (whole.startswith(line) or whole.endswith(line))


def _damaged_interval_ms(line: str) -> float:
    """What a damaged report tells of its time; NaN where that is lost, zero where it is none."""
    if told := TIME.search(line):
        return float(told[1])
    return np.nan if any(f'"{key}"' in line for key in NEEDED) else 0.0


def _numbers(report: dict[str, Any], noise: DvlNoise) -> list[float]:
    altitude = report["altitude"]
    return [
        *(float(report[key]) for key in ("vx", "vy", "vz")),
        float(report["fom"]) if report["fom"] > 0 else noise.sigma_m_s,
        float(bool(report["velocity_valid"])),
        float(altitude) if altitude > 0 else np.nan,
    ]
