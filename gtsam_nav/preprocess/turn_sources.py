"""What tells how a vehicle turns; where one source is silent the next one tells it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.silences import is_heard, longest_step_s
from gtsam_nav.series import BoolArray, OdometrySeries


@dataclass(frozen=True)
class TurnSource:
    """Turns by one sensor.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Stamps, s.
    turned : ndarray, shape (n,)
        Unwrapped, clockwise, from anywhere, rad.
    longest_s : float
        Over a longer step it is silent.
    """

    t: Array
    turned: Array
    longest_s: float

    def steps(self, t: Array) -> Array:
        """Turns between successive times (k,), rad, shape (k - 1,)."""
        return np.asarray(np.diff(np.interp(t, self.t, self.turned)))

    def tells(self, t: Array) -> BoolArray:
        """Whether its stamps tell of times (k,)."""
        within = (t >= self.t[0]) & (t <= self.t[-1])
        return np.asarray(within & is_heard(self.t, t, self.longest_s))


def by_rate(t: Array, rate: Array, span_s: tuple[float, float], longest_s: float) -> TurnSource:
    """Turns by yaw rates (n,), rad/s; the first and last are held to the ends of a span that are no
    further away than so."""
    start, stop = span_s
    before = [start] if 0.0 < t[0] - start <= longest_s else []
    after = [stop] if 0.0 < stop - t[-1] <= longest_s else []
    rate = np.pad(rate, (len(before), len(after)), mode="edge")
    t = np.concatenate([before, t, after])
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(t)
    return TurnSource(t, np.concatenate([[0.0], np.cumsum(steps)]), longest_s)


def by_odometry(mission: Mission) -> Iterator[TurnSource]:
    """Turns by wheels or thrusters, if they tell any."""
    odometry = mission.first("odometry")
    if odometry is None:
        return
    series = odometry.series
    assert isinstance(series, OdometrySeries)
    yield by_rate(series.t, series.yaw_rate, mission.span_s, longest_step_s(series.t))


def spliced(first: TurnSource, *others: TurnSource) -> TurnSource:
    """Turns by the first source; in its silences by the next one that tells of them.

    Where none does it is the first source's, linear between its stamps and none beyond them.
    """
    t = np.unique(np.concatenate([source.t for source in (first, *others)]))
    middle = 0.5 * (t[1:] + t[:-1])
    silent = ~first.tells(middle)
    if not np.any(silent):
        return first
    steps = first.steps(t)
    for other in others:
        tells = silent & other.tells(middle)
        steps[tells] = other.steps(t)[tells]
        silent &= ~tells
    return TurnSource(t, np.concatenate([[0.0], np.cumsum(steps)]), first.longest_s)
