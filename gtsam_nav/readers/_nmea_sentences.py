"""The sentences of NMEA 0183, one by one, and the times that they tell."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from datetime import UTC, datetime

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.sensors.noise import GnssNoise

SENTENCE = re.compile(
    r"\$(?P<body>(?P<address>[A-Z]{2}(?P<kind>[A-Z]{3})),[^*$]*)(?:\*(?P<sum>[0-9A-Fa-f]{2}))?\s*$"
)
KINDS = ("GGA", "RMC", "VTG", "HDT", "HDG", "HDM", "VHW")
TRUE, LOG = "HDT", "VHW"
HEADINGS = (TRUE, "HDG", "HDM")

DAY_S = 86400.0
KNOT_M_S = 1852.0 / 3600.0
KM_H_M_S = 1.0 / 3.6
SLOW_M_S = GnssNoise().sigma_velocity_m_s
"""Receivers leave the course of what is as slow empty: it is at rest, for all that they know."""

STAND_ALONE = 1
"""Quality of a fix of which nothing better is said."""
BAD_CHECKSUM, NO_CHECKSUM, MALFORMED = "wrong checksum", "no checksum", "malformed sentence"


@dataclass
class SentenceFix:
    """A GGA, or an RMC's position; NaN where it is none, and why."""

    time: int
    values: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    quality: int = STAND_ALONE
    hdop: float = np.nan
    reason: str = ""
    has_fix: bool = True


@dataclass(frozen=True)
class Told:
    """A figure; NaN where it is none, and why."""

    time: int
    value: float = np.nan
    reason: str = ""


@dataclass
class SentenceLog:
    """What the sentences say, in their order; ``time`` counts in ``clock``."""

    clock: list[tuple[float, float | None]] = field(default_factory=list)
    """Time of day (s) and, from RMC, the POSIX time of the day's start."""
    fixes: list[SentenceFix] = field(default_factory=list)
    rmc_fixes: list[SentenceFix] = field(default_factory=list)
    velocities: dict[str, list[tuple[int, float, float]]] = field(
        default_factory=lambda: {"VTG": [], "RMC": []}
    )
    """Time, speed (m/s) and course (rad)."""
    headings: dict[str, list[Told]] = field(default_factory=dict)
    """By talker and kind: from true north, or from magnetic north, the deviation applied; rad."""
    water_speeds: dict[str, list[Told]] = field(default_factory=dict)
    """By talker and kind: ahead, m/s."""
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
                self._read(match["address"], kind, body.split(","))
                return
        except (ValueError, IndexError):
            reason = MALFORMED
        self._refuse(match["address"], kind, reason)

    def _read(self, address: str, kind: str, fields: list[str]) -> None:
        if kind in HEADINGS:
            self._tell(self.headings, address, _heading(kind, fields), "no heading")
        elif kind == LOG:
            self._tell(self.water_speeds, address, _water_speed(fields), "no speed")
        else:
            {"GGA": self._gga, "RMC": self._rmc, "VTG": self._vtg}[kind](fields)

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

    def _tell(
        self, figures: dict[str, list[Told]], address: str, value: float | None, lacking: str
    ) -> None:
        told = Told(self._now, reason=lacking) if value is None else Told(self._now, value)
        figures.setdefault(address, []).append(told)

    def _refuse(self, address: str, kind: str, reason: str) -> None:
        if kind == "GGA":
            self.fixes.append(SentenceFix(self._now, reason=reason))
        elif kind in HEADINGS:
            self._tell(self.headings, address, None, reason)
        elif kind == LOG:
            self._tell(self.water_speeds, address, None, reason)
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
            self.fixes.append(SentenceFix(now, has_fix=False))
            return
        height = float(f[9]) + float(f[11] or 0.0)
        values = (_degrees(f[2], f[3]), _degrees(f[4], f[5]), height)
        self.fixes.append(SentenceFix(now, values, quality, float(f[8] or 1.0)))

    def _rmc(self, f: list[str]) -> None:
        day = datetime.strptime(f[9], "%d%m%y").replace(tzinfo=UTC).timestamp() if f[9] else None
        now = self._tick(f[1], day)
        if f[2] != "A":
            self.rmc_fixes.append(SentenceFix(now, has_fix=False))
            return
        values = (_degrees(f[3], f[4]), _degrees(f[5], f[6]), 0.0)
        self.rmc_fixes.append(SentenceFix(now, values, STAND_ALONE, 1.0))
        if f[7]:
            self._velocity("RMC", float(f[7]) * KNOT_M_S, f[8])

    def _vtg(self, f: list[str]) -> None:
        speed = float(f[7]) * KM_H_M_S if f[7] else float(f[5]) * KNOT_M_S
        if self._now >= 0:
            self._velocity("VTG", speed, f[1])

    def _velocity(self, kind: str, speed: float, course_deg: str) -> None:
        course = float(course_deg or 0.0)
        if not (np.isfinite(speed) and np.isfinite(course)):
            raise ValueError("no velocity")
        if course_deg:
            self.velocities[kind].append((self._now, speed, np.radians(course)))
        elif speed <= SLOW_M_S:
            self.velocities[kind].append((self._now, 0.0, 0.0))

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
        """VTG's, and RMC's of the times that have none."""
        finer = self.velocities["VTG"]
        told = {time for time, _, _ in finer}
        return [*finer, *(found for found in self.velocities["RMC"] if found[0] not in told)]

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
        if not self.dated:
            found.append("no RMC sentence tells the date: mission time has no UTC")
        return found


def _heading(kind: str, f: list[str]) -> float | None:
    """Of HDT, HDG or HDM, rad; the deviation that HDG may state is put right."""
    if not f[1]:
        return None
    deviation, side = (*f[2:4], "", "")[:2] if kind == "HDG" else ("", "")
    if side not in ("E", "W") and float(deviation or 0.0):
        raise ValueError("a deviation to neither side")
    sign = -1.0 if side == "W" else 1.0
    return float(np.radians(float(f[1]) + sign * float(deviation or 0.0)))


def _water_speed(f: list[str]) -> float | None:
    """Of VHW, m/s; in knots or, where these are missing, in km/h."""
    if f[5]:
        return float(f[5]) * KNOT_M_S
    return float(f[7]) * KM_H_M_S if f[7] else None


def _degrees(text: str, hemisphere: str) -> float:
    """From dddmm.mmmm and N, S, E or W."""
    whole, dot, _ = text.partition(".")
    if not (dot or whole) or hemisphere not in ("N", "S", "E", "W"):
        raise ValueError("no latitude or longitude")
    degrees = float(text[: len(whole) - 2]) + float(text[len(whole) - 2 :]) / 60.0
    return -degrees if hemisphere in ("S", "W") else degrees
