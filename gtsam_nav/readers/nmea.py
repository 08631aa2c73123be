"""NMEA 0183 logs of a GNSS receiver: GGA, RMC, VTG and HDT sentences of any talker.

==========  ====================================================================================
GGA         position, height above the geoid and the geoid's own, quality of the fix, HDOP
RMC         date, and speed and course over ground; position where there is no GGA
VTG         speed and course over ground, finer than RMC's
HDT         true heading of two antennas
==========  ====================================================================================

Sentences without a time of their own (VTG, HDT) are those of the last one that has one. The date
is RMC's; times that pass midnight belong to the next day. A sigma is that of the fix's quality
times HDOP.

The velocity, whose vertical component no sentence tells and which is zero for what floats, goes
with the fixes if all of them have one. Where HDT tells the heading it becomes a sensor of its own
instead, ``speed``: velocity over ground along the vessel's axes, as a DVL has it, to dead-reckon
the vessel by. It is turned by that same heading: the two cannot check each other.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, Origin
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.readers._gnss import Fixes
from gtsam_nav.readers._text import first_lines, said_of_end, stream_lines
from gtsam_nav.sensors.noise import GnssNoise, HeadingNoise
from gtsam_nav.series import BoolArray, DvlSeries, HeadingSeries, IntArray, Series
from gtsam_nav.solution import Progress, no_progress

NAME = "NMEA 0183 log"
EXPECTS = "a text file with $..GGA, $..RMC, $..VTG or $..HDT sentences, plain, .gz or .bz2"

SENTENCE = re.compile(
    r"\$(?P<body>[A-Z]{2}(?P<kind>[A-Z]{3}),[^*$]*)(?:\*(?P<sum>[0-9A-Fa-f]{2}))?\s*$"
)
KINDS = ("GGA", "RMC", "VTG", "HDT")
LINES_TO_KNOW_IT_BY = 50

DAY_S = 86400.0
KNOT_M_S = 1852.0 / 3600.0
KM_H_M_S = 1.0 / 3.6
SAME_EPOCH_S = 1.0
"""A velocity goes with a fix that is no further away in time."""
SLOW_M_S = GnssNoise().sigma_velocity_m_s
"""Receivers leave the course of what is as slow empty: it is at rest, for all that they know."""

SIGMA_BY_QUALITY_M = {1: GnssNoise().sigma_horizontal_m, 2: 0.6, 3: 0.6, 4: 0.02, 5: 0.3}
"""Horizontal sigma at HDOP 1: stand-alone, differential, PPS, RTK fixed and RTK float."""
VERTICAL_SHARE = GnssNoise().sigma_vertical_m / GnssNoise().sigma_horizontal_m

NO_TIME = "before the first time of day"
BAD_CHECKSUM, NO_CHECKSUM, MALFORMED = "wrong checksum", "no checksum", "malformed sentence"


def can_open(path: Path) -> bool:
    """Whether the path is a text file that begins with sentences of this kind."""
    found = map(SENTENCE.search, first_lines(path, LINES_TO_KNOW_IT_BY))
    return any(match is not None and match["kind"] in KINDS for match in found)


def read(path: Path, progress: Progress = no_progress) -> Mission:
    """Read a log.

    Raises
    ------
    DataError
        Where no sentence tells a position or a heading.
    """
    log, line = _Log(), ""
    for k, (line, fraction) in enumerate(stream_lines(path, whole=False)):
        if k % 5000 == 0:
            progress("read mission", fraction)
        log.add(line)
    progress("read mission", 1.0)
    if not (log.fixes or log.rmc_fixes or log.headings):
        raise DataError("no GGA or RMC sentence with a position, and no HDT with a heading", path)
    log.put_on_dates()
    origin, sensors, rejections, told = _sensors(log)
    mission = Mission(
        name=path.name.removesuffix(".gz").removesuffix(".bz2").removesuffix(".txt"),
        sensors=sensors,
        origin=origin,
        start_utc=log.zero_s if log.dated else None,
        rejections=tuple(rejections),
        warnings=(*log.warnings(), *told, *said_of_end(line)),
        sources=(path,),
    )
    return on_mission_time(mission, dict.fromkeys(("gnss", "speed", "heading"), 0.0))


@dataclass
class _Fix:
    """A GGA, or an RMC's position; NaN where it is none, and why."""

    time: int
    values: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    sigma_m: float = np.nan
    reason: str = ""
    has_fix: bool = True


@dataclass
class _Log:
    """What the sentences say, in their order; ``time`` counts in ``clock``."""

    clock: list[tuple[float, float | None]] = field(default_factory=list)
    """Time of day (s) and, from RMC, the POSIX time of the day's start."""
    fixes: list[_Fix] = field(default_factory=list)
    rmc_fixes: list[_Fix] = field(default_factory=list)
    velocities: dict[str, list[tuple[int, float, float]]] = field(
        default_factory=lambda: {"VTG": [], "RMC": []}
    )
    """Time, speed (m/s) and course (rad)."""
    headings: list[tuple[int, float, str]] = field(default_factory=list)
    """Time, heading (rad) and why it is none."""
    others: Counter[str] = field(default_factory=Counter)
    garbled: int = 0
    unsummed: int = 0
    summed: int = 0
    t: Array = field(default_factory=lambda: np.empty(0))
    zero_s: float = 0.0
    dated: bool = False

    def add(self, line: str) -> None:
        """One line."""
        match = SENTENCE.search(line)
        if match is None:
            self.garbled += bool(line.strip())
            return
        kind, body = match["kind"], match["body"]
        if kind not in KINDS:
            self.others[kind] += 1
            return
        reason = self._checksum_fault(body, match["sum"])
        try:
            if not reason:
                getattr(self, f"_{kind.lower()}")(body.split(","))
                return
        except (ValueError, IndexError):
            reason = MALFORMED
        self._refuse(kind, reason)

    def _checksum_fault(self, body: str, stated: str | None) -> str:
        if stated is None:
            self.unsummed += 1
            # a line that lost its end in a log of sentences that have one
            return NO_CHECKSUM if self.summed else ""
        self.summed += 1
        checksum = 0
        for character in body:
            checksum ^= ord(character)
        return "" if checksum == int(stated, 16) else BAD_CHECKSUM

    def _refuse(self, kind: str, reason: str) -> None:
        if kind == "GGA":
            self.fixes.append(_Fix(self._now, reason=reason))
        elif kind == "HDT":
            self.headings.append((self._now, np.nan, reason))
        else:
            self.garbled += 1

    @property
    def _now(self) -> int:
        return len(self.clock) - 1

    def _tick(self, text: str, day_s: float | None = None) -> int:
        hours, minutes, seconds = int(text[:2]), int(text[2:4]), float(text[4:])
        if not (hours < 24 and minutes < 60 and 0 <= seconds < 61):
            raise ValueError("no time of day")
        self.clock.append((3600.0 * hours + 60.0 * minutes + seconds, day_s))
        return self._now

    def _gga(self, f: list[str]) -> None:
        now = self._tick(f[1])
        quality = int(f[6] or 0)
        if quality == 0 or not f[2]:
            self.fixes.append(_Fix(now, has_fix=False))
            return
        height = float(f[9]) + float(f[11] or 0.0)
        values = (_degrees(f[2], f[3]), _degrees(f[4], f[5]), height)
        sigma = SIGMA_BY_QUALITY_M.get(quality, SIGMA_BY_QUALITY_M[1]) * float(f[8] or 1.0)
        self.fixes.append(_Fix(now, values, sigma))

    def _rmc(self, f: list[str]) -> None:
        day = datetime.strptime(f[9], "%d%m%y").replace(tzinfo=UTC).timestamp() if f[9] else None
        now = self._tick(f[1], day)
        if f[2] != "A":
            self.rmc_fixes.append(_Fix(now, has_fix=False))
            return
        values = (_degrees(f[3], f[4]), _degrees(f[5], f[6]), 0.0)
        self.rmc_fixes.append(_Fix(now, values, SIGMA_BY_QUALITY_M[1]))
        if f[7]:
            self._velocity("RMC", float(f[7]) * KNOT_M_S, f[8])

    def _vtg(self, f: list[str]) -> None:
        speed = float(f[7]) * KM_H_M_S if f[7] else float(f[5]) * KNOT_M_S
        if self._now >= 0:
            self._velocity("VTG", speed, f[1])

    def _velocity(self, kind: str, speed: float, course_deg: str) -> None:
        if course_deg:
            self.velocities[kind].append((self._now, speed, np.radians(float(course_deg))))
        elif speed <= SLOW_M_S:
            self.velocities[kind].append((self._now, 0.0, 0.0))

    def _hdt(self, f: list[str]) -> None:
        reason = "" if f[1] else "no heading"
        heading = np.radians(float(f[1])) if f[1] else np.nan
        self.headings.append((self._now, heading, reason))

    def put_on_dates(self) -> None:
        """Give every time of day its day: the nearest to the one before, or RMC's own."""
        self.fixes = self.fixes or self.rmc_fixes
        dates = [(s, day) for s, day in self.clock if day is not None]
        self.dated = bool(dates)
        before = sum(dates[0]) if dates else (self.clock[0][0] if self.clock else 0.0)
        stamps = []
        for seconds, day in self.clock:
            nearest = DAY_S * round((before - seconds) / DAY_S)
            before = seconds + (nearest if day is None else day)
            stamps.append(before)
        self.zero_s = float(np.floor(stamps[0])) if stamps else 0.0
        # what came before the first time has none
        self.t = np.append(np.array(stamps) - self.zero_s, np.nan)

    @property
    def velocities_told(self) -> list[tuple[int, float, float]]:
        """VTG's, else RMC's."""
        return self.velocities["VTG"] or self.velocities["RMC"]

    def warnings(self) -> list[str]:
        """What was not read."""
        found = []
        if self.others:
            listed = ", ".join(f"{kind} ({n})" for kind, n in self.others.most_common(6))
            found.append(f"sentences of other kinds are left out: {listed}")
        if self.garbled:
            found.append(f"{self.garbled} lines are no whole sentence and left out")
        if self.unsummed and not self.summed:
            found.append("the sentences have no checksums: damage goes unnoticed")
        if self.headings and self.velocities_told:
            found.append(
                "'speed' is turned by 'heading': how these agree says nothing of the heading; and"
                " it is the velocity of the receiver whose fixes 'gnss' has: what is scored on"
                " these is no independent check"
            )
        if not self.dated:
            found.append("no RMC sentence tells the date: mission time has no UTC")
        return found


def _degrees(text: str, hemisphere: str) -> float:
    """From dddmm.mmmm and N, S, E or W."""
    whole, dot, _ = text.partition(".")
    if not (dot or whole) or hemisphere not in ("N", "S", "E", "W"):
        raise ValueError("no latitude or longitude")
    degrees = float(text[: len(whole) - 2]) + float(text[len(whole) - 2 :]) / 60.0
    return -degrees if hemisphere in ("S", "W") else degrees


def _sensors(log: _Log) -> tuple[Origin | None, dict[str, Sensor], list[Rejection], list[str]]:
    found: dict[str, Series | None] = {}
    rejections: list[Rejection] = []
    told: list[str] = []
    origin = None
    if log.headings:
        found["heading"], dropped = _headings(log)
        rejections += dropped
    heading = found.get("heading")
    if log.fixes:
        fixes = _fixes(log)
        origin = fixes.first_usable()
        if isinstance(heading, HeadingSeries) and fixes.v_n is not None:
            found["speed"], dropped = _speed(fixes, heading)
            rejections += dropped
            fixes = replace(fixes, v_n=None)
        fixes, told = _all_or_no_velocities(fixes)
        found["gnss"], dropped = fixes.series("gnss", origin or Origin(0.0, 0.0))
        rejections += dropped
    kinds = {"gnss": "gnss", "speed": "dvl", "heading": "heading"}
    sensors = {
        name: Sensor(name, kind, series)
        for name, kind in kinds.items()
        if (series := found.get(name)) is not None
    }
    return origin, sensors, rejections, told


def _headings(log: _Log) -> tuple[HeadingSeries | None, list[Rejection]]:
    time, heading, reasons = zip(*log.headings, strict=True)
    t = log.t[list(time)]
    sigma = np.full(len(t), np.radians(HeadingNoise().sigma_deg))
    columns = {"t": t, "heading": np.array(heading), "sigma": sigma}
    refused = {NO_TIME: ~np.isfinite(t), **_by_reason(reasons)}
    return tidy(HeadingSeries, "heading", columns, refused=refused)


def _speed(fixes: Fixes, heading: HeadingSeries) -> tuple[DvlSeries | None, list[Rejection]]:
    """The velocities of the fixes along the vessel's axes."""
    assert fixes.v_n is not None
    located = np.isfinite(fixes.latitude_deg)
    t, v_n = fixes.t[located], fixes.v_n[located]
    yaw = np.interp(t, heading.t, np.unwrap(heading.heading))
    c, s = np.cos(yaw), np.sin(yaw)
    columns = {
        "t": t,
        "v_d": np.column_stack(
            [c * v_n[:, 0] + s * v_n[:, 1], c * v_n[:, 1] - s * v_n[:, 0], v_n[:, 2]]
        ),
        "sigma": np.full(len(t), GnssNoise().sigma_velocity_m_s),
        "valid": np.ones(len(t)),
        "bottom_lock": np.ones(len(t)),
    }
    apart = np.abs(t - heading.t[_nearest(heading.t, t)]) > SAME_EPOCH_S
    refused = {"no velocity near": np.isnan(v_n[:, 0]), "no heading near": apart}
    return tidy(DvlSeries, "speed", columns, refused=refused)


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


def _fixes(log: _Log) -> Fixes:
    latitude, longitude, height = np.array([fix.values for fix in log.fixes]).T
    sigma = np.array([fix.sigma_m for fix in log.fixes])
    t = log.t[[fix.time for fix in log.fixes]]
    return Fixes(
        t=t,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        sigma=np.column_stack([sigma, sigma, VERTICAL_SHARE * sigma]),
        v_n=_velocities(log, t),
        has_fix=np.array([fix.has_fix for fix in log.fixes]),
        unread=_by_reason([fix.reason for fix in log.fixes]),
    )


def _velocities(log: _Log, t: Array) -> Array | None:
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
