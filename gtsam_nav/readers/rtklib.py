"""RTK positions of RTKLIB beside the log of an IMU with its time tag (card ``rtk_mems_car``).

``X.pos`` (plain or .gz) is RTKLIB's solution in latitude, longitude and height. The IMU's log is
``Y.csv`` (plain or .gz) without a header: ax, ay, az (g), gx, gy, gz (deg/s), time since power-up
(ms); ``Y.csv.tag`` is the time tag that RTKLIB's stream server wrote beside it. Where a folder
holds several logs, a .pos file names the mission, and the IMU's log is the one whose name ends in
the same ``_NUMBER``.

Stamps are GPS time until `on_mission_time`; ``start_utc`` knows of the leap seconds.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtsam_nav.cards import Card, load_card
from gtsam_nav.errors import DataError
from gtsam_nav.frames import STANDARD_GRAVITY_M_S2, Origin
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.readers._rows import parse_rows
from gtsam_nav.readers._rtklib_pos import leap_seconds, read_fixes
from gtsam_nav.readers._rtklib_tag import read_time_tag
from gtsam_nav.readers._table import truncation
from gtsam_nav.readers._text import read_lines
from gtsam_nav.sensors.noise import GnssNoise
from gtsam_nav.series import ImuSeries, Series
from gtsam_nav.solution import Progress, no_progress

NAME = "RTKLIB with an IMU"
EXPECTS = (
    "a folder with X.pos, the IMU's Y.csv (plain or .gz) and its time tag Y.csv.tag; or the .pos"
)

POS, CSV, TAG = (".pos", ".pos.gz"), (".csv", ".csv.gz"), ".csv.tag"
IMU_COLUMNS = ("ax", "ay", "az", "gx", "gy", "gz", "t")

Cleaned = tuple[Series | None, list[Rejection]]


@dataclass(frozen=True)
class _Files:
    pos: Path
    csv: Path
    tag: Path


def can_open(path: Path) -> bool:
    """Whether the path is a .pos file, or a folder with one or with an IMU's time tag."""
    try:
        if path.is_dir():
            return bool(_ending(path, *POS) or _ending(path, TAG))
        return path.is_file() and path.name.endswith(POS)
    except (OSError, ValueError):
        return False


def read(path: Path, progress: Progress = no_progress) -> Mission:
    """Read positions and IMU.

    Raises
    ------
    DataError
        Where one of the three files is missing or ambiguous, malformed, or of another log than the
        others.
    """
    files = _files(path)
    card = load_card("rtk_mems_car")
    noise = GnssNoise.model_validate(card.sensors["gnss"].noise)
    progress("read mission", 0.0)
    fixes, cut_stamp = read_fixes(files.pos, noise)
    origin = fixes.first_usable(card.origin.height_m)
    gnss, gnss_rejections = fixes.series("gnss", origin or Origin(0.0, 0.0))
    cleaned: dict[str, Cleaned] = {
        "imu": _read_imu(files.csv, files.tag),
        "gnss": (gnss, gnss_rejections + truncation("gnss", len(fixes.t), cut_stamp)),
    }
    progress("read mission", 1.0)

    sensors, rejections, warnings = _mounted(cleaned, card)
    stamps = next((s.series.t for s in sensors.values()), np.zeros(1))
    mission = Mission(
        name=files.pos.name.removesuffix(".gz").removesuffix(".pos"),
        sensors=sensors,
        origin=origin,
        start_utc=-leap_seconds(float(np.median(stamps))),
        constraints=card.constraints.to_constraints(),
        rejections=tuple(rejections),
        warnings=(*warnings, *_borrowed(files, card)),
        sources=(files.pos, files.csv, files.tag),
    )
    offsets = {name: card.sensors[name].time_offset_s for name in cleaned}
    return on_mission_time(mission, offsets)


def _borrowed(files: _Files, card: Card) -> tuple[str, ...]:
    """What to tell of a log that the card was not written for."""
    digest = hashlib.sha256(files.tag.read_bytes()).hexdigest()
    if digest in {file.sha256 for file in card.files}:
        return ()
    return (
        f"{files.pos.name}: mounting, clock offset, noise and motion constraints are taken from the"
        f" card of '{card.name}', as if the same vehicle had recorded it",
    )


def _mounted(
    cleaned: dict[str, Cleaned], card: Card
) -> tuple[dict[str, Sensor], list[Rejection], list[str]]:
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
    return sensors, rejections, warnings


def _ending(folder: Path, *endings: str) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.name.endswith(endings) and p.is_file())


def _stem(path: Path) -> str:
    """A file's name without what says its kind."""
    name = path.name
    for ending in (TAG, *POS[::-1], *CSV[::-1]):
        name = name.removesuffix(ending)
    return name


def _files(path: Path) -> _Files:
    folder = path if path.is_dir() else path.parent
    positions = [path] if path.is_file() else _ending(folder, *POS)
    if not positions:
        raise DataError(f"no file with positions, *.pos; {NAME} needs {EXPECTS}", folder)
    if len(positions) > 1:
        choices = ", ".join(str(p) for p in positions)
        raise DataError(f"several files with positions; the choices are: {choices}", folder)
    csv = _imu_log(folder, positions[0])
    tag = folder / f"{csv.name.removesuffix('.gz')}.tag"
    if not tag.is_file():
        raise DataError(f"no time tag {tag.name} beside {csv.name}", folder)
    return _Files(positions[0], csv, tag)


def _imu_log(folder: Path, pos: Path) -> Path:
    """The IMU's log that belongs to a file of positions."""
    logs = _ending(folder, *CSV)
    tagged = [p for p in logs if (folder / f"{p.name.removesuffix('.gz')}.tag").is_file()]
    candidates = {_stem(p): p for p in tagged or logs}  # plain comes first, .gz stands in
    if len(candidates) > 1:
        number = _stem(pos).rpartition("_")[2]
        candidates = {s: p for s, p in candidates.items() if s.rpartition("_")[2] == number}
    if len(candidates) != 1:
        found = ", ".join(p.name for p in logs) or "none"
        wanted = f"IMU log *.csv with its time tag *{TAG} for {pos.name}"
        raise DataError(f"no single {wanted}; csv files: {found}", folder)
    return next(iter(candidates.values()))


def _read_imu(path: Path, tag: Path) -> Cleaned:
    lines = read_lines(path)
    # the stamp is the last field: without a line break behind it nobody knows whether it is whole
    cut = bool(lines[-1].strip())
    rows = parse_rows(lines[:-1], path, IMU_COLUMNS, delimiter=",", may_begin_cut=True)
    values = rows.values
    cut_stamp = np.nan if cut or rows.cut_stamp is not None else None
    t_ms = values[:, 6]
    columns = {
        "t": read_time_tag(tag).stamps(t_ms, path),
        "accel_i": values[:, :3] * STANDARD_GRAVITY_M_S2,
        "gyro_i": np.radians(values[:, 3:6]),
    }
    series, rejections = tidy(ImuSeries, "imu", columns, refused=rows.first_cut)
    return series, rejections + truncation("imu", len(values), cut_stamp)
