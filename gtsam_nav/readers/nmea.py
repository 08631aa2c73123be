"""NMEA 0183 logs of a vessel: GNSS receiver, compass and speed log, of any talker.

==========  ====================================================================================
GGA         position, height above the geoid and the geoid's own, quality of the fix, HDOP
RMC         date, and speed and course over ground; position where there is no GGA
VTG         speed and course over ground, finer than RMC's
HDT         true heading of two antennas or a gyrocompass
HDG, HDM    magnetic heading, where there is no true one; HDG states the compass's deviation too
VHW         speed through the water
==========  ====================================================================================

Sentences without a time of their own (all but GGA and RMC) are those of the last one that has one.
The date is RMC's; times that pass midnight belong to the next day. A sigma is that of the fix's
quality, or the figure that a card states, times HDOP. Magnetic headings become true ones by the
model of date and place, or by ``declination_deg`` of a card, whatever variation is stated.

The velocity, whose vertical component no sentence tells and which is zero for what floats, goes
with the fixes if all of them have one. Where HDT tells the heading, and no log the speed, it is a
sensor of its own instead, ``speed``: velocity over ground along the vessel's axes, as a DVL has it,
to dead-reckon the vessel by. It is turned by that same heading: the two cannot check each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, Origin
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.readers._figures import NO_FIGURES, Figures
from gtsam_nav.readers._gnss import Fixes
from gtsam_nav.readers._nmea_sentences import (
    KINDS,
    SENTENCE,
    STAND_ALONE,
    TRUE,
    SentenceLog,
    Told,
)
from gtsam_nav.readers._text import first_lines, said_of_end, stream_lines
from gtsam_nav.sensors.noise import DvlNoise, GnssNoise, HeadingNoise
from gtsam_nav.series import BoolArray, DvlSeries, HeadingSeries, IntArray, Series
from gtsam_nav.solution import Progress, no_progress

NAME = "NMEA 0183 log"
EXPECTS = "a text file with $..GGA, $..RMC, $..HDT, $..HDG or $..VHW sentences, plain, .gz or .bz2"
BY_FIGURES = {"gnss": "gnss", "speed": "dvl", "log": "dvl", "heading": "heading"}

LINES_TO_KNOW_IT_BY = 50

SAME_EPOCH_S = 1.0
"""A velocity goes with a fix that is no further away in time."""

SIGMA_BY_QUALITY_M = {STAND_ALONE: GnssNoise().sigma_horizontal_m, 2: 0.6, 3: 0.6, 4: 0.02, 5: 0.3}
"""Horizontal sigma at HDOP 1: stand-alone, differential, PPS, RTK fixed and RTK float."""
VERTICAL_SHARE = GnssNoise().sigma_vertical_m / GnssNoise().sigma_horizontal_m
SPEED_FIGURES = {"sigma_m_s": GnssNoise().sigma_velocity_m_s, "max_speed_m_s": np.inf}
"""Of a velocity that is a receiver's."""

LOG_FIGURES = {"max_speed_m_s": np.inf}
LOG_SCALE_SIGMA = 0.05
"""A paddle wheel is as good as its last calibration."""

NO_TIME = "before the first time of day"
TURNED = (
    "'speed' is turned by 'heading': how these agree says nothing of the heading; and it is the"
    " velocity of the receiver whose fixes 'gnss' has: what is scored on these is no independent"
    " check"
)


def can_open(path: Path) -> bool:
    """Whether the path is a text file that begins with sentences of this kind."""
    found = map(SENTENCE.search, first_lines(path, LINES_TO_KNOW_IT_BY))
    return any(match is not None and match["kind"] in KINDS for match in found)


def read(path: Path, progress: Progress = no_progress, figures: Figures = NO_FIGURES) -> Mission:
    """Read a log.

    Raises
    ------
    DataError
        Where no sentence tells a position or a heading.
    """
    log, line = SentenceLog(), ""
    for k, (line, fraction) in enumerate(stream_lines(path, whole=False)):
        if k % 5000 == 0:
            progress("read mission", fraction)
        log.add(line)
    progress("read mission", 1.0)
    if not (log.fixes or log.rmc_fixes or log.headings[TRUE]):
        raise DataError("no GGA or RMC sentence with a position, and no HDT with a heading", path)
    log.put_on_dates()
    origin, found = _sensors(log, figures)
    mission = Mission(
        name=path.name.removesuffix(".gz").removesuffix(".bz2").removesuffix(".txt"),
        sensors={one.sensor.name: one.sensor for one in found if one.sensor},
        origin=origin,
        start_utc=log.zero_s if log.dated else None,
        rejections=tuple(chain.from_iterable(one.rejections for one in found)),
        warnings=(
            *log.warnings(),
            *chain.from_iterable(one.told for one in found),
            *said_of_end(line),
        ),
        sources=(path,),
    )
    return on_mission_time(mission, dict.fromkeys(BY_FIGURES, 0.0))


@dataclass(frozen=True)
class _Found:
    """A sensor of the log, or none, with what of it was dropped and what there is to say."""

    sensor: Sensor | None = None
    rejections: Sequence[Rejection] = ()
    told: Sequence[str] = ()


def _sensors(log: SentenceLog, figures: Figures) -> tuple[Origin | None, list[_Found]]:
    fixes = _fixes(log, GnssNoise.model_validate(figures.get("gnss", {}))) if log.fixes else None
    origin = fixes.first_usable() if fixes is not None else None
    compass = _compass(log, HeadingNoise.model_validate(figures.get("heading", {})), origin)
    by_water = _log(log, DvlNoise.model_validate({**LOG_FIGURES, **figures.get("log", {})}))
    if fixes is None:
        return origin, [compass, by_water]
    speed = _Found()
    heading = compass.sensor if log.compass == TRUE else None
    if heading and not by_water.sensor and fixes.v_n is not None:
        noise = DvlNoise.model_validate({**SPEED_FIGURES, **figures.get("speed", {})})
        speed = _speed(fixes, heading.series, noise)
        fixes = replace(fixes, v_n=None)
    fixes, told = _all_or_no_velocities(fixes)
    series, rejections = fixes.series("gnss", origin or Origin(0.0, 0.0))
    gnss = Sensor("gnss", "gnss", series) if series else None
    return origin, [compass, by_water, speed, _Found(gnss, rejections, told)]


def _compass(log: SentenceLog, noise: HeadingNoise, origin: Origin | None) -> _Found:
    """True headings, else magnetic ones where something tells the way to true north."""
    told = log.headings[log.compass]
    if log.compass == TRUE:
        return _headings(log, told, noise, {}) if told else _Found()
    if noise.declination_deg:
        return _headings(log, told, noise, {})
    if log.dated and origin is not None:
        return _headings(log, told, noise, {"magnetic": True})
    left_out = (
        f"{len(told)} magnetic headings are left out: without a date (RMC) and a position nothing"
        " tells true north; state declination_deg of 'heading' in a card"
    )
    return _Found(told=[left_out])


def _headings(
    log: SentenceLog, told: Sequence[Told], noise: HeadingNoise, described: Mapping[str, Any]
) -> _Found:
    columns = {
        "t": log.t[[heading.time for heading in told]],
        "heading": np.array([heading.value for heading in told]),
        "sigma": np.full(len(told), np.radians(noise.sigma_deg)),
    }
    series, rejections = tidy(HeadingSeries, "heading", columns, refused=_refused(columns, told))
    sensor = Sensor("heading", "heading", series, noise=described) if series else None
    return _Found(sensor, rejections)


def _log(log: SentenceLog, noise: DvlNoise) -> _Found:
    """The speed log: none where its wheel never turns."""
    told = log.water_speeds
    if not any(speed.value for speed in told if not speed.reason):
        never = f"{len(told)} sentences of a speed log (VHW) tell no speed but 0: left out"
        return _Found(told=[never] if told else [])
    ahead = np.array([speed.value for speed in told])
    columns = {
        "t": log.t[[speed.time for speed in told]],
        "v_d": ahead[:, None] * [1.0, 0.0, 0.0],
        "sigma": np.full(len(told), noise.sigma_m_s),
        "valid": np.ones(len(told)),
        "bottom_lock": np.zeros(len(told)),
    }
    series, rejections = tidy(
        DvlSeries,
        "log",
        columns,
        refused=_refused(columns, told),
        max_speed_m_s=noise.max_speed_m_s,
    )
    described = {"scale_sigma": LOG_SCALE_SIGMA}
    return _Found(Sensor("log", "dvl", series, noise=described) if series else None, rejections)


def _refused(columns: Mapping[str, Array], told: Sequence[Told]) -> dict[str, BoolArray]:
    return {NO_TIME: ~np.isfinite(columns["t"]), **_by_reason([one.reason for one in told])}


def _speed(fixes: Fixes, heading: Series, noise: DvlNoise) -> _Found:
    """The velocities of the fixes along the vessel's axes."""
    assert fixes.v_n is not None
    assert isinstance(heading, HeadingSeries)
    located = np.isfinite(fixes.latitude_deg)
    t, v_n = fixes.t[located], fixes.v_n[located]
    yaw = np.interp(t, heading.t, np.unwrap(heading.heading))
    c, s = np.cos(yaw), np.sin(yaw)
    columns = {
        "t": t,
        "v_d": np.column_stack(
            [c * v_n[:, 0] + s * v_n[:, 1], c * v_n[:, 1] - s * v_n[:, 0], v_n[:, 2]]
        ),
        "sigma": np.full(len(t), noise.sigma_m_s),
        "valid": np.ones(len(t)),
        "bottom_lock": np.ones(len(t)),
    }
    apart = np.abs(t - heading.t[_nearest(heading.t, t)]) > SAME_EPOCH_S
    refused = {"no velocity near": np.isnan(v_n[:, 0]), "no heading near": apart}
    series, rejections = tidy(
        DvlSeries, "speed", columns, refused=refused, max_speed_m_s=noise.max_speed_m_s
    )
    return _Found(Sensor("speed", "dvl", series) if series else None, rejections, [TURNED])


def _all_or_no_velocities(fixes: Fixes) -> tuple[Fixes, list[str]]:
    """The fixes without their velocities where one has none, and what is said of that."""
    if fixes.v_n is None:
        return fixes, []
    located = np.isfinite(fixes.latitude_deg)
    n_without = np.sum(located & np.isnan(fixes.v_n[:, 0]))
    if not n_without:
        return fixes, []
    told = (
        f"the velocities of 'gnss' are left out: {n_without} of {np.sum(located)} fixes have none"
        f" within {SAME_EPOCH_S:g} s, and all need one"
    )
    return replace(fixes, v_n=None), [told]


def _fixes(log: SentenceLog, noise: GnssNoise) -> Fixes:
    latitude, longitude, height = np.array([fix.values for fix in log.fixes]).T
    hdop = np.array([fix.hdop for fix in log.fixes])
    horizontal, vertical = _sigmas([fix.quality for fix in log.fixes], noise)
    t = log.t[[fix.time for fix in log.fixes]]
    return Fixes(
        t=t,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        sigma=hdop[:, None] * np.column_stack([horizontal, horizontal, vertical]),
        v_n=_velocities(log, t),
        has_fix=np.array([fix.has_fix for fix in log.fixes]),
        unread=_by_reason([fix.reason for fix in log.fixes]),
    )


def _sigmas(quality: Sequence[int], noise: GnssNoise) -> tuple[Array, Array]:
    """Horizontal and vertical sigma of each fix at HDOP 1: what is stated, else by quality."""
    stand_alone = SIGMA_BY_QUALITY_M[STAND_ALONE]
    horizontal = np.array([SIGMA_BY_QUALITY_M.get(q, stand_alone) for q in quality])
    if "sigma_horizontal_m" in noise.model_fields_set:
        horizontal[:] = noise.sigma_horizontal_m
    vertical = VERTICAL_SHARE * horizontal
    if "sigma_vertical_m" in noise.model_fields_set:
        vertical[:] = noise.sigma_vertical_m
    return horizontal, vertical


def _velocities(log: SentenceLog, t: Array) -> Array | None:
    """The velocity nearest in time to each fix, NaN where none is near; None of none at all."""
    told = log.velocities_told
    if not told:
        return None
    time, speed, course = (np.array(values) for values in zip(*told, strict=True))
    order = np.argsort(log.t[time], kind="stable")
    stamps = log.t[time][order]
    nearest = _nearest(stamps, t)
    k = order[nearest]
    v_n = np.column_stack([speed * np.cos(course), speed * np.sin(course), 0.0 * speed])[k]
    near = np.abs(stamps[nearest] - t) <= SAME_EPOCH_S
    return np.where(near[:, None], v_n, np.nan)


def _nearest(stamps: Array, t: Array) -> IntArray:
    """Index of the sorted stamp nearest to each time."""
    after = np.minimum(np.searchsorted(stamps, t), len(stamps) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(np.abs(t - stamps[before]) <= np.abs(t - stamps[after]), before, after)


def _by_reason(reasons: Sequence[str]) -> dict[str, BoolArray]:
    listed = np.array(reasons, dtype=object)
    return {reason: listed == reason for reason in sorted({*reasons} - {""})}
