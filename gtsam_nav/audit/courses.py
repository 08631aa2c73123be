"""Which way the vehicle went, by fixes, and by compass and velocities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.audit.motion import turned
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.sensors.noise import DvlNoise
from gtsam_nav.sensors.orientation import headings_true
from gtsam_nav.series import (
    BoolArray,
    DvlSeries,
    GnssSeries,
    HeadingSeries,
    IntArray,
    OdometrySeries,
)

BASELINE_M = 15.0
"""Shortest distance between two fixes that is taken for a course ..."""
BASELINE_SIGMAS = 12.0
"""... and in standard deviations of a fix."""
LONGEST_BASELINE_S = 180.0
FEWEST_BASELINES = 5
LONGEST_GAP_S = 10.0
"""A baseline with a longer silence of the velocity sensor tells nothing."""
BOW = "bow"
"""Stands for a velocity sensor where there is none: the vehicle goes where its bow points."""


@dataclass(frozen=True)
class Velocity:
    """Velocities that a sensor measured.

    Attributes
    ----------
    name : str
        Of the sensor, or `BOW`.
    t : ndarray, shape (n,)
    v_s : ndarray, shape (n, 3)
        Along the instrument's axes, m/s.
    R_bs : ndarray, shape (3, 3)
    """

    name: str
    t: Array
    v_s: Array
    R_bs: Array

    def v_b(self, axes: Array | None = None) -> Array:
        """Forward and to starboard, (n, 2), with the instrument's axes exchanged first."""
        read = self.v_s if axes is None else self.v_s @ axes.T
        return np.asarray((read @ self.R_bs.T)[:, :2])


@dataclass(frozen=True)
class Baselines:
    """Stretches of the way between two fixes that are well apart.

    Attributes
    ----------
    gnss : Sensor
    compass : HeadingSeries
        Declination applied.
    start, stop : ndarray of int, shape (k,)
        Indices of the fixes.
    fixes : GnssSeries
    length_m : float
    """

    gnss: Sensor
    compass: HeadingSeries
    start: IntArray
    stop: IntArray
    fixes: GnssSeries
    length_m: float

    def seen(self, heading: Array) -> Array:
        """Displacement (k, 2) of the body's origin, north and east, by headings of the compass."""
        at_fix = np.interp(self.fixes.t, self.compass.t, heading)
        lever_b = self.gnss.xyz_b[None, :2]
        body_n = self.fixes.p_n[:, :2] - turned(lever_b, at_fix)
        return np.asarray(body_n[self.stop] - body_n[self.start])

    def reckoned(self, heading: Array, velocity: Velocity, axes: Array | None = None) -> Array:
        """The same by velocities, up to scale where these are the bow's."""
        t = self.compass.t
        v_b = velocity.v_b(axes)
        at_t = np.stack([np.interp(t, velocity.t, axis) for axis in v_b.T], axis=1)
        way_n = way(t, turned(at_t, heading))
        at_fix = np.stack([np.interp(self.fixes.t, t, axis) for axis in way_n.T], axis=1)
        return np.asarray(at_fix[self.stop] - at_fix[self.start])

    def direction_errors(
        self, heading: Array, velocity: Velocity, axes: Array | None = None
    ) -> Array:
        """Reckoned less observed direction of each baseline, rad."""
        reckoned, seen = self.reckoned(heading, velocity, axes), self.seen(heading)
        return wrap_angle(
            np.arctan2(reckoned[:, 1], reckoned[:, 0]) - np.arctan2(seen[:, 1], seen[:, 0])
        )

    def covered(self, velocity: Velocity) -> BoolArray:
        """The baselines over which the velocities never fall silent for long."""
        t = np.concatenate([[-np.inf], velocity.t, [np.inf]])
        silent = np.flatnonzero(np.diff(t) > LONGEST_GAP_S)
        begins, ends = t[silent], t[silent + 1]
        first, last = self.fixes.t[self.start], self.fixes.t[self.stop]
        return np.asarray(
            ~np.any((begins[:, None] < last) & (ends[:, None] > first), axis=0)
            if len(silent)
            else np.ones(len(first), dtype=bool)
        )


def velocity_sources(mission: Mission) -> tuple[Velocity, ...]:
    """DVLs over ground, odometry, and the bow."""
    found = []
    for sensor in (*mission.of_type("dvl"), *mission.of_type("odometry")):
        velocity = measured_velocity(sensor)
        if len(velocity.t) > 1:
            found.append(velocity)
    t = np.arange(*mission.span_s)
    return (*found, Velocity(BOW, t, np.tile([1.0, 0.0, 0.0], (len(t), 1)), np.eye(3)))


def way(t: Array, v_n: Array) -> Array:
    """The way made at velocities (n, 2), by the trapezoidal rule."""
    steps = 0.5 * (v_n[1:] + v_n[:-1]) * np.diff(t)[:, None]
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def measured_velocity(sensor: Sensor) -> Velocity:
    """What a DVL that sees the bottom, or odometry, measured."""
    series = sensor.series
    if isinstance(series, OdometrySeries):
        level = np.column_stack([series.v_b, np.zeros(len(series))])
        return Velocity(sensor.name, series.t, level, sensor.R_bs)
    assert isinstance(series, DvlSeries)
    locked = series.valid & series.bottom_lock
    factor = DvlNoise.model_validate(sensor.noise).velocity_factor
    return Velocity(sensor.name, series.t[locked], factor * series.v_d[locked], sensor.R_bs)


def compass_series(mission: Mission) -> HeadingSeries | None:
    """Headings of the first compass from true north; as it reads where north is unknown."""
    try:
        return headings_true(mission)
    except DataError:
        sensor = mission.first("heading")
        assert sensor is not None
        assert isinstance(sensor.series, HeadingSeries)
        return sensor.series


def baselines(mission: Mission, compass: HeadingSeries | None) -> Baselines | None:
    """Stretches between fixes so much further apart than their noise that the course is known.

    Returns
    -------
    Baselines or None
        None without GNSS or compass, or with fewer than `FEWEST_BASELINES`.
    """
    gnss = mission.first("gnss")
    if gnss is None or compass is None or len(compass) < 2:
        return None
    fixes = gnss.series.crop(compass.t[0], compass.t[-1])
    assert isinstance(fixes, GnssSeries)
    if len(fixes) < 2:
        return None
    length_m = max(BASELINE_M, BASELINE_SIGMAS * float(np.median(fixes.sigma[:, :2])))
    pairs = far_apart(fixes, length_m)
    if len(pairs) < FEWEST_BASELINES:
        return None
    start, stop = np.array(pairs).T
    return Baselines(gnss, compass, start, stop, fixes, length_m)


def far_apart(fixes: GnssSeries, length_m: float) -> list[tuple[int, int]]:
    """Pairs of fixes, one after the other, that are far enough apart."""
    pairs, first = [], 0
    for k in range(1, len(fixes)):
        if fixes.t[k] - fixes.t[first] > LONGEST_BASELINE_S:
            first += int(np.searchsorted(fixes.t[first:], fixes.t[k] - LONGEST_BASELINE_S))
        if np.hypot(*(fixes.p_n[k, :2] - fixes.p_n[first, :2])) >= length_m:
            pairs.append((first, k))
            first = k
    return pairs
