"""When a sensor says nothing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import BoolArray

USUAL_STEPS, LEAST_S = 5.0, 1.0
"""A sensor whose samples are further apart than so many usual steps, and so long, is silent."""
FEW_S = 3.0
"""A shorter silence is not worth a word, and is none at the begin or the end of a mission."""


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

    What has a single sample holds it for good; the first and the last one reach a few seconds.
    """
    t = sensor.series.t
    if len(t) < 2:
        return np.empty((0, 2))
    start, stop = mission.span_s
    from_s = start if t[0] - start > FEW_S else float(t[0])
    to_s = stop if stop - t[-1] > FEW_S else float(t[-1])
    return silent_spells(t, from_s, to_s, longest_step_s(t))


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
    """A warning of what is silent for some seconds, and of what carries the estimate then."""
    spells = silences(sensor, mission)
    spells = spells[spells[:, 1] - spells[:, 0] > FEW_S]
    if len(spells):
        begin, end = spells[np.argmax(spells[:, 1] - spells[:, 0])]
        longest = "" if len(spells) == 1 else f" {len(spells)} times, the longest"
        yield f"'{sensor.name}' is silent{longest} from {begin:.1f} s to {end:.1f} s: {instead}"


def longest_step_s(t: Array, least_s: float = LEAST_S) -> float:
    """Longest step between stamps (n,) that is no silence yet, s."""
    return max(least_s, USUAL_STEPS * _usual_step_s(t))


def is_heard(stamps: Array, t: Array, longest_s: float | None = None) -> BoolArray:
    """Whether times (k,) lie between stamps (n,) no further apart than so, or as near to an end;
    than `longest_step_s` where it is absent."""
    if longest_s is None:
        longest_s = longest_step_s(stamps)
    gap_s = np.concatenate([[0.0], np.diff(stamps), [0.0]])
    around = (gap_s[np.searchsorted(stamps, t, side)] for side in ("left", "right"))
    beyond_s = np.maximum(stamps[0] - t, t - stamps[-1])
    return np.asarray((np.minimum(*around) <= longest_s) & (beyond_s <= longest_s))


def since_heard(sums: Array, heard: BoolArray) -> Array:
    """What running sums (n,) have grown by since something was last heard, or since the first."""
    last = np.maximum.accumulate(np.where(heard, np.arange(len(sums)), 0))
    return np.asarray(sums - sums[last])


def _usual_step_s(t: Array) -> float:
    """The step around a random moment, so that samples in bursts are as far apart as these, s."""
    if len(t) < 2:
        return 0.0
    steps_s = np.sort(np.diff(t))
    # a silence is long, but happens once: its length must not make it usual
    passed_s = np.cumsum(np.minimum(steps_s, LEAST_S))
    return float(steps_s[np.searchsorted(passed_s, 0.5 * passed_s[-1])])
