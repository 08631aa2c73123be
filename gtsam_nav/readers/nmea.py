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

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, Origin
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.readers._clock import nearest_of, on_mission_time
from gtsam_nav.readers._figures import NO_FIGURES, Figures
from gtsam_nav.readers._gnss import NO_HEIGHTS, Fixes, without_heights
from gtsam_nav.readers._nmea_sentences import KINDS, SENTENCE, STAND_ALONE, SentenceLog
from gtsam_nav.readers._nmea_vessel import (
    SAME_EPOCH_S,
    Found,
    by_reason,
    compass,
    speed_over_ground,
    water_log,
)
from gtsam_nav.readers._text import first_lines, said_of_end, stream_lines
from gtsam_nav.sensors.noise import GnssNoise, HeadingNoise
from gtsam_nav.solution import Progress, no_progress

NAME = "NMEA 0183 log"
EXPECTS = "a text file with $..GGA, $..RMC, $..HDT, $..HDG or $..VHW sentences, plain, .gz or .bz2"
BY_FIGURES = {"gnss": "gnss", "speed": "dvl", "log": "dvl", "heading": "heading"}

LINES_TO_KNOW_IT_BY = 50

SIGMA_BY_QUALITY_M = {STAND_ALONE: GnssNoise().sigma_horizontal_m, 2: 0.6, 3: 0.6, 4: 0.02, 5: 0.3}
"""Horizontal sigma at HDOP 1: stand-alone, differential, PPS, RTK fixed and RTK float."""
VERTICAL_SHARE = GnssNoise().sigma_vertical_m / GnssNoise().sigma_horizontal_m


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
    if not (log.fixes or log.rmc_fixes or log.headings):
        raise DataError("no GGA or RMC sentence with a position, and none with a heading", path)
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


def _sensors(log: SentenceLog, figures: Figures) -> tuple[Origin | None, list[Found]]:
    noise = GnssNoise.model_validate(figures.get("gnss", {}))
    fixes, told = _fixes(log, noise) if log.fixes else (None, ())
    origin = fixes.first_usable() if fixes is not None else None
    heading = compass(log, HeadingNoise.model_validate(figures.get("heading", {})), origin)
    by_water = water_log(log, figures.get("log", {}), fixes)
    if fixes is None:
        return origin, [heading, by_water]
    speed = Found()
    if heading.is_true and not by_water.sensor and fixes.v_n is not None:
        speed = speed_over_ground(fixes, heading, figures.get("speed", {}))
    fixes = replace(fixes, v_n=None) if speed.sensor else fixes
    fixes, lost = _all_or_no_velocities(fixes)
    series, rejections = fixes.series("gnss", origin or Origin(0.0, 0.0))
    gnss = Sensor("gnss", "gnss", series) if series else None
    return origin, [heading, by_water, speed, Found(gnss, rejections, (*told, *lost))]


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


def _fixes(log: SentenceLog, noise: GnssNoise) -> tuple[Fixes, tuple[str, ...]]:
    """The fixes, and what there is to say of them: RMC's have no heights."""
    latitude, longitude, height = np.array([fix.values for fix in log.fixes]).T
    hdop = np.array([fix.hdop for fix in log.fixes])
    sigma = hdop[:, None] * np.column_stack(_sigmas([fix.quality for fix in log.fixes], noise))
    t = log.t[[fix.time for fix in log.fixes]]
    fixes = Fixes(
        t=t,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        sigma=sigma,
        v_n=_velocities(log, t),
        has_fix=np.array([fix.has_fix for fix in log.fixes]),
        unread=by_reason([fix.reason for fix in log.fixes]),
    )
    if log.fixes is log.rmc_fixes:
        return without_heights(fixes, noise, None), (f"the fixes have {NO_HEIGHTS}",)
    return fixes, ()


def _sigmas(quality: Sequence[int], noise: GnssNoise) -> tuple[Array, Array, Array]:
    """Sigmas north, east and down of each fix at HDOP 1: what is stated, else by quality."""
    stand_alone = SIGMA_BY_QUALITY_M[STAND_ALONE]
    horizontal = np.array([SIGMA_BY_QUALITY_M.get(q, stand_alone) for q in quality])
    if "sigma_horizontal_m" in noise.model_fields_set:
        horizontal[:] = noise.sigma_horizontal_m
    vertical = VERTICAL_SHARE * horizontal
    if "sigma_vertical_m" in noise.model_fields_set:
        vertical[:] = noise.sigma_vertical_m
    return horizontal, horizontal, vertical


def _velocities(log: SentenceLog, t: Array) -> Array | None:
    """The velocity nearest in time to each fix, NaN where none is near; None of none at all."""
    told = log.velocities_told
    if not told:
        return None
    time, speed, course = (np.array(values) for values in zip(*told, strict=True))
    order = np.argsort(log.t[time], kind="stable")
    stamps = log.t[time][order]
    nearest = nearest_of(stamps, t)
    k = order[nearest]
    v_n = np.column_stack([speed * np.cos(course), speed * np.sin(course), 0.0 * speed])[k]
    near = np.abs(stamps[nearest] - t) <= SAME_EPOCH_S
    return np.where(near[:, None], v_n, np.nan)
