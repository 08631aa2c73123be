"""Fixes with which a receiver begins at a false place, and leaves it by a jump.

A cold receiver may report a place tens of metres off for its first seconds, with the sigma of good
fixes. No motion joins such fixes to those after them, and an estimator that begins with them takes
all that follow for outliers. The jump shows it without any other sensor: no vehicle gains and
loses that speed within one step. Of the ways through the stretches between jumps, the one that
holds the most fixes of the first two minutes is believed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.first_fixes import ANY_SPEED_M_S, OFF_THE_NEXT, USELESS_SIGMA_M, spaced
from gtsam_nav.series import GnssSeries

COMPARED_S = 120.0
"""A receiver that is not settled after half of this time is believed."""
LEAST_FIXES = 6
LEAST_SPEED_M_S = 1.0
HARDEST_M_S2 = 6.0
"""No vehicle starts or stops harder."""
SILENT_STEPS = 3.0
"""Usual steps after which a receiver was silent: what happened meanwhile nothing tells."""
JUMP_SIGMAS = 7.0
"""Of a step, that it differs from those beside it."""
BESIDE = 2
"""Steps on either side that tell the velocity at a jump."""


@dataclass(frozen=True)
class _Track:
    """Times (n,), level places (n, 2) and their sigmas (n,)."""

    t: Array
    p: Array
    sigma: Array

    @cached_property
    def fast_m_s(self) -> float:
        """A speed that few steps exceed, and at least that of a walk."""
        speeds = np.linalg.norm(np.diff(self.p, axis=0), axis=1) / np.diff(self.t)
        return max(float(np.percentile(speeds, 75)), LEAST_SPEED_M_S)

    @cached_property
    def silence_s(self) -> float:
        """A step after which it was silent."""
        return SILENT_STEPS * float(np.median(np.diff(self.t)))

    def is_joined(self, a: int, b: int, begin: int, end: int) -> bool:
        """Whether a vehicle may have gone from fix a to b, by its velocity before or after.

        These are over the next few fixes, none before ``begin`` or after ``end``.
        """
        before, after = max(a - BESIDE, begin), min(b + BESIDE, end)
        gap_s = self.t[b] - self.t[a]
        way = self.p[b] - self.p[a]
        off_m = [
            float(np.linalg.norm(way - gap_s * (self.p[j] - self.p[i]) / (self.t[j] - self.t[i])))
            for i, j in ((before, a), (b, after))
            if i < j
        ]
        sigma = float(np.hypot(self.sigma[a], self.sigma[b]))
        manoeuvre_m = HARDEST_M_S2 * gap_s * (self.t[after] - self.t[before]) / 2
        # what is slow does not come far from where it was going
        strayed_m = min(manoeuvre_m, 2 * self.fast_m_s * gap_s)
        if b == a + 1 and gap_s > self.silence_s:
            strayed_m = ANY_SPEED_M_S * gap_s
        allowed_m = JUMP_SIGMAS * sigma + strayed_m
        return bool(min(off_m, default=float(np.linalg.norm(way))) <= allowed_m)


def without_false_starts(mission: Mission) -> Mission:
    """The mission from each receiver's first believed fix on, with what is said of the others."""
    for receiver in mission.of_type("gnss"):
        series = receiver.series
        assert isinstance(series, GnssSeries)
        first, off_m = false_start(series)
        if first:
            mission = _from_fix(mission, receiver, first, off_m)
    return mission


def _from_fix(mission: Mission, receiver: Sensor, first: int, off_m: float) -> Mission:
    series = receiver.series
    assert isinstance(series, GnssSeries)
    which = "first fix" if first == 1 else f"first {first} fixes"
    said = (
        f"'{receiver.name}' jumps by {off_m:.0f} m after its {which}, until"
        f" {series.t[first - 1]:.1f} s, as no motion explains: not used as positions; if they are"
        " right, their sigmas are too small"
    )
    left_out = tuple(
        Rejection(float(series.t[k]), receiver.name, int(series.row[k]), OFF_THE_NEXT)
        for k in range(first)
    )
    if series.v_n is None:
        later = series.select(slice(first, None))
    else:  # the velocities are of another measurement
        sigma = series.sigma.copy()
        sigma[:first] = USELESS_SIGMA_M
        later = replace(series, sigma=sigma)
    return replace(
        mission.with_sensor(replace(receiver, series=later)),
        warnings=(*mission.warnings, said),
        rejections=(*mission.rejections, *left_out),
    )


def false_start(series: GnssSeries) -> tuple[int, float]:
    """The number of fixes before the first that is believed, and how far it jumps there, m."""
    some = spaced(series, COMPARED_S)
    if len(some) < LEAST_FIXES:
        return 0, 0.0
    track = _Track(series.t[some], series.p_n[some, :2], series.sigma[some, :2].max(axis=1))
    ends = 0, len(some) - 1
    jumps = [not track.is_joined(k, k + 1, *ends) for k in range(ends[1])]
    stretch = np.concatenate([[0], np.cumsum(jumps)])
    first = np.searchsorted(stretch, np.arange(stretch[-1] + 1))
    last = np.append(first[1:], len(some)) - 1
    # the way through stretches joined one to the next that holds the most fixes, by its end
    held, begins = np.bincount(stretch), np.arange(len(first))
    for b in range(len(first)):
        before = [a for a in range(b) if track.is_joined(last[a], first[b], first[a], last[b])]
        if before:
            best = max(before, key=lambda a: held[a])
            held[b], begins[b] = held[b] + held[best], begins[best]
    begin = int(first[begins[np.argmax(held)]])
    if begin == 0:
        return 0, 0.0
    return int(some[begin]), float(np.linalg.norm(track.p[begin] - track.p[begin - 1]))
