"""The way of a GNSS antenna by its receiver's own velocities, to compare successive fixes with.

These are of carrier phases or Doppler shifts, which know nothing of the ambiguities that a position
rests on. A DVL, wheels or an IMU would be no such witness: of a jump that fixes have and these have
not, a wheel that slipped, a false bottom lock or a compass beside iron is as likely the cause.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.sensors.noise import GnssNoise
from gtsam_nav.series import GnssSeries


@dataclass(frozen=True)
class AntennaPath:
    """A level path at the fixes' times, from anywhere on.

    Attributes
    ----------
    p : ndarray, shape (n, 2)
        North and east, m.
    v : ndarray, shape (n, 2)
        Of the antenna, m/s.
    variance : ndarray, shape (n,)
        Of the way since the first fix, each axis, as far as it is white noise, m^2.
    """

    p: Array
    v: Array
    variance: Array


def antenna_path(series: GnssSeries, t: Array, noise: GnssNoise) -> AntennaPath | None:
    """The path at given times; None where the receiver tells no velocities."""
    if series.v_n is None:
        return None
    told = series.t - noise.velocity_lag_s
    v = np.stack([np.interp(t, told, axis) for axis in series.v_n[:, :2].T], axis=1)
    steps_s = np.diff(t)
    way = 0.5 * (v[1:] + v[:-1]) * steps_s[:, None]
    variance = noise.sigma_velocity_m_s**2 * steps_s**2 / 2
    return AntennaPath(
        np.vstack([np.zeros(2), np.cumsum(way, axis=0)]),
        v,
        np.concatenate([[0.0], np.cumsum(variance)]),
    )
