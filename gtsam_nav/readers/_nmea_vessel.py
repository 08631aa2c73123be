"""What an NMEA log tells of the vessel beside its fixes: heading, speed through water, over ground.

Sentences are those of a talker: of several compasses, or logs, the one that tells most is taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, Origin
from gtsam_nav.mission import Rejection, Sensor
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.readers._clock import nearest_of
from gtsam_nav.readers._gnss import Fixes
from gtsam_nav.readers._nmea_sentences import TRUE, SentenceLog, Told
from gtsam_nav.sensors.declination import declination_deg
from gtsam_nav.sensors.noise import DvlNoise, GnssNoise, HeadingNoise
from gtsam_nav.series import BoolArray, DvlSeries, HeadingSeries

SAME_EPOCH_S = 1.0
"""A velocity goes with a fix, and a heading with both, that is no further away in time."""
NEARLY_ALL = 0.9
"""A true heading is taken where it is told at such a share of a magnetic one's times."""

GATE = {"max_speed_m_s": 50.0}
"""Boats are faster than what a DVL is carried by."""
SPEED_FIGURES = {**GATE, "sigma_m_s": GnssNoise().sigma_velocity_m_s}
"""Of a velocity that is a receiver's."""
LOG_SCALE_SIGMA = 0.05
"""A paddle wheel is as good as its last calibration."""
UNDER_WAY_M_S, LONGEST_FOULED = 1.5, 0.2
"""A log that stands still at such a share of the times at which the fixes are as fast is fouled."""

NO_TIME = "before the first time of day"
TURNED = (
    "'speed' is turned by 'heading': how these agree says nothing of the heading; and it is the"
    " velocity of the receiver whose fixes 'gnss' has: what is scored on these is no independent"
    " check"
)


@dataclass(frozen=True)
class Found:
    """A sensor of the log, or none, with what of it was dropped and what there is to say."""

    sensor: Sensor | None = None
    rejections: Sequence[Rejection] = ()
    told: Sequence[str] = ()
    is_true: bool = False
    """Whether it is a heading that was told from true north."""


def compass(log: SentenceLog, noise: HeadingNoise, origin: Origin | None) -> Found:
    """True headings, else magnetic ones where something tells the way to true north.

    Parameters
    ----------
    log : SentenceLog
    noise : HeadingNoise
        Of a card: a declination, or whether the headings are magnetic, comes before the model.
    origin : Origin or None
        Where the declination is asked for.
    """
    address, told, said = _richest(log.headings)
    if not told:
        return Found()
    is_true = address.endswith(TRUE)
    described: dict[str, Any] = {}
    if not (is_true or noise.model_fields_set & {"declination_deg", "magnetic"}):
        unknown = _unknown_declination(log, origin)
        if unknown:
            left_out = (
                f"{len(told)} magnetic headings are left out: {unknown}; state declination_deg of"
                " 'heading' in a card"
            )
            return Found(told=(*said, left_out))
        described = {"magnetic": True}
    kept, many = _once_a_time(told, "headings")
    columns = {
        "t": log.t[[heading.time for heading in kept]],
        "heading": np.array([heading.value for heading in kept]),
        "sigma": np.full(len(kept), np.radians(noise.sigma_deg)),
    }
    refused = _refused(columns["t"], kept)
    series, rejections = tidy(HeadingSeries, "heading", columns, refused=refused)
    sensor = Sensor("heading", "heading", series, noise=described) if series else None
    return Found(sensor, rejections, (*said, *many), is_true and sensor is not None)


def _unknown_declination(log: SentenceLog, origin: Origin | None) -> str:
    """Why nothing tells where true north is; empty where the model does."""
    if not log.dated:
        return "no RMC sentence tells the date"
    if origin is None:
        return "no fix tells the place"
    try:
        declination_deg(origin, log.zero_s)
    except DataError as error:
        return str(error).split(";")[0]
    return ""


def water_log(log: SentenceLog, figures: Mapping[str, Any], fixes: Fixes | None) -> Found:
    """The speed log: none where its wheel does not turn though the fixes move."""
    noise = DvlNoise.model_validate({**GATE, **figures})
    address, told, said = _richest(log.water_speeds)
    kept, many = _once_a_time(told, "speeds through the water")
    speeds = [speed for speed in kept if not speed.reason]
    if not any(speed.value for speed in speeds):
        none = f"no speed but 0 in {len(told)} sentences of a speed log ({address}): left out"
        return Found(told=(*said, none) if told else ())
    fouled = _fouled(log.t[[s.time for s in speeds]], np.array([s.value for s in speeds]), fixes)
    if fouled > LONGEST_FOULED:
        still = f"the speed log ({address}) stands still at {fouled:.0%} of the times at which"
        return Found(told=(*said, f"{still} the fixes make over {UNDER_WAY_M_S} m/s: left out"))
    columns = {
        "t": log.t[[speed.time for speed in kept]],
        "v_d": np.array([speed.value for speed in kept])[:, None] * [1.0, 0.0, 0.0],
        "sigma": np.full(len(kept), noise.sigma_m_s),
        "valid": np.ones(len(kept)),
        "bottom_lock": np.zeros(len(kept)),
    }
    series, rejections = tidy(
        DvlSeries,
        "log",
        columns,
        refused=_refused(columns["t"], kept),
        max_speed_m_s=noise.max_speed_m_s,
    )
    described = {**GATE, "scale_sigma": LOG_SCALE_SIGMA}
    sensor = Sensor("log", "dvl", series, noise=described) if series else None
    return Found(sensor, rejections, (*said, *many))


def _fouled(t: Array, speed: Array, fixes: Fixes | None) -> float:
    """Share of the times under way, by the fixes, at which a log reads nothing."""
    if fixes is None or fixes.v_n is None:
        return 0.0
    known = np.isfinite(fixes.t) & np.isfinite(fixes.v_n[:, 0])
    stamps, v_n = fixes.t[known], fixes.v_n[known]
    timed = np.isfinite(t)
    if not len(stamps) or not np.any(timed):
        return 0.0
    k = nearest_of(stamps, t[timed])
    under_way = np.linalg.norm(v_n[k], axis=1) > UNDER_WAY_M_S
    under_way &= np.abs(stamps[k] - t[timed]) <= SAME_EPOCH_S
    return float(np.mean(speed[timed][under_way] == 0.0)) if np.any(under_way) else 0.0


def speed_over_ground(fixes: Fixes, heading: Found, figures: Mapping[str, Any]) -> Found:
    """The velocities of the fixes along the vessel's axes."""
    noise = DvlNoise.model_validate({**SPEED_FIGURES, **figures})
    assert fixes.v_n is not None
    assert heading.sensor is not None
    series = heading.sensor.series
    assert isinstance(series, HeadingSeries)
    located = np.isfinite(fixes.latitude_deg)
    t, v_n = fixes.t[located], fixes.v_n[located]
    yaw = np.interp(t, series.t, np.unwrap(series.heading))
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
    apart = np.abs(t - series.t[nearest_of(series.t, t)]) > SAME_EPOCH_S
    refused = {"no velocity near": np.isnan(v_n[:, 0]), "no heading near": apart}
    turned, rejections = tidy(
        DvlSeries, "speed", columns, refused=refused, max_speed_m_s=noise.max_speed_m_s
    )
    if turned is None:
        return Found()
    return Found(Sensor("speed", "dvl", turned, noise=GATE), rejections, (TURNED,))


def _richest(by_address: Mapping[str, list[Told]]) -> tuple[str, list[Told], tuple[str, ...]]:
    """Talker and kind that are taken, what they tell, and what is said of the others.

    They tell something at most times; of those that do at nearly as many, true headings come first.
    """
    times = {
        address: len({one.time for one in told if not one.reason and one.time >= 0})
        for address, told in by_address.items()
    }
    if not times:
        return "", [], ()
    most = max(times.values())
    rich = [address for address, n in times.items() if n >= NEARLY_ALL * most]
    taken = max(rich, key=lambda address: (address.endswith(TRUE), times[address]))
    others = [f"{address} ({len(by_address[address])})" for address in times if address != taken]
    said = (f"{', '.join(others)} are left out: {taken} is taken",) if others else ()
    return taken, by_address[taken], said


def _once_a_time(told: Sequence[Told], what: str) -> tuple[list[Told], tuple[str, ...]]:
    """The first figure of each time, and what is said of those without a time of their own."""
    seen: set[int] = set()
    kept = []
    for one in told:
        if one.reason or one.time not in seen:
            kept.append(one)
        if not one.reason:
            seen.add(one.time)
    spare = len(told) - len(kept)
    if not spare:
        return kept, ()
    return kept, (f"{spare} {what} have no time of their own: the first of each time is taken",)


def _refused(t: Array, told: Sequence[Told]) -> dict[str, BoolArray]:
    return {NO_TIME: ~np.isfinite(t), **by_reason([one.reason for one in told])}


def by_reason(reasons: Sequence[str]) -> dict[str, BoolArray]:
    """Which samples are refused, by reason."""
    listed = np.array(reasons, dtype=object)
    return {reason: listed == reason for reason in sorted({*reasons} - {""})}
