"""When an IMU is quiet, and what it feels then.

A quiet IMU is at rest only where the vehicle cannot glide: what floats is quiet at a steady speed
too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Sensor
from gtsam_nav.sensors.noise import ImuNoise
from gtsam_nav.series import BoolArray, ImuSeries

SPELL_S = 1.0
"""Readings are averaged over spells of this length."""
QUIET_RATE_RAD_S, QUIET_FORCE_M_S2 = 0.05, 0.15
"""Largest scatter within a quiet spell, each axis: engines idle below it, roads shake above."""
FIRST_SPELLS, LAST_SPELLS = 5, 2
"""Those that a rest is judged by, and those at its end that are not trusted."""
STEADY_SIGMAS, STEADY_RATE_RAD_S, STEADY_FORCE_M_S2 = 6.0, 0.01, 0.05
"""A rest ends where a spell's mean leaves the first ones' by more, in sigmas or in all."""
GRAVITY_M_S2, GRAVITY_TOLERANCE_M_S2 = 9.81, 0.5
LONGEST_REST_S = 300.0
LEAST_SAMPLES = 5


@dataclass(frozen=True)
class Spells:
    """An IMU's readings over spells of SPELL_S.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Ends of the spells, s.
    rate_b, force_b : ndarray, shape (n, 3)
        Means along body axes. The lever arm is left out: at rest it does nothing.
    quiet : ndarray of bool, shape (n,)
    """

    t: Array
    rate_b: Array
    force_b: Array
    quiet: BoolArray

    def select(self, which: BoolArray | slice) -> Spells:
        """Some of the spells."""
        return Spells(self.t[which], self.rate_b[which], self.force_b[which], self.quiet[which])


@dataclass(frozen=True)
class Rest:
    """What an IMU at rest feels: means along body axes (3,) and their standard deviations (3,)."""

    spells: Spells
    rate_b: Array
    sigma_rate: Array
    force_b: Array
    sigma_force: Array


def spells_of(imu: Sensor) -> Spells:
    """An IMU's readings, spell by spell; spells with too few of them are left out."""
    series = imu.series
    assert isinstance(series, ImuSeries)
    t = series.t
    ends = np.arange(t[0] + SPELL_S, t[-1], SPELL_S) if len(t) else np.empty(0)
    edges = np.searchsorted(t, np.append(t[:1], ends))
    count = np.diff(edges)[:, None]
    mean, scatter = [], []
    for readings in (series.gyro_i @ imu.R_bs.T, series.accel_i @ imu.R_bs.T):
        total = np.vstack([np.zeros(3), np.cumsum(readings - readings[:1], axis=0)])
        squares = np.vstack([np.zeros(3), np.cumsum((readings - readings[:1]) ** 2, axis=0)])
        with np.errstate(invalid="ignore", divide="ignore"):
            average = np.diff(total[edges], axis=0) / count
            variance = np.diff(squares[edges], axis=0) / count - average**2
        mean.append(average + readings[:1])
        scatter.append(np.sqrt(np.maximum(variance, 0.0)).max(axis=1))
    full = count[:, 0] >= LEAST_SAMPLES
    quiet = (scatter[0] < QUIET_RATE_RAD_S) & (scatter[1] < QUIET_FORCE_M_S2)
    force_m_s2 = np.linalg.norm(mean[1], axis=1)
    level = np.abs(force_m_s2 - GRAVITY_M_S2) < GRAVITY_TOLERANCE_M_S2
    return Spells(ends, mean[0], mean[1], quiet & level).select(full)


def initial_rest(imu: Sensor) -> Rest | None:
    """The rest that an IMU's record begins with; None where it moves, or rests for two spells."""
    spells, noise = spells_of(imu), ImuNoise.model_validate(imu.noise)
    if len(spells.t) < 2:
        return None
    limits = (
        (spells.rate_b, noise.gyro_noise_density_rad_s_sqrt_hz, STEADY_RATE_RAD_S),
        (spells.force_b, noise.accel_noise_density_m_s2_sqrt_hz, STEADY_FORCE_M_S2),
    )
    steady = spells.quiet & (spells.t <= spells.t[:1] + LONGEST_REST_S)
    for mean, density, largest in limits:
        change = np.abs(mean - np.median(mean[:FIRST_SPELLS], axis=0))
        usual = np.median(change[:FIRST_SPELLS], axis=0)
        limit = STEADY_SIGMAS * np.maximum(usual, density / np.sqrt(SPELL_S))
        steady &= np.all(change < np.minimum(limit, largest), axis=1)
    n = int(np.argmin(np.append(steady, False)))
    if n < len(steady):
        n -= LAST_SPELLS  # a smooth start shows late
    if n < 2:
        return None
    rest = spells.select(slice(n))

    def spread(means: Array, density: float) -> Array:
        # sway shows as scatter of the spells' means
        sway = means.std(axis=0, ddof=1) / np.sqrt(n)
        return np.asarray(np.maximum(sway, density / np.sqrt(n * SPELL_S)))

    return Rest(
        rest,
        rest.rate_b.mean(axis=0),
        spread(rest.rate_b, noise.gyro_noise_density_rad_s_sqrt_hz),
        rest.force_b.mean(axis=0),
        spread(rest.force_b, noise.accel_noise_density_m_s2_sqrt_hz),
    )
