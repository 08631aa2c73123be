"""Ranges to radio beacons beside dead reckoning: the Plaza files of GTSAM (card ``plaza``).

A mission is ``Plaza1_.mat``, or ``Plaza1_DR.txt`` and ``Plaza1_TD.txt`` (no truth), named by one of
them or by what they begin with (``FOLDER/Plaza1``). Where there is a .mat it alone is read.

=====  =========================================================================================
DR     time, distance and turn since the row before
TD     time, transmitter, beacon, range; nothing tells the bearing
GT     time, x, y and a heading, which is not read: its zero differs from file to file
TL     beacon, x, y, as surveyed
=====  =========================================================================================

Metres, seconds and radians, counter-clockwise; x becomes north and y west. A row of DR is the mean
over its interval and is stamped in the middle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtsam_nav.cards import load_card
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import LandmarkMap, Mission, Rejection, Sensor
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.readers._figures import NO_FIGURES, Figures
from gtsam_nav.readers._mat5 import read_tables
from gtsam_nav.readers._rows import Rows, parse_rows
from gtsam_nav.readers._table import truncation
from gtsam_nav.readers._text import read_lines
from gtsam_nav.sensors.noise import LandmarkNoise, OdometryNoise
from gtsam_nav.series import LandmarkSeries, OdometrySeries, ReferenceSeries, Series
from gtsam_nav.solution import Progress, no_progress

NAME = "Plaza"
EXPECTS = "NAME_.mat, or NAME_DR.txt and NAME_TD.txt, named by one of them or as FOLDER/NAME"
BY_FIGURES = {"odometry": "odometry", "landmarks": "landmarks"}

MAT, DR, TD = "_.mat", "_DR.txt", "_TD.txt"
COLUMNS: Mapping[str, tuple[str, ...]] = {
    "DR": ("time", "distance", "turn"),
    "TD": ("time", "transmitter", "beacon", "range"),
    "GT": ("time", "x", "y", "heading"),
    "TL": ("beacon", "x", "y"),
}
SURVEY_SIGMA_M = 0.05
"""Of beacons that were surveyed by RTK GNSS, which the files do not state."""

Cleaned = tuple[Series | None, list[Rejection]]


@dataclass(frozen=True)
class _Files:
    """What the files of a mission hold; None where they lack it."""

    dr: Rows
    td: Rows
    truth: Rows | None
    survey: Array | None
    sources: tuple[Path, ...]


def can_open(path: Path) -> bool:
    """Whether the path is one of the files, what they begin with, or a folder of them."""
    try:
        if path.is_file():
            return path.name.endswith((MAT, DR, TD))
        return bool(_stems(path)) if path.is_dir() else path.name in _stems(path.parent)
    except (OSError, ValueError):
        return False


def read(path: Path, progress: Progress = no_progress, figures: Figures = NO_FIGURES) -> Mission:
    """Read dead reckoning and ranges.

    Raises
    ------
    DataError
        Where a folder holds several missions, a file is missing or malformed.
    """
    stem = _stem(path)
    card = load_card("plaza")
    stated = {name: {**card.sensors[name].noise, **figures.get(name, {})} for name in BY_FIGURES}
    progress("read mission", 0.0)
    mat = stem.with_name(stem.name + MAT)
    files = _read_mat(mat) if mat.is_file() else _read_texts(stem)
    cleaned: dict[str, Cleaned] = {
        "odometry": _odometry(files.dr, OdometryNoise.model_validate(stated["odometry"])),
        "landmarks": _ranges(files.td, LandmarkNoise.model_validate(stated["landmarks"])),
    }
    if files.truth is not None:
        cleaned["reference"] = _truth(files.truth)
    progress("read mission", 1.0)
    warnings = [
        f"sensor '{name}' is left out: no valid sample ({len(dropped)} dropped)"
        for name, (series, dropped) in cleaned.items()
        if series is None
    ]
    sensors = {
        name: Sensor(name, card.sensors[name].type, series, noise=card.sensors[name].noise)
        for name, (series, _) in cleaned.items()
        if series is not None
    }
    mission = Mission(
        name=stem.name,
        sensors=sensors,
        landmark_map=None if files.survey is None else _survey(files.survey, mat),
        constraints=card.constraints.to_constraints(),
        rejections=tuple(r for _, dropped in cleaned.values() for r in dropped),
        warnings=tuple(warnings),
        sources=files.sources,
    )
    return on_mission_time(mission, dict.fromkeys(cleaned, 0.0))


def _stems(folder: Path) -> list[str]:
    if not folder.is_dir():
        return []
    endings = (MAT, DR)
    names = [p.name for p in folder.iterdir()]
    return sorted({n.removesuffix(e) for n in names for e in endings if n.endswith(e)})


def _stem(path: Path) -> Path:
    """What the files of the one mission that a path names begin with."""
    if path.is_file():
        ending = next(e for e in (MAT, DR, TD) if path.name.endswith(e))
        return path.with_name(path.name.removesuffix(ending))
    if not path.is_dir():
        return path
    stems = _stems(path)
    if len(stems) > 1:
        choices = ", ".join(str(path / stem) for stem in stems)
        raise DataError(f"several missions in one folder; the choices are: {choices}", path)
    return path / stems[0]


def _read_texts(stem: Path) -> _Files:
    paths = {kind: stem.with_name(stem.name + e) for kind, e in (("DR", DR), ("TD", TD))}
    for path in paths.values():
        if not path.is_file():
            raise DataError(f"no file {path.name}; needed are {EXPECTS}", stem.parent)
    dr, td = (
        parse_rows(read_lines(path), path, COLUMNS[kind], may_begin_cut=True)
        for kind, path in paths.items()
    )
    return _Files(dr, td, None, None, tuple(paths.values()))


def _read_mat(path: Path) -> _Files:
    contents = read_tables(path)
    tables: dict[str, Array] = {}
    for kind, names in COLUMNS.items():
        if kind in contents:
            tables[kind] = contents[kind]
            if tables[kind].shape[1] != len(names):
                raise DataError(f"{kind} must be a table of {', '.join(names)}", path)
    if lacking := [kind for kind in ("DR", "TD") if kind not in tables]:
        raise DataError(f"holds no table {lacking[0]} of {', '.join(COLUMNS[lacking[0]])}", path)
    truth = Rows(tables["GT"]) if "GT" in tables else None
    return _Files(Rows(tables["DR"]), Rows(tables["TD"]), truth, tables.get("TL"), (path,))


def _odometry(rows: Rows, noise: OdometryNoise) -> Cleaned:
    t, distance, turn = rows.values.T
    step = np.diff(t)
    # nobody knows when the first interval began: it is taken to be as long as the second
    step = np.concatenate([step[:1], step]) if len(step) else np.full(len(t), np.nan)
    step = np.where(step > 0, step, np.nan)
    with np.errstate(over="ignore", invalid="ignore"):
        speed, rate = distance / step, turn / step
    columns = {
        "t": t - step / 2,
        "v_b": np.column_stack([speed, np.zeros(len(t))]),
        "yaw_rate": -rate,
        "sigma_v": np.full(len(t), noise.sigma_v_m_s),
        "sigma_yaw_rate": np.full(len(t), noise.sigma_yaw_rate_rad_s),
    }
    series, rejections = tidy(OdometrySeries, "odometry", columns, refused=rows.first_cut)
    return series, rejections + truncation("odometry", len(t), rows.cut_stamp)


def _ranges(rows: Rows, noise: LandmarkNoise) -> Cleaned:
    t, _, beacon, range_m = rows.values.T
    columns = {
        "t": t,
        "id": beacon,
        "range_m": range_m,
        "sigma_range": np.full(len(t), noise.sigma_range_m),
    }
    fractional = np.isfinite(beacon) & (beacon != np.floor(beacon))
    refused = {**rows.first_cut, "fractional id": fractional}
    series, rejections = tidy(LandmarkSeries, "landmarks", columns, refused=refused)
    return series, rejections + truncation("landmarks", len(t), rows.cut_stamp)


def _truth(rows: Rows) -> Cleaned:
    t, x, y, _ = rows.values.T
    columns = {"t": t, "p_n": np.column_stack([x, -y, np.zeros(len(t))])}
    return tidy(ReferenceSeries, "reference", columns, vertical_usable=False)


def _survey(table: Array, path: Path) -> LandmarkMap:
    ids, x, y = table.T
    if not np.all(np.isfinite(table)) or np.any(ids != np.floor(ids)):
        raise DataError("TL holds values that are no numbers, or beacons with a fraction", path)
    if len(np.unique(ids)) < len(ids):
        raise DataError("TL gives a beacon twice", path)
    p_n = np.column_stack([x, -y, np.zeros(len(ids))])
    return LandmarkMap(ids.astype(np.int64), p_n, np.full(len(ids), SURVEY_SIGMA_M))
