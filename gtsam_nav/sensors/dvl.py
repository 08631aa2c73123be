"""Doppler velocity log: which samples count, and the body velocity that they measure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gtsam_nav.frames import Array, skew
from gtsam_nav.mission import Rejection, Sensor
from gtsam_nav.sensors.noise import DvlNoise
from gtsam_nav.sensors.prediction import BodyState, Prediction
from gtsam_nav.series import BoolArray, DvlSeries, IntArray


@dataclass(frozen=True)
class BodyVelocities:
    """Velocities of the body's origin in body axes, (n, 3) m/s, with sigmas (n,); by a DVL, or by
    odometry. Those ``through_water`` are not over ground; none is where that is empty."""

    sensor: str
    t: Array
    v_b: Array
    sigma: Array
    row: IntArray
    rejections: tuple[Rejection, ...] = ()
    by_wheels: bool = False
    through_water: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))

    def __len__(self) -> int:
        return len(self.t)


def body_velocities(
    dvl: Sensor, omega_b: Array, water_lock_after_s: float, *, current_apart: bool = False
) -> BodyVelocities:
    """The usable samples of a DVL as velocities of the body's origin.

    Short losses of bottom lock are left to the motion model: water lock, which measures the
    water's own motion too, counts only where bottom lock stays away.

    Parameters
    ----------
    dvl : Sensor
    omega_b : ndarray, shape (n, 3)
        Angular rate at the DVL's samples, rad/s, for its lever arm.
    water_lock_after_s : float
        Longest absence of bottom lock that is bridged.
    current_apart : bool
        Whether the sigmas leave out the water's own motion, for it is an error of its own.
    """
    series = dvl.series
    assert isinstance(series, DvlSeries)
    noise = DvlNoise.model_validate(dvl.noise)
    bottom = series.valid & series.bottom_lock
    water = series.valid & ~series.bottom_lock
    absence = _seconds_without(series.t, bottom)
    used = bottom | (water & (absence > water_lock_after_s))
    v_b = noise.velocity_factor * series.v_d @ dvl.R_bs.T - np.cross(omega_b, dvl.xyz_b)
    moving = np.hypot(series.sigma, 0.0 if current_apart else noise.water_sigma_m_s)
    sigma = np.where(bottom, series.sigma, moving)
    rejections = tuple(
        Rejection(
            t=float(series.t[k]),
            sensor=dvl.name,
            index=int(series.row[k]),
            reason="water lock in a short gap" if series.valid[k] else "no lock",
        )
        for k in np.flatnonzero(~used)
    )
    return BodyVelocities(
        dvl.name,
        series.t[used],
        v_b[used],
        sigma[used],
        series.row[used],
        rejections,
        through_water=water[used],
    )


def water_spells(dvls: Sequence[Sensor], water_lock_after_s: float) -> Array:
    """First and last sample of each spell that only water lock tells of, shape (k, 2), s.

    Bottom lock of any one of the DVLs, at least one, ends it for all.
    """
    all_series = [dvl.series for dvl in dvls if isinstance(dvl.series, DvlSeries)]
    t = np.concatenate([series.t for series in all_series])
    order = np.argsort(t, kind="stable")
    t = t[order]
    valid = np.concatenate([series.valid for series in all_series])[order]
    on_bottom = np.concatenate([series.bottom_lock for series in all_series])[order]
    bottom, water = valid & on_bottom, valid & ~on_bottom
    used = water & (_seconds_without(t, bottom) > water_lock_after_s)
    # a spell lasts until bottom lock is back, whatever is missing within
    spell = np.cumsum(bottom)[used]
    t = t[used]
    first = np.flatnonzero(np.diff(spell, prepend=-1))
    last = np.append(first[1:], len(t)) - 1
    return np.column_stack([t[first], t[last]]) if len(t) else np.empty((0, 2))


def _seconds_without(t: Array, present: BoolArray) -> Array:
    """Length of the spell without ``present`` that each sample stands in."""
    marks = t[present]
    before = np.append(-np.inf, marks)[np.searchsorted(marks, t, side="right")]
    after = np.append(marks, np.inf)[np.searchsorted(marks, t, side="left")]
    return np.asarray(after - before)


def predict(state: BodyState, v_b: Array, sigma: float) -> Prediction:
    """Body velocity against a state: ``R_nb' v_n - v_b``."""
    v_predicted_b = state.R_nb.T @ state.v_n
    jacobian = np.hstack([skew(v_predicted_b), np.zeros((3, 3)), np.eye(3)])
    return Prediction(v_predicted_b - v_b, jacobian, sigma**2 * np.eye(3))
