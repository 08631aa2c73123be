"""The rests of a vehicle that is said to stand still wherever its IMU is quiet.

What floats or runs smoothly is quiet at a steady speed too, so the sensors of velocity and place
must not say otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.first_fixes import located
from gtsam_nav.preprocess.rest import SPELL_S, Spells, spells_of
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.sensors.noise import GnssNoise
from gtsam_nav.series import DvlSeries, GnssSeries, OdometrySeries

MOVING_SIGMAS, MOVING_M_S = 4.0, 0.1
"""A speed that is above both is a motion."""
FIXES_S = 10.0
"""Fixes tell a motion by where those of this long, half before and half after, lie."""
MEDIAN_SIGMAS = 1.25
"""Standard deviation of a median of normal errors, against that of their mean."""
RESOLVED_M_S = 0.5
"""What does not tell such a speed from rest does not witness a rest."""
UNRELIABLE = 0.1
"""Where a larger share of the quiet spells is a motion, quiet alone is no rest."""


def stated_rests(
    mission: Mission, settings: MotionSettings
) -> tuple[Spells | None, tuple[str, ...]]:
    """Quiet spells of the mission's IMU in which no other sensor sees a motion, and a warning
    where some were seen to be one; no spells where rests are not stated.

    Spells that no sensor witnesses count as rests, unless those that one does are often none.
    """
    stated, imu = settings.zero_velocity, mission.first("imu")
    if imu is None or not (mission.constraints.zero_velocity if stated is None else stated):
        return None, ()
    spells = spells_of(imu)
    spells = spells.select(spells.quiet)
    witnessed, moving = np.zeros((2, len(spells.t)), dtype=bool)
    for speed_m_s, sigma_m_s in _witnesses(mission, spells.t):
        limit = np.maximum(MOVING_M_S, MOVING_SIGMAS * sigma_m_s)
        witnessed |= limit < RESOLVED_M_S
        moving |= speed_m_s > limit
    witnessed |= moving
    n_seen, n_moving = int(np.sum(witnessed)), int(np.sum(moving))
    if not n_moving:
        return spells, ()
    rests, unseen = ~moving, ""
    if n_moving > UNRELIABLE * n_seen:
        rests &= witnessed
        if n_seen < len(spells.t):
            unseen = f", nor the {len(spells.t) - n_seen} that no other sensor sees"
    warning = (
        f"zero_velocity: in {n_moving} of the {n_seen} quiet seconds of '{imu.name}' that"
        f" velocities or fixes see, the vehicle moves; they are not taken for rest{unseen}"
    )
    return spells.select(rests), (warning,)


def _witnesses(mission: Mission, ends: Array) -> Iterator[tuple[Array, Array]]:
    """Of each sensor: speed in the spells and its standard deviation, infinite where unseen."""
    for sensor in mission.sensors.values():
        series = sensor.series
        if isinstance(series, DvlSeries):
            tracked = series.valid & series.bottom_lock
            yield _by_velocity(series.t[tracked], series.v_d[tracked], series.sigma[tracked], ends)
        elif isinstance(series, OdometrySeries):
            yield _by_velocity(series.t, series.v_b, series.sigma_v, ends)
        elif isinstance(series, GnssSeries):
            if series.v_n is not None:
                known = np.all(np.isfinite(series.v_n), axis=1)
                sigma = GnssNoise.model_validate(sensor.noise).sigma_velocity_m_s
                sigmas = np.full(int(np.sum(known)), sigma)
                yield _by_velocity(series.t[known], series.v_n[known, :2], sigmas, ends)
            fixes = series.select(located(series))
            yield _by_fixes(fixes.t, fixes.p_n[:, :2], fixes.sigma[:, :2].max(axis=1), ends)


def _by_velocity(t: Array, v: Array, sigma: Array, ends: Array) -> tuple[Array, Array]:
    """By the median velocity within a spell."""
    first, last = np.searchsorted(t, [ends - SPELL_S, ends])
    speed, spread = np.zeros(len(ends)), np.full(len(ends), np.inf)
    for n in np.flatnonzero(last > first).tolist():
        own = slice(int(first[n]), int(last[n]))
        speed[n] = np.linalg.norm(np.median(v[own], axis=0))
        spread[n] = MEDIAN_SIGMAS * np.median(sigma[own]) / np.sqrt(last[n] - first[n])
    return speed, spread


def _by_fixes(t: Array, p: Array, sigma: Array, ends: Array) -> tuple[Array, Array]:
    """By how far the median of the fixes after a spell's middle is from that of those before."""
    middle = ends - 0.5 * SPELL_S
    first, mid, last = np.searchsorted(t, [middle - FIXES_S / 2, middle, middle + FIXES_S / 2])
    speed, spread = np.zeros(len(ends)), np.full(len(ends), np.inf)
    for n in np.flatnonzero((mid >= first + 2) & (last >= mid + 2)).tolist():
        before, after = slice(int(first[n]), int(mid[n])), slice(int(mid[n]), int(last[n]))
        span_s = np.median(t[after]) - np.median(t[before])
        moved = np.median(p[after], axis=0) - np.median(p[before], axis=0)
        shares = 1.0 / (mid[n] - first[n]) + 1.0 / (last[n] - mid[n])
        speed[n] = np.linalg.norm(moved) / span_s
        spread[n] = MEDIAN_SIGMAS * np.median(sigma[first[n] : last[n]]) * np.sqrt(shares) / span_s
    return speed, spread
