"""The original ASCII logs of the St. Pere Pescador mission (card ``stpere``).

The logs hold raw instrument readings; the card holds mounting, noise and clock offsets. The IMU
stays in its own axes with its mounting; headings and tilts become those of the vehicle:
``heading = MTi yaw - 86 deg``, vehicle roll about -MTi pitch, vehicle pitch about MTi roll.

Of the DVL a sample with bottom lock gives the velocity over ground; one that has water lock alone
gives the velocity through the water (``bottom_lock`` False); one without either is invalid.

The sonar is ``*_IS.log`` (plain or .gz), and ``*_IS.simulated.log`` only where that is missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gtsam_nav.cards import Card, load_card
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, Origin
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.readers._beam_log import read_beams
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.readers._gnss import Fixes
from gtsam_nav.readers._mounting import in_body_axes
from gtsam_nav.readers._rows import Rows, parse_rows
from gtsam_nav.readers._table import truncation
from gtsam_nav.readers._text import read_lines
from gtsam_nav.sensors.noise import AttitudeNoise, DepthNoise, DvlNoise, GnssNoise, HeadingNoise
from gtsam_nav.series import (
    AttitudeSeries,
    DepthSeries,
    DvlSeries,
    HeadingSeries,
    ImuSeries,
    Series,
)
from gtsam_nav.solution import Progress, no_progress

NAME = "St. Pere logs"
EXPECTS = "a folder with *_DVL.log, *_MTi.log, *_DGPS.log and *_IS.log of one mission"

LOGS = ("_DVL.log", "_MTi.log", "_DGPS.log")
RECORDED_SONAR = ("_IS.log", "_IS.log.gz")
SIMULATED_SONAR = ("_IS.simulated.log", "_IS.simulated.log.gz")

DVL_COLUMNS = (
    "t", "year", "month", "day", "hour", "minute", "second",
    "water_x", "water_y", "water_z", "water_status",
    "bottom_x", "bottom_y", "bottom_z", "bottom_status",
    "range_1", "range_2", "range_3", "amplitude_1", "amplitude_2", "amplitude_3", "good_pings",
    "heading", "pitch", "roll", "temperature", "pressure", "power", "slosv", "elosv",
    "travel_x", "travel_y",
)  # fmt: skip
MTI_COLUMNS = ("t", "roll", "pitch", "yaw", "gx", "gy", "gz", "ax", "ay", "az")
DGPS_COLUMNS = (
    "t", "latitude", "longitude", "status", "altitude", "geoid", "course", "magnetic_course",
    "knots", "km_h",
)  # fmt: skip

NO_READING = 32767.0
"""What the DVL writes into fields that it could not measure."""

GOOD = 1.0
PRESSURE_AT_SURFACE = 1440.0
METRES_PER_PRESSURE_COUNT = 0.003772250
BIN_M = 0.1

Cleaned = tuple[str, Series | None, list[Rejection]]


def can_open(path: Path) -> bool:
    """Whether the path is a folder with one of the mission's logs."""
    return path.is_dir() and any(_with_suffix(path, suffix) for suffix in LOGS)


def read(path: Path, progress: Progress = no_progress) -> Mission:
    """Read the logs of the mission.

    Raises
    ------
    DataError
        Where a log other than the sonar's is missing, or any is malformed.
    """
    card = load_card("stpere")
    dvl, mti, dgps = (_only(path, suffix) for suffix in LOGS)
    sonar, simulated = _sonar_log(path)
    warnings: list[str] = []

    read_series = [*_read_dvl(dvl, card), *_read_mti(mti, card)]
    fixes_series, origin = _read_dgps(dgps, card)
    read_series.append(fixes_series)
    if sonar is None:
        warnings.append(f"no sonar log: none of {', '.join(RECORDED_SONAR + SIMULATED_SONAR)}")
    else:
        read_series.append(("sonar", *read_beams(sonar, "sonar", BIN_M, progress)))

    sensors: dict[str, Sensor] = {}
    rejections: list[Rejection] = []
    for name, series, dropped in read_series:
        rejections += dropped
        if series is None:
            warnings.append(
                f"sensor '{name}' is left out: no valid sample ({len(dropped)} dropped)"
            )
            continue
        sensor = _mounted(name, series, card)
        sensors[name] = replace(sensor, simulated=simulated and name == "sonar")
    mission = Mission(
        name=card.name,
        sensors=sensors,
        origin=origin,
        start_utc=0.0,
        rejections=tuple(rejections),
        warnings=tuple(warnings),
        sources=tuple(log for log in (dvl, mti, dgps, sonar) if log is not None),
    )
    offsets = {name: entry.time_offset_s for name, entry in card.sensors.items()}
    return on_mission_time(mission, offsets)


def _with_suffix(folder: Path, suffix: str) -> list[Path]:
    return sorted(p for p in folder.glob(f"*{suffix}") if p.is_file())


def _only(folder: Path, suffix: str) -> Path:
    found = _with_suffix(folder, suffix)
    if not found:
        raise DataError(f"no file *{suffix}; {NAME} need {', '.join(LOGS)}", folder)
    if len(found) > 1:
        names = ", ".join(p.name for p in found)
        raise DataError(f"several missions in one folder: {names}; keep one", folder)
    return found[0]


def _sonar_log(folder: Path) -> tuple[Path | None, bool]:
    """The sonar's log, and whether it is simulated."""
    for suffixes, simulated in ((RECORDED_SONAR, False), (SIMULATED_SONAR, True)):
        for suffix in suffixes:
            if _with_suffix(folder, suffix):
                return _only(folder, suffix), simulated
    return None, False


def _mounted(name: str, series: Series, card: Card) -> Sensor:
    entry = card.sensors[name]
    sensor = Sensor(
        name=name,
        type=entry.type,
        series=series,
        xyz_b=entry.xyz_b,
        R_bs=entry.R_bs,
        noise=entry.noise,
        time_offset_sigma_s=entry.time_offset_sigma_s,
    )
    return in_body_axes(sensor)


def _rows(path: Path, names: Sequence[str]) -> Rows:
    lines = read_lines(path, encoding="latin-1")
    first = next((k for k, line in enumerate(lines) if not _is_header(line)), len(lines))
    return parse_rows(lines[first:], path, names, first_line=first + 1)


def _is_header(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith("%")


def _read_dvl(path: Path, card: Card) -> list[Cleaned]:
    rows = _rows(path, DVL_COLUMNS)
    c = dict(zip(DVL_COLUMNS, rows.values.T, strict=True))
    noise = DvlNoise.model_validate(card.sensors["dvl"].noise)
    bottom = np.column_stack([c["bottom_x"], c["bottom_y"], c["bottom_z"]])
    water = np.column_stack([c["water_x"], c["water_y"], c["water_z"]])
    has_bottom = (c["bottom_status"] == GOOD) & ~np.any(bottom == NO_READING, axis=1)
    has_water = (c["water_status"] == GOOD) & ~np.any(water == NO_READING, axis=1)
    valid = has_bottom | has_water
    velocity_cm_s = np.where(has_bottom[:, None], bottom, water)
    velocity_cm_s[~valid] = 0.0
    columns = {
        "t": c["t"],
        "v_d": velocity_cm_s / 100.0,
        "sigma": np.full(len(c["t"]), noise.sigma_m_s),
        "valid": valid,
        "bottom_lock": has_bottom,
    }
    dvl, dvl_rejections = tidy(DvlSeries, "dvl", columns, max_speed_m_s=noise.max_speed_m_s)
    depth_columns = {
        "t": c["t"],
        "depth_m": METRES_PER_PRESSURE_COUNT * (c["pressure"] - PRESSURE_AT_SURFACE),
        "sigma": np.full(
            len(c["t"]), DepthNoise.model_validate(card.sensors["depth"].noise).sigma_m
        ),
    }
    no_reading = {"no reading": c["pressure"] == NO_READING}
    depth, depth_rejections = tidy(DepthSeries, "depth", depth_columns, refused=no_reading)
    return [
        ("dvl", dvl, dvl_rejections + truncation("dvl", len(c["t"]), rows.cut_stamp)),
        ("depth", depth, depth_rejections + truncation("depth", len(c["t"]), rows.cut_stamp)),
    ]


def _read_mti(path: Path, card: Card) -> list[Cleaned]:
    rows = _rows(path, MTI_COLUMNS)
    c = dict(zip(MTI_COLUMNS, rows.values.T, strict=True))
    roll, pitch, yaw = np.radians([c["roll"], c["pitch"], c["yaw"]])
    sigma_heading = HeadingNoise.model_validate(card.sensors["heading"].noise).sigma_deg
    sigma_tilt = AttitudeNoise.model_validate(card.sensors["attitude"].noise).sigma_deg

    def constant_deg(value: float) -> Array:
        return np.full(len(yaw), np.radians(value))

    columns: dict[str, tuple[type[Series], dict[str, Array]]] = {
        "heading": (HeadingSeries, {"heading": yaw, "sigma": constant_deg(sigma_heading)}),
        "attitude": (
            AttitudeSeries,
            {"roll": roll, "pitch": pitch, "sigma": constant_deg(sigma_tilt)},
        ),
        "imu": (
            ImuSeries,
            {
                "gyro_i": np.column_stack([c["gx"], c["gy"], c["gz"]]),
                "accel_i": np.column_stack([c["ax"], c["ay"], c["az"]]),
            },
        ),
    }
    cleaned: list[Cleaned] = []
    for name, (series_type, measured) in columns.items():
        series, rejections = tidy(series_type, name, {"t": c["t"], **measured})
        cut = truncation(name, len(yaw), rows.cut_stamp)
        cleaned.append((name, series, rejections + cut))
    return cleaned


def _read_dgps(path: Path, card: Card) -> tuple[Cleaned, Origin | None]:
    rows = _rows(path, DGPS_COLUMNS)
    c = dict(zip(DGPS_COLUMNS, rows.values.T, strict=True))
    noise = GnssNoise.model_validate(card.sensors["gnss"].noise)
    horizontal, vertical = noise.sigma_horizontal_m, noise.sigma_vertical_m
    fixes = Fixes(
        t=c["t"],
        latitude_deg=_degrees(c["latitude"]),
        longitude_deg=_degrees(c["longitude"]),
        height_m=c["altitude"],
        sigma=np.tile([horizontal, horizontal, vertical], (len(c["t"]), 1)),
        # 1 is GPS, 2 DGPS by the log's legend
        has_fix=(c["status"] == 1) | (c["status"] == 2),
    )
    origin = fixes.first_usable(card.origin.height_m)
    series, rejections = fixes.series("gnss", origin or Origin(0.0, 0.0))
    rejections += truncation("gnss", len(c["t"]), rows.cut_stamp)
    return ("gnss", series, rejections), origin


def _degrees(ddmm: Array) -> Array:
    """Degrees of ``ddmm.mmmm``; the logs are north and east of zero."""
    whole = np.floor(ddmm / 100.0)
    return np.asarray(whole + (ddmm - 100.0 * whole) / 60.0)
