"""Whether fixes, whose clock nobody doubts, seem late or early, or a compass off, all the same.

One Gauss-Newton step of what `clocks` does where a mission asks for it: a constant timing error a
receiver, beside all states, from nothing known of it; and beside these an offset of the compass,
so that the clocks are not blamed for it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.graph.backend import graph_of
from gtsam_nav.graph.keys import letter_of
from gtsam_nav.graph.problem import Problem, TimingEffect
from gtsam_nav.graph.sensor_posterior import sensor_posterior, tangent_width
from gtsam_nav.graph.settling import Settled
from gtsam_nav.graph.timing import TimingError, timing_effect
from gtsam_nav.graph.weights import Weighed
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.noise import HeadingNoise

UNKNOWN_S = 10.0
"""Spread of a timing error of which nothing is known."""
SUSPECT_SIGMAS, SUSPECT_S = 4.0, 0.1
"""A timing error that is smaller is not spoken of."""
SUSPECT_DEG = 5.0
"""Nor is an offset of the compass."""
CHI_MEDIAN_3_DOF = 1.538
"""Of the residuals of fixes that are as good as they say."""


def suspected_constants(
    mission: Mission, problem: Problem, settled: Settled, values: Any, rows: Sequence[Weighed]
) -> Iterator[str]:
    """A warning for each receiver whose fixes seem to be off in time, and for a compass that is.

    Parameters
    ----------
    problem : Problem
        Where it estimates timing errors, only the compass is doubted, beside clocks of which
        nothing is known.
    values : gtsam.Values
        The solution.
    rows : sequence of Weighed
        All measurements there: the sigmas grow with how badly a receiver's own fit.
    """
    receivers = [sensor.name for sensor in mission.of_type("gnss")]
    compass = mission.first("heading")
    if not receivers:
        return
    errors = tuple(TimingError(name, "gnss", "time_offset", UNKNOWN_S) for name in receivers)
    timing = problem.timing or timing_effect(
        problem, errors, np.zeros(len(errors)), settled.used_factors, values
    )
    timing = replace(timing, sigma_s=np.full(len(timing.names), UNKNOWN_S))
    doubting = copy(problem)
    doubting.timing = _with_compass(timing, problem, settled, values)
    graph = graph_of(problem.entries)
    graph.push_back(settled.factors)
    found = sensor_posterior(graph, values, np.empty(0, dtype=np.int64), doubting).constants
    size = len(timing.names) + 1
    mean, sigma = found.mean[-size:], np.sqrt(np.diag(found.cov)[-size:])
    misfit = {name: _misfit(name, rows) for name in receivers}
    turn_deg, sigma_deg = abs(np.degrees(mean[-1])), np.degrees(sigma[-1]) * max(misfit.values())
    if compass is not None and turn_deg > max(SUSPECT_DEG, SUSPECT_SIGMAS * sigma_deg):
        stated_deg = HeadingNoise.model_validate(compass.noise).bias_sigma_deg
        yield (
            f"'{compass.name}' seems to be off by {turn_deg:.0f} deg or more (sigma"
            f" {sigma_deg:.0f} deg), against a stated bias_sigma_deg of {stated_deg:g}"
            + (", or the sensor of the velocity is turned" if problem.measures_velocity else "")
        )
    elif problem.timing is None:
        for name, offset_s, sigma_s in zip(receivers, mean[:-1], sigma[:-1], strict=True):
            sigma_s *= misfit[name]
            if abs(offset_s) > max(SUSPECT_S, SUSPECT_SIGMAS * sigma_s):
                yield (
                    f"'{name}' seems to be {abs(offset_s):.2f} s"
                    f" {'late' if offset_s < 0 else 'early'} (sigma {sigma_s:.2f} s): its card may"
                    " say time_offset: {estimate: true}"
                )


def _misfit(name: str, rows: Sequence[Weighed]) -> float:
    """How many times larger a sensor's residuals are than they should be, at least 1."""
    own = [row.residual for row in rows if row.sensor == name and row.used]
    return max(1.0, float(np.median(own or [0.0])) / CHI_MEDIAN_3_DOF)


def _with_compass(
    timing: TimingEffect, problem: Problem, settled: Settled, values: Any
) -> TimingEffect:
    """The same effect, and last a constant that was added to all headings, in rad."""
    measured = [(e.sensor, e.index is not None, e.factor) for e in problem.entries]
    measured += [(reading.sensor, True, factor) for reading, factor in settled.used_factors]
    effect = [
        _turned(factor, values) if sensor == "heading" and is_reading else np.zeros(factor.dim())
        for sensor, is_reading, factor in measured
    ]
    return TimingEffect(
        names=(*timing.names, "heading_offset_rad"),
        sigma_s=np.append(timing.sigma_s, np.pi),
        corrected_s=np.append(timing.corrected_s, 0.0),
        effect=np.column_stack([timing.effect, np.concatenate(effect)]),
    )


def _turned(factor: Any, values: Any) -> Array:
    """How a heading's whitened, weighted residual changes as its reading turns clockwise."""
    linear = factor.linearize(values)
    A, first = linear.jacobian()[0], 0
    for key in list(linear.keys()):
        if letter_of(key) == "x":
            down_b = values.atNavState(key).attitude().matrix()[2]
            return np.asarray(-A[:, first : first + 3] @ down_b)
        first += tangent_width(key)
    return np.zeros(len(A))
