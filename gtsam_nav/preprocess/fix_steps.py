"""Jumps of a receiver's fixes that the vehicle did not make: RTK that turns from float to fixed.

A float solution is off by decimetres to metres, and many receivers state a fixed one's sigma all
the same. An estimator that believes both bends its track to join them. What tells the jump are the
receiver's own velocities over that step. The fixes on the doubtful side are then taken to share an
error as large as the jump, which wanders as the card's ``correlation_time_s`` says: those whose
stated sigmas are larger, else the fewer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.antenna_path import AntennaPath, antenna_path
from gtsam_nav.preprocess.false_start import SILENT_STEPS
from gtsam_nav.preprocess.first_fixes import located
from gtsam_nav.sensors.noise import GnssNoise
from gtsam_nav.series import GnssSeries

JUMP_SIGMAS = 6.0
"""Of a step, that it is a jump."""
BEYOND, MOST_PERCENTILE = 2.5, 95.0
"""A jump is so many times what nearly all steps lack: they show how well the motion is known."""
LEAST_JUMP_M = 0.3
LATE_S = 0.5
"""What motion and fixes may be apart in time: a manoeuvre then looks like a jump."""
BESIDE = 3
"""Steps on either side that tell what a step usually lacks."""
LASTING_S, FEWEST_FIXES = 15.0, 6
"""A jump counts where the fixes stay on its other side for half of this: outliers come back."""
MOST_SAID = 3
WORSE = 1.5
"""A sigma that is so many times another's is a worse solution's."""


def with_fix_steps(mission: Mission) -> Mission:
    """The mission in which fixes beside a jump share an error, with what is said of them."""
    for receiver in mission.of_type("gnss"):
        series = receiver.series
        assert isinstance(series, GnssSeries)
        known = np.flatnonzero(located(series))
        if len(known) < 2 * FEWEST_FIXES:
            continue
        noise = GnssNoise.model_validate(receiver.noise)
        path = antenna_path(series, series.t[known], noise)
        if path is None:
            continue
        offset_m, said = shared_offsets(series.select(known), path, receiver.name)
        if not said:
            continue
        offset = np.zeros(len(series))
        offset[known] = offset_m
        sigma = np.hypot(series.sigma, offset[:, None])
        doubted = replace(series, sigma=sigma, offset_sigma=offset)
        mission = replace(
            mission.with_sensor(replace(receiver, series=doubted)),
            warnings=(*mission.warnings, *said),
        )
    return mission


@dataclass(frozen=True)
class _Stretch:
    """Fixes ``first`` to ``stop`` between two jumps, and where they lie against the motion."""

    first: int
    stop: int
    sigma: float
    level: Array

    @property
    def n(self) -> int:
        return self.stop - self.first


def shared_offsets(
    fixes: GnssSeries, path: AntennaPath, name: str
) -> tuple[Array, tuple[str, ...]]:
    """What each fix shares with its neighbours beside a jump, (n,) m, and what is said of it."""
    lacking = _lacking(fixes, path)
    at = _jumps(fixes, path, lacking)
    if not at:
        return np.zeros(len(fixes)), ()
    stretches = _stretches(fixes, lacking, at)
    believed = _believed(stretches)
    # what came back to the believed ones is right again
    near_m = 0.5 * min(float(np.linalg.norm(lacking[k])) for k in at)
    offset, said = np.zeros(len(fixes)), []
    for stretch in stretches:
        off_m = float(np.linalg.norm(stretch.level - believed.level))
        if off_m > near_m:
            offset[stretch.first : stretch.stop] = off_m / np.sqrt(2)
            said.append(_said(fixes.t, stretch, off_m, name))
    more = len(said) - MOST_SAID
    if more > 0:
        said[MOST_SAID:] = [f"so do those of {more} further stretches of '{name}'"]
    return offset, tuple(said)


def _lacking(fixes: GnssSeries, path: AntennaPath) -> Array:
    """What each step of the fixes has beyond the motion, (n - 1, 2) m, where a few beside it have
    not: velocities of another lag, or in other axes, are in all of them."""
    steps_s = np.diff(fixes.t)
    lacking = _beyond_those_beside(fixes.p_n[:, :2] - path.p, steps_s)
    # what happened while the receiver was silent nothing tells
    lacking[steps_s > SILENT_STEPS * np.median(steps_s)] = 0.0
    return lacking


def _beyond_those_beside(values: Array, steps_s: Array) -> Array:
    """Steps of values (n, 2) less what they would be by the usual rate beside them."""
    rate = np.diff(values, axis=0) / steps_s[:, None]
    padded = np.pad(rate, ((BESIDE, BESIDE), (0, 0)), mode="reflect")
    beside = [padded[k : k + len(rate)] for k in range(2 * BESIDE + 1) if k != BESIDE]
    return np.asarray((rate - np.median(beside, axis=0)) * steps_s[:, None])


def _jumps(fixes: GnssSeries, path: AntennaPath, lacking: Array) -> list[int]:
    """Steps that are jumps to where the fixes stay."""
    variance = fixes.sigma[:, :2].max(axis=1) ** 2
    sigma = np.sqrt(variance[1:] + variance[:-1] + np.diff(path.variance))
    size = np.linalg.norm(lacking, axis=1)
    usual = BEYOND * float(np.percentile(size, MOST_PERCENTILE))
    limit = np.maximum(JUMP_SIGMAS * sigma + _by_lateness(fixes, path), max(usual, LEAST_JUMP_M))
    chosen: list[int] = []
    for k in np.flatnonzero(size > limit).tolist():
        if chosen and k - chosen[-1] <= BESIDE:
            chosen[-1] = max(chosen[-1], k, key=lambda step: size[step])
        else:
            chosen.append(k)
    level = np.vstack([np.zeros(2), np.cumsum(lacking, axis=0)])
    return [k for k in chosen if _lasts(fixes.t, level, lacking[k], k)]


def _by_lateness(fixes: GnssSeries, path: AntennaPath) -> Array:
    """What late fixes may lack in each step: a velocity that changes is seen later by them."""
    steps_s = np.diff(fixes.t)
    jerk = np.linalg.norm(_beyond_those_beside(path.v, steps_s), axis=1)
    jerk = np.maximum(jerk - 2 * np.median(jerk), 0.0)  # noise is no manoeuvre
    reach = min(int(np.ceil(LATE_S / np.median(steps_s))), len(jerk) - 1)
    around = np.lib.stride_tricks.sliding_window_view(np.pad(jerk, reach), 2 * reach + 1)
    return np.asarray(LATE_S * around.max(axis=1))


def _lasts(t: Array, level: Array, jump: Array, k: int) -> bool:
    """Whether most fixes for a while stay beyond half of the jump after fix k."""
    first = int(np.searchsorted(t, t[k] - LASTING_S))
    stop = int(np.searchsorted(t, t[k + 1] + LASTING_S, side="right"))
    if min(k + 1 - first, stop - k - 1) < FEWEST_FIXES:
        return False
    moved = np.median(level[k + 1 : stop], axis=0) - np.median(level[first : k + 1], axis=0)
    return bool(moved @ jump > 0.5 * (jump @ jump))


def _stretches(fixes: GnssSeries, lacking: Array, at: list[int]) -> list[_Stretch]:
    bounds = [0, *(k + 1 for k in at), len(fixes)]
    levels = np.vstack([np.zeros(2), np.cumsum(lacking[at], axis=0)])
    sigma = fixes.sigma[:, :2].max(axis=1)
    return [
        _Stretch(a, b, float(np.median(sigma[a:b])), level)
        for (a, b), level in zip(pairwise(bounds), levels, strict=True)
    ]


def _believed(stretches: list[_Stretch]) -> _Stretch:
    """The longest of those with the smallest sigmas."""
    least = min(stretch.sigma for stretch in stretches)
    best = [stretch for stretch in stretches if stretch.sigma <= WORSE * least]
    return max(best, key=lambda stretch: stretch.n)


def _said(t: Array, stretch: _Stretch, off_m: float, name: str) -> str:
    first, last = float(t[stretch.first]), float(t[stretch.stop - 1])
    if stretch.first == 0:
        which = f"the fixes of '{name}' until {last:.1f} s"
    elif stretch.stop == len(t):
        which = f"the fixes of '{name}' from {first:.1f} s on"
    else:
        which = f"the fixes of '{name}' from {first:.1f} s to {last:.1f} s"
    return (
        f"{which} lie {off_m:.1f} m off the others by a jump that the receiver's own velocities"
        " have not, as of RTK that turns from float to fixed: taken to share an error of that size;"
        " if they are right, gnss.use_velocity=false leaves the velocities out"
    )
