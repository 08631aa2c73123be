"""Sensors that a filter's gate threw out for long, or most of the time: said as warnings.

A gate is for outliers. Where it refuses a sensor for long, the filter and the sensor contradict
each other, and one of them is wrong: an estimate that says nothing of it looks better than it is.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.solution import Solution

GATED = "innovation gate"
FEWEST, LARGEST_SHARE = 20, 0.5
"""So many measurements of which a larger share was refused are not outliers."""
LONGEST_RUN_S = 10.0
"""Nor are so many seconds of them without one that was accepted."""


def contradictions(solution: Solution) -> Iterator[str]:
    """One warning for each sensor that the method's gate refused for long."""
    refused: dict[str, list[float]] = {}
    for rejection in solution.rejections:
        if rejection.reason == GATED:
            refused.setdefault(rejection.sensor, []).append(rejection.t)
    for sensor, times in refused.items():
        used = solution.innovations.get(sensor)
        t_used = np.empty(0) if used is None else np.asarray(used.t)
        t_refused = np.sort(times)
        total = len(t_refused) + len(t_used)
        if len(t_refused) < FEWEST:
            continue
        run = _longest_run(t_refused, t_used)
        first, last = float(run[0]), float(run[-1])
        too_long = len(run) >= FEWEST and last - first > LONGEST_RUN_S
        if not too_long and len(t_refused) <= LARGEST_SHARE * total:
            continue
        yield (
            f"{sensor}: {len(t_refused)} of {total} measurements were rejected, in one run those"
            f" from {first:.1f} s to {last:.1f} s: the filter and the sensor contradict each other"
        )


def _longest_run(t_refused: Array, t_used: Array) -> Array:
    """Times of the longest run of refusals without a measurement that was used in between."""
    used_before = np.searchsorted(np.sort(t_used), t_refused)
    runs = np.split(t_refused, np.flatnonzero(np.diff(used_before)) + 1)
    return max(runs, key=lambda run: float(run[-1] - run[0]))
