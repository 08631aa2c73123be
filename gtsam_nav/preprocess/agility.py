"""How fast a vehicle changes its velocities, where it does so faster than the settings expect.

The motion model's accelerations are those of a vehicle that floats. One that drives may change its
speed by metres per second within a second: its velocity sensor would fail every gate. Nothing but
that sensor and the compass is asked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.series import DvlSeries, HeadingSeries, OdometrySeries, Series

LAG_S = 1.0
"""Velocities are compared over this long: beyond the readings' noise, within a manoeuvre."""
FEWEST_PAIRS = 20
ONE_SIGMA_PERCENTILE, STRONGEST_PERCENTILE = 68.27, 99.0
BRISK = 2.0
"""Usual changes that are this many times what the settings expect call for another model."""
GAUSSIAN_MAD = 1.4826


@dataclass(frozen=True)
class Changes:
    """Changes of a velocity over the lag as densities of a white acceleration, per root Hz.

    ``usual`` is what remains of the one-sigma change beyond the readings' noise, ``strongest`` the
    change that one in a hundred exceeds: manoeuvres last, and white acceleration that is to follow
    them has these for its one sigma.
    """

    usual: float = 0.0
    strongest: float = 0.0


def fitted_to(mission: Mission, settings: MotionSettings) -> tuple[MotionSettings, tuple[str, ...]]:
    """Settings whose accelerations reach what the sensors show, and what to say of it.

    All stay while the vehicle's usual changes are no more than `BRISK` times what the settings
    expect, and without ``fit_accelerations``.

    Parameters
    ----------
    mission : Mission
    settings : MotionSettings
    """
    if not settings.fit_accelerations:
        return settings, ()
    speeds = [_speed_changes(s.series) for k in ("dvl", "odometry") for s in mission.of_type(k)]
    turns = [_turn_changes(s.series) for s in mission.of_type("heading")]
    raised: dict[str, float] = {}
    for name, shown in (("sigma_accel_m_s2", speeds), ("sigma_yaw_accel_rad_s2", turns)):
        most = max(shown, key=lambda changes: changes.usual, default=Changes())
        if most.usual > BRISK * getattr(settings, name):
            raised[name] = most.strongest
    level = raised.get("sigma_accel_m_s2")
    if level is not None:
        share = settings.sigma_vertical_accel_m_s2 / settings.sigma_accel_m_s2
        raised["sigma_vertical_accel_m_s2"] = share * level
    if not raised:
        return settings, ()
    listed = ", ".join(f"motion.{name} is {value:.2g}" for name, value in raised.items())
    note = f"the vehicle moves more briskly than the default motion model: {listed} here"
    return settings.model_copy(update=raised), (note,)


def _speed_changes(series: Series) -> Changes:
    """Of the horizontal velocity, m/s^2/sqrt(Hz)."""
    if isinstance(series, DvlSeries):
        good = series.valid & series.bottom_lock
        return _changes(series.t[good], series.v_d[good, :2], series.sigma[good])
    assert isinstance(series, OdometrySeries)
    return _changes(series.t, series.v_b, series.sigma_v)


def _turn_changes(series: Series) -> Changes:
    """Of the yaw rate, rad/s^2/sqrt(Hz)."""
    assert isinstance(series, HeadingSeries)
    after = np.searchsorted(series.t, series.t + LAG_S)
    a = np.flatnonzero(after < len(series))
    b = after[a]
    dt = series.t[b] - series.t[a]
    heading = np.unwrap(series.heading)
    sigma = np.sqrt(2.0) * series.sigma[a] / dt
    found = _changes(series.t[a] + dt / 2, ((heading[b] - heading[a]) / dt)[:, None], sigma)
    # a lag's mean rate shows two thirds of the variance that a walk adds over it
    return Changes(np.sqrt(1.5) * found.usual, np.sqrt(1.5) * found.strongest)


def _changes(t: Array, values: Array, sigma: Array) -> Changes:
    """Of the most restless column (n, k) with white noise of ``sigma`` or what successive readings
    show, whichever is larger."""
    after = np.searchsorted(t, t + LAG_S)
    a = np.flatnonzero(after < len(t))
    a = a[t[after[a]] - t[a] < 2 * LAG_S]
    if len(a) < FEWEST_PAIRS:
        return Changes()
    b = after[a]
    change = np.abs(values[b] - values[a]) / np.sqrt(np.median(t[b] - t[a]))
    usual, strongest = np.percentile(change, [ONE_SIGMA_PERCENTILE, STRONGEST_PERCENTILE], axis=0)
    steps = np.diff(values, axis=0)
    shown = GAUSSIAN_MAD * np.median(np.abs(steps - np.median(steps, axis=0)), axis=0)
    noise2 = np.maximum(shown**2, 2 * np.median(sigma) ** 2)
    beyond = np.sqrt(np.maximum(usual**2 - noise2, 0.0))
    most = int(np.argmax(beyond))
    return Changes(float(beyond[most]), float(strongest[most]))
