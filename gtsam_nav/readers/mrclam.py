"""Ground robots of the UTIAS MRCLAM data sets (card ``mrclam``): each robot is a mission.

A robot is named by any of its files (``D6_Robot3_Odometry.dat.gz``), by what these names begin with
(``mrclam6/D6_Robot3``, or ``mrclam6/Robot3`` where no other robot is called so), or by a folder
that holds no other robot.

The files count x and y of their own frame, z up, angles counter-clockwise. Here x is north, y is
west, so that yaw, yaw rate and bearing change sign. Landmarks keep their subject numbers; sightings
of other robots and of barcodes that nobody carries are rejected, and so is what the motion capture
saw before the robot measured anything or after.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gtsam_nav.cards import Card, load_card
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import LandmarkMap, Mission, Rejection, Sensor
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.readers._rows import Rows, parse_rows
from gtsam_nav.readers._table import truncation
from gtsam_nav.readers._text import read_lines
from gtsam_nav.sensors.noise import LandmarkNoise, OdometryNoise
from gtsam_nav.series import LandmarkSeries, OdometrySeries, ReferenceSeries, Series
from gtsam_nav.solution import Progress, no_progress

NAME = "UTIAS MRCLAM"
EXPECTS = (
    "a robot's *Robot3_Odometry.dat, *Robot3_Measurement.dat and *Barcodes.dat (plain or .gz),"
    " named by one of them or as FOLDER/Robot3"
)

ODOMETRY, MEASUREMENT, GROUNDTRUTH = "Odometry", "Measurement", "Groundtruth"
_ROBOT_FILE = re.compile(
    rf"(?P<stem>.*Robot\d+)_(?:{ODOMETRY}|{MEASUREMENT}|{GROUNDTRUTH})\.dat(?:\.gz)?"
)
_STEM = re.compile(r".*Robot\d+")

N_ROBOTS = 5
"""Subjects 1 to 5 are robots, the others landmarks."""

LEAST_SURVEY_SIGMA_M = 1e-3
"""Accuracy of the motion-capture system; the file's figures are scatters about its mean."""

UNKNOWN_BARCODE = "unknown barcode"

WEST = np.array([1.0, -1.0])
"""Maps (x, y) of the files to north and east."""

Cleaned = tuple[Series | None, list[Rejection]]


@dataclass(frozen=True)
class _Robot:
    """Where a robot's files are, and what their names begin with."""

    folder: Path
    stem: str

    @property
    def prefix(self) -> str:
        """What the names of the files that all robots share begin with."""
        return _split(self.stem)[0]

    def file(self, name: str) -> Path | None:
        """The plain or the gzipped file of that name, where there is one."""
        plain = self.folder / f"{name}.dat"
        zipped = plain.with_name(f"{plain.name}.gz")
        return next((path for path in (plain, zipped) if path.is_file()), None)

    def needed(self, name: str) -> Path:
        """The file of that name."""
        path = self.file(name)
        if path is None:
            raise DataError(f"no file {name}.dat or {name}.dat.gz", self.folder)
        return path


def can_open(path: Path) -> bool:
    """Whether the path names a robot's file, the stem of such files, or a folder of them."""
    try:
        if path.is_dir():
            return bool(_stems(path))
        if path.exists():
            return _ROBOT_FILE.fullmatch(path.name) is not None
        return _STEM.fullmatch(path.name) is not None and bool(_stems(path.parent))
    except (OSError, ValueError):
        return False


def read(path: Path, progress: Progress = no_progress) -> Mission:
    """Read what one robot measured.

    Raises
    ------
    DataError
        Where a folder holds several robots or not the one that is asked for, the odometry, the
        measurements or the barcodes are missing, or a file is malformed.
    """
    robot = _robot(path)
    card = load_card("mrclam")
    barcodes = robot.needed(f"{robot.prefix}Barcodes")
    odometry = robot.needed(f"{robot.stem}_{ODOMETRY}")
    measurement = robot.needed(f"{robot.stem}_{MEASUREMENT}")
    survey = robot.file(f"{robot.prefix}Landmark_Groundtruth")
    truth = robot.file(f"{robot.stem}_{GROUNDTRUTH}")

    progress("read mission", 0.0)
    cleaned: dict[str, Cleaned] = {
        "odometry": _read_odometry(odometry, card),
        "landmarks": _read_sightings(measurement, _subjects(barcodes), card),
    }
    if truth is not None:
        measured = [series.t for series, _ in cleaned.values() if series is not None]
        cleaned["reference"] = _read_truth(truth, measured)
    progress("read mission", 1.0)

    sensors: dict[str, Sensor] = {}
    rejections: list[Rejection] = []
    warnings: list[str] = []
    for name, (series, dropped) in cleaned.items():
        rejections += dropped
        if series is None:
            warnings.append(
                f"sensor '{name}' is left out: no valid sample ({len(dropped)} dropped)"
            )
            continue
        entry = card.sensors[name]
        sensors[name] = Sensor(
            name,
            entry.type,
            series,
            xyz_b=entry.xyz_b,
            R_bs=entry.R_bs,
            noise=entry.noise,
            time_offset_sigma_s=entry.time_offset_sigma_s,
        )
    mission = Mission(
        name=robot.stem if robot.prefix else f"{robot.folder.resolve().name}_{robot.stem}",
        sensors=sensors,
        start_utc=0.0,
        landmark_map=None if survey is None else _read_survey(survey),
        constraints=card.constraints.to_constraints(),
        rejections=tuple(rejections),
        warnings=tuple(warnings),
        sources=tuple(p for p in (odometry, measurement, barcodes, survey, truth) if p is not None),
    )
    offsets = {name: card.sensors[name].time_offset_s for name in cleaned}
    return on_mission_time(mission, offsets)


def _stems(folder: Path) -> list[str]:
    """What the names of each robot's files begin with."""
    if not folder.is_dir():
        return []
    found = {m["stem"] for p in folder.iterdir() if (m := _ROBOT_FILE.fullmatch(p.name))}
    return sorted(found)


def _robot(path: Path) -> _Robot:
    """The one robot that a path names."""
    name = _ROBOT_FILE.fullmatch(path.name)
    if name is not None and path.is_file():
        return _Robot(path.parent, name["stem"])
    folder, wanted = (path, "") if path.is_dir() else (path.parent, path.name)
    stems = _stems(folder)
    meant = [stem for stem in stems if wanted in ("", stem, _split(stem)[1])]
    if len(meant) != 1:
        what = "several robots, each a mission of its own" if meant else "no robot of that name"
        choices = ", ".join(str(folder / stem) for stem in meant or stems)
        raise DataError(f"{what}; the choices are: {choices}", path)
    return _Robot(folder, meant[0])


def _split(stem: str) -> tuple[str, str]:
    """What stands before the robot in a stem, and the robot: ``D6_`` and ``Robot3``."""
    prefix, robot, number = stem.rpartition("Robot")
    return prefix, robot + number


def _rows(path: Path, names: Sequence[str], *, is_log: bool = True) -> Rows:
    lines = ["" if line.lstrip().startswith("#") else line for line in read_lines(path)]
    return parse_rows(lines, path, names, may_begin_cut=is_log)


def _read_odometry(path: Path, card: Card) -> Cleaned:
    rows = _rows(path, ("time", "forward velocity", "angular velocity"))
    t, speed, rate = rows.values.T
    noise = OdometryNoise.model_validate(card.sensors["odometry"].noise)
    columns = {
        "t": t,
        "v_b": np.column_stack([speed, np.zeros_like(speed)]),
        "yaw_rate": -rate,
        "sigma_v": np.full(len(t), noise.sigma_v_m_s),
        "sigma_yaw_rate": np.full(len(t), noise.sigma_yaw_rate_rad_s),
    }
    series, rejections = tidy(OdometrySeries, "odometry", columns, refused=rows.first_cut)
    return series, rejections + truncation("odometry", len(t), rows.cut_stamp)


def _read_sightings(path: Path, subjects: dict[int, int], card: Card) -> Cleaned:
    rows = _rows(path, ("time", "barcode", "range", "bearing"))
    t, barcode, range_m, bearing = rows.values.T
    noise = LandmarkNoise.model_validate(card.sensors["landmarks"].noise)
    subject = np.array([subjects.get(code, np.nan) for code in barcode.tolist()], dtype=float)
    columns = {
        "t": t,
        "id": subject,
        "range_m": range_m,
        "bearing": -bearing,
        "sigma_range": np.full(len(t), noise.sigma_range_m),
        "sigma_bearing": np.full(len(t), np.radians(noise.sigma_bearing_deg)),
    }
    refused = {
        **rows.first_cut,
        UNKNOWN_BARCODE: np.isfinite(barcode) & np.isnan(subject),
        "another robot": subject <= N_ROBOTS,
    }
    series, dropped = tidy(LandmarkSeries, "landmarks", columns, refused=refused)
    rejections = [
        replace(r, reason=f"{UNKNOWN_BARCODE} {barcode[r.index]:g}")
        if r.reason == UNKNOWN_BARCODE
        else r
        for r in dropped
    ]
    return series, rejections + truncation("landmarks", len(t), rows.cut_stamp)


def _read_truth(path: Path, measured: Sequence[Array]) -> Cleaned:
    rows = _rows(path, ("time", "x", "y", "orientation"))
    t, x, y, orientation = rows.values.T
    zero = np.zeros(len(t))
    columns = {
        "t": t,
        "p_n": np.column_stack([x, -y, zero]),
        "rpy": np.column_stack([zero, zero, -orientation]),
    }
    refused = dict(rows.first_cut)
    if measured:
        first, last = min(own[0] for own in measured), max(own[-1] for own in measured)
        refused["while nothing was measured"] = (t < first) | (t > last)
    series, rejections = tidy(
        ReferenceSeries, "reference", columns, refused=refused, vertical_usable=False
    )
    return series, rejections + truncation("reference", len(t), rows.cut_stamp)


def _subjects(path: Path) -> dict[int, int]:
    """Subject of each barcode."""
    values = _whole_rows(path, ("subject", "barcode"), 2)
    subjects = {int(barcode): int(subject) for subject, barcode in values}
    if not subjects or len(subjects) < len(values):
        raise DataError("must give each subject one barcode that no other has", path)
    return subjects


def _read_survey(path: Path) -> LandmarkMap:
    values = _whole_rows(path, ("subject", "x", "y", "x std-dev", "y std-dev"), 1)
    ids = values[:, 0].astype(np.int64)
    if len(np.unique(ids)) < len(ids):
        raise DataError("a landmark is given twice", path)
    p_n = np.column_stack([values[:, 1:3] * WEST, np.zeros(len(ids))])
    return LandmarkMap(ids, p_n, np.maximum(np.max(values[:, 3:], axis=1), LEAST_SURVEY_SIGMA_M))


def _whole_rows(path: Path, names: Sequence[str], n_integers: int) -> Array:
    """A small table, which must be whole; its leading columns hold whole numbers."""
    rows = _rows(path, names, is_log=False)
    integers = rows.values[:, :n_integers]
    if rows.cut_stamp is not None:
        raise DataError("the last line is cut off", path)
    if not np.all(np.isfinite(rows.values)) or np.any(integers != np.floor(integers)):
        whole = ", ".join(names[:n_integers])
        raise DataError(f"holds values that are no numbers, or {whole} with a fraction", path)
    return rows.values
