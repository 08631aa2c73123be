"""The compass against the course that GNSS saw."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.motion import dead_reckoned_way, turned, velocity_sensor
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import GnssSeries, HeadingSeries

BASELINE_M = 15.0
"""Shortest distance between two fixes that is taken for a course ..."""
BASELINE_SIGMAS = 12.0
"""... and in standard deviations of a fix."""
LONGEST_BASELINE_S = 180.0
FEWEST_BASELINES = 5


@dataclass(frozen=True)
class HeadingAgainstCourse:
    """Direction of the travelled way by compass less that by GNSS.

    ``median_deg`` and ``spread_deg`` (1.48 times the median absolute deviation) are over the
    baselines; ``mirrored_spread_deg`` is what the spread would be for a heading that counts
    counter-clockwise. ``velocity`` names the sensor whose drift angle was taken into account, None
    where the vehicle was taken to move along its bow.
    """

    heading: str
    gnss: str
    velocity: str | None
    n_baselines: int
    baseline_m: float
    median_deg: float
    spread_deg: float
    mirrored_spread_deg: float


def heading_against_course(mission: Mission, heading: Sensor) -> HeadingAgainstCourse | None:
    """Compare a compass with the course over ground.

    Only pairs of fixes much further apart than their noise count, so that the course is known to a
    few degrees.

    Returns
    -------
    HeadingAgainstCourse or None
        None without GNSS or with too few baselines.
    """
    gnss = mission.first("gnss")
    if gnss is None:
        return None
    series = heading.series
    assert isinstance(series, HeadingSeries)
    compass = np.unwrap(series.heading)
    fixes = gnss.series.crop(series.t[0], series.t[-1])
    assert isinstance(fixes, GnssSeries)
    if len(fixes) < 2:
        return None
    baseline_m = max(BASELINE_M, BASELINE_SIGMAS * float(np.median(fixes.sigma[:, :2])))
    pairs = _baselines(fixes, baseline_m)
    if len(pairs) < FEWEST_BASELINES:
        return None
    velocity = velocity_sensor(mission)
    errors = [
        _direction_errors(fixes, gnss.xyz_b, series.t, sign * compass, velocity, pairs)
        for sign in (1.0, -1.0)
    ]
    median, spread = _circular_median_and_spread(errors[0])
    return HeadingAgainstCourse(
        heading=heading.name,
        gnss=gnss.name,
        velocity=None if velocity is None else velocity.name,
        n_baselines=len(pairs),
        baseline_m=baseline_m,
        median_deg=float(np.degrees(median)),
        spread_deg=float(np.degrees(spread)),
        mirrored_spread_deg=float(np.degrees(_circular_median_and_spread(errors[1])[1])),
    )


def heading_findings(result: HeadingAgainstCourse) -> Iterator[Finding]:
    """Judge the comparison."""
    read = (
        f"compass less {result.gnss} course: median {result.median_deg:+.1f} deg, "
        f"spread {result.spread_deg:.1f} deg over {result.n_baselines} baselines "
        f"of {result.baseline_m:.0f} m"
    )
    if result.spread_deg > 30.0 and result.mirrored_spread_deg < 0.5 * result.spread_deg:
        message = f"{read}; the heading seems to count counter-clockwise"
    elif result.spread_deg > 30.0:
        message = f"{read}; the heading does not follow the course"
    elif abs(result.median_deg) > 10.0:
        message = f"{read}; look at mounting, declination and the sign of the velocity"
    else:
        yield Finding("heading against course", result.heading, "ok", read)
        return
    yield Finding("heading against course", result.heading, "warning", message)


def _baselines(fixes: GnssSeries, baseline_m: float) -> list[tuple[int, int]]:
    """Pairs of fixes, one after the other, that are far enough apart."""
    pairs, first = [], 0
    for k in range(1, len(fixes)):
        if fixes.t[k] - fixes.t[first] > LONGEST_BASELINE_S:
            first += int(np.searchsorted(fixes.t[first:], fixes.t[k] - LONGEST_BASELINE_S))
        if np.hypot(*(fixes.p_n[k, :2] - fixes.p_n[first, :2])) >= baseline_m:
            pairs.append((first, k))
            first = k
    return pairs


def _direction_errors(
    fixes: GnssSeries,
    lever_b: Array,
    t: Array,
    heading: Array,
    velocity: Sensor | None,
    pairs: list[tuple[int, int]],
) -> Array:
    """Dead-reckoned less observed direction of each baseline, rad."""
    way_n = dead_reckoned_way(t, heading, velocity)
    first, last = np.array(pairs).T
    heading_at_fix = np.interp(fixes.t, t, heading)
    body_n = fixes.p_n[:, :2] - turned(lever_b[None, :2], heading_at_fix)
    seen = body_n[last] - body_n[first]
    way_at_fix = np.stack([np.interp(fixes.t, t, axis) for axis in way_n.T], axis=1)
    reckoned = way_at_fix[last] - way_at_fix[first]
    return wrap_angle(
        np.arctan2(reckoned[:, 1], reckoned[:, 0]) - np.arctan2(seen[:, 1], seen[:, 0])
    )


def _circular_median_and_spread(angles: Array) -> tuple[float, float]:
    """The sample that is nearest to all others along the circle, and 1.48 MAD about it."""
    distance = np.abs(wrap_angle(angles[:, None] - angles[None, :]))
    median = float(angles[int(np.argmin(np.sum(distance, axis=1)))])
    return median, 1.4826 * float(np.median(np.abs(wrap_angle(angles - median))))
