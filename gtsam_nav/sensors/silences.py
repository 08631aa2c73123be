"""When a sensor says nothing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import BoolArray

USUAL_STEPS, LEAST_S = 5.0, 1.0
"""A sensor whose samples are further apart than so many usual steps, and so long, is silent."""


def silent_spells(t: Array, from_s: float, to_s: float, longest_s: float) -> Array:
    """First and last moment of each spell within a span, longer than so, without a stamp.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Stamps, s, increasing.

    Returns
    -------
    ndarray, shape (k, 2)
    """
    marks = np.concatenate([[from_s], t[(t > from_s) & (t < to_s)], [to_s]])
    long = np.flatnonzero(np.diff(marks) > longest_s)
    return np.column_stack([marks[long], marks[long + 1]])


def silences(sensor: Sensor, mission: Mission) -> Array:
    """First and last moment of each silence of one of a mission's sensors, shape (k, 2), s.

    What has a single sample holds it for good.
    """
    t = sensor.series.t
    if len(t) < 2:
        return np.empty((0, 2))
    return silent_spells(t, *mission.span_s, longest_step_s(t))


def speaks_at(sensor: Sensor, mission: Mission, t: Array) -> BoolArray:
    """At which times (n,) its samples tell something: all but those deep within a silence."""
    spells, stamps = silences(sensor, mission), sensor.series.t
    if not len(spells):
        return np.ones(len(t), dtype=bool)
    begin, end = spells[np.maximum(np.searchsorted(spells[:, 0], t, side="right") - 1, 0)].T
    after = np.searchsorted(stamps, t).clip(1, len(stamps) - 1)
    nearest_s = np.min(np.abs([stamps[after - 1] - t, stamps[after] - t]), axis=0)
    return np.asarray((t < begin) | (t > end) | (nearest_s <= _usual_step_s(stamps)))


def said_of_silences(sensor: Sensor, mission: Mission, instead: str) -> Iterator[str]:
    """A warning of what is silent for a time, and of what carries the estimate then."""
    spells = silences(sensor, mission)
    if len(spells):
        lasts_s = spells[:, 1] - spells[:, 0]
        begin, end = spells[np.argmax(lasts_s)]
        longest = "" if len(spells) == 1 else f" {len(spells)} times, the longest"
        yield f"'{sensor.name}' is silent{longest} from {begin:.1f} s to {end:.1f} s: {instead}"


def longest_step_s(t: Array) -> float:
    """Longest step between stamps (n,) that is no silence yet, s."""
    return max(LEAST_S, USUAL_STEPS * _usual_step_s(t))


def is_heard(stamps: Array, t: Array, longest_s: float) -> BoolArray:
    """Whether times (k,) lie between stamps (n,) no further apart than so, or as near to an end."""
    gap_s = np.concatenate([[0.0], np.diff(stamps), [0.0]])
    around = (gap_s[np.searchsorted(stamps, t, side)] for side in ("left", "right"))
    beyond_s = np.maximum(stamps[0] - t, t - stamps[-1])
    return np.asarray((np.minimum(*around) <= longest_s) & (beyond_s <= longest_s))


def since_heard(sums: Array, heard: BoolArray) -> Array:
    """What running sums (n,) have grown by since something was last heard, or since the first."""
    last = np.maximum.accumulate(np.where(heard, np.arange(len(sums)), 0))
    return np.asarray(sums - sums[last])


def _usual_step_s(t: Array) -> float:
    return float(np.median(np.diff(t))) if len(t) > 1 else 0.0
