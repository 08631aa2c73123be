"""Range and bearing to landmarks, seen by a sensor that is mounted somewhere on the body.

In the sensor's axes (x forward, y starboard, z down) a landmark at ``p_s`` has range ``|p_s|``,
bearing ``atan2(y, x)`` and elevation ``atan2(-z, hypot(x, y))``, upward positive: equations (5) and
(6) of the planar paper where nothing tilts. A sensor that tells no elevation does not tell a
landmark's depth either: what it learns is taken to lie level with it.

At no distance a landmark has no direction: a value without information has a Jacobian and a
residual of zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, skew, wrap_angle
from gtsam_nav.mission import Sensor
from gtsam_nav.sensors.noise import LandmarkNoise
from gtsam_nav.sensors.prediction import BodyState, Prediction
from gtsam_nav.sensors.settings import LandmarkSettings
from gtsam_nav.series import BoolArray, IntArray, LandmarkSeries

NO_DIRECTION_M = 1e-3
"""Nearer than this a landmark has no direction."""
LEAST_SIGMA_M = 1e-3
"""Across a sighting: none tells where a landmark at no distance lies."""


@dataclass(frozen=True)
class Sighting:
    """One landmark, seen once: range (m), bearing and elevation (rad), None where not measured;
    the sigma of what is not measured means nothing."""

    range_m: float | None
    bearing: float | None
    elevation: float | None
    sigma_range: float
    sigma_bearing: float

    @cached_property
    def polar(self) -> Array:
        """Range, bearing and, where measured, elevation; NaN for a missing one of the first two."""
        values = [self.range_m, self.bearing]
        values += [] if self.elevation is None else [self.elevation]
        return np.array(values, dtype=float)

    @cached_property
    def rows(self) -> IntArray:
        """Which of `polar` are measured."""
        return np.flatnonzero(np.isfinite(self.polar))

    @property
    def measured(self) -> Array:
        """What is measured of range, bearing and elevation."""
        return self.polar[self.rows]

    @cached_property
    def sigma(self) -> Array:
        """Of `measured`; an elevation is as good as the bearing."""
        return np.array([self.sigma_range, self.sigma_bearing, self.sigma_bearing])[self.rows]

    @property
    def cov(self) -> Array:
        """Of `measured`."""
        return np.diag(self.sigma**2)


@dataclass(frozen=True)
class LandmarkPrediction(Prediction):
    """A sighting against a state and a landmark: ``jacobian_landmark``, shape (m, 3), is that of
    the residual in the landmark's position along the navigation axes, ``jacobian_scale``, shape
    (m,), that in the error of the ranges' scale."""

    jacobian_landmark: Array
    jacobian_scale: Array


@dataclass(frozen=True)
class Observation:
    """What a sensor would see of k landmarks.

    Attributes
    ----------
    values : ndarray, shape (k, m)
        Range, bearing and, with m = 3, elevation.
    jacobian_body : ndarray, shape (k, m, 9)
        In the errors of `BodyState`.
    jacobian_landmark : ndarray, shape (k, m, 3)
        In each landmark's position.
    """

    values: Array
    jacobian_body: Array
    jacobian_landmark: Array

    def with_ranges_scaled(self, factor: float) -> Observation:
        """What a sensor sees whose ranges are too long by a factor."""
        stretch = np.ones(self.values.shape[-1])
        stretch[0] = factor
        return Observation(
            stretch * self.values,
            stretch[:, None] * self.jacobian_body,
            stretch[:, None] * self.jacobian_landmark,
        )

    def residual(self, measured: Array) -> Array:
        """Predicted less measured, angles wrapped, zero where there is no information.

        ``measured`` has the shape of ``values``, or one that it broadcasts to.
        """
        difference = self.values - measured
        difference[..., 1:] = wrap_angle(difference[..., 1:])
        return np.where(np.any(self.jacobian_landmark, axis=-1), difference, 0.0)


@dataclass(frozen=True)
class Placement:
    """Where a first sighting puts a landmark.

    Attributes
    ----------
    p_n : ndarray, shape (3,)
    jacobian_body : ndarray, shape (3, 9)
        In the errors of `BodyState`.
    jacobian_sighting : ndarray, shape (3, m)
        In what was measured. Without elevation the landmark is level with the sensor, and its
        depth as uncertain as the sensor's.
    """

    p_n: Array
    jacobian_body: Array
    jacobian_sighting: Array


@dataclass(frozen=True)
class Polar:
    """Ranges (m) and bearings (rad) of a series that measures both, shape (n,) each."""

    range_m: Array
    bearing: Array
    sigma_range: Array
    sigma_bearing: Array


def polar(series: LandmarkSeries) -> Polar:
    """The columns of a series that measures both range and bearing.

    Raises
    ------
    DataError
        Where the sensor measures only one of them.
    """
    range_m, bearing = series.range_m, series.bearing
    sigma_range, sigma_bearing = series.sigma_range, series.sigma_bearing
    if range_m is None or bearing is None or sigma_range is None or sigma_bearing is None:
        lacking = "range" if range_m is None else "bearing"
        raise DataError(
            f"sightings of landmarks without a {lacking} cannot be used"
            " here: give both, or take the method graph"
        )
    return Polar(range_m, bearing, sigma_range, sigma_bearing)


def variance_factors(t: Array, noise: LandmarkNoise) -> Array:
    """By how much the variance of each sighting grows because earlier ones share its error.

    A mean of n values that correlate by rho_ij has the variance of one that does not, times one
    plus twice the sum of the correlations with those before: what a filter that takes every
    sighting for independent must allow for.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Rising times, s.
    noise : LandmarkNoise

    Returns
    -------
    ndarray, shape (n,)
    """
    earlier = np.zeros(len(t))
    forgotten = np.exp(-np.diff(t) / noise.correlation_time_s)
    for k, kept in enumerate(forgotten.tolist(), start=1):
        earlier[k] = kept * (earlier[k - 1] + 1.0)
    return np.asarray(1.0 + 2.0 * noise.correlated_share * earlier)


def sighting(series: LandmarkSeries, k: int) -> Sighting:
    """Sample k of a series."""

    def sample(column: Array | None) -> float | None:
        return None if column is None else float(column[k])

    return Sighting(
        sample(series.range_m),
        sample(series.bearing),
        sample(series.elevation),
        sample(series.sigma_range) or 0.0,
        sample(series.sigma_bearing) or 0.0,
    )


def measurements(series: LandmarkSeries) -> tuple[Array, Array]:
    """What `Sighting.measured` and `Sighting.cov` are of each sample: (n, m) and (n, m, m)."""
    seen = polar(series)
    angles = [seen.bearing] if series.elevation is None else [seen.bearing, series.elevation]
    sigma = np.column_stack([seen.sigma_range, *[seen.sigma_bearing] * len(angles)])
    cov = sigma[:, :, None] ** 2 * np.eye(sigma.shape[1])
    return np.column_stack([seen.range_m, *angles]), cov


def level_points(series: LandmarkSeries, sensor: Sensor) -> tuple[Array, Array]:
    """Sightings as level points in body axes, (k, 2) m, with their covariances, (k, 2, 2).

    Raises
    ------
    DataError
        Where the sensor measures only ranges or only bearings.
    """
    up = np.zeros(len(series)) if series.elevation is None else series.elevation
    seen = polar(series)
    c, s = np.cos(seen.bearing), np.sin(seen.bearing)
    direction_s = np.column_stack([np.cos(up) * c, np.cos(up) * s, -np.sin(up)])
    level_b = (direction_s @ sensor.R_bs.T)[:, :2]
    length = np.linalg.norm(level_b, axis=1, keepdims=True)
    along = level_b / np.where(length > 0, length, 1.0)
    aside = np.column_stack([-along[:, 1], along[:, 0]])
    across = np.maximum(seen.range_m * seen.sigma_bearing, LEAST_SIGMA_M)
    cov_b = (seen.sigma_range**2)[:, None, None] * along[:, :, None] * along[:, None] + (across**2)[
        :, None, None
    ] * aside[:, :, None] * aside[:, None]
    p_b = sensor.xyz_b[:2] + level_b * seen.range_m[:, None]
    return p_b, cov_b


def trusted_ids(series: LandmarkSeries, settings: LandmarkSettings) -> IntArray:
    """The sensor's ids, or -1 throughout where the association must do without them."""
    return series.id if settings.association == "ids" else np.full(len(series), -1)


def observe(
    state: BodyState,
    landmarks_n: Array,
    sensor: Sensor,
    *,
    elevation: bool,
    level: BoolArray | None = None,
) -> Observation:
    """What a sensor would see.

    Parameters
    ----------
    state : BodyState
    landmarks_n : ndarray, shape (k, 3)
    sensor : Sensor
        For its mounting.
    elevation : bool
        Whether it measures that.
    level : ndarray of bool, shape (k,), optional
        Landmarks that are taken to lie level with the sensor, whatever their d.
    """
    R_ns = state.R_nb @ sensor.R_bs
    offset_n = landmarks_n - state.p_n - state.R_nb @ sensor.xyz_b
    # how far an offset along the navigation axes counts
    counted = np.ones_like(offset_n)
    if level is not None:
        counted[level, 2] = 0.0
    offset_n = counted * offset_n
    p_s = offset_n @ R_ns
    values, jacobian_polar = polar_coordinates(p_s, elevation)
    by_landmark = R_ns.T * counted[:, None]
    by_position = -by_landmark @ state.R_nb
    by_attitude = sensor.R_bs.T @ skew(offset_n @ state.R_nb) - by_position @ skew(sensor.xyz_b)
    by_body = np.concatenate([by_attitude, by_position, np.zeros_like(by_position)], axis=-1)
    return Observation(values, jacobian_polar @ by_body, jacobian_polar @ by_landmark)


def polar_coordinates(p_s: Array, elevation: bool) -> tuple[Array, Array]:
    """Range, bearing[, elevation] of points (k, 3), and the Jacobians (k, m, 3)."""
    x, y, z = p_s.T
    level = np.hypot(x, y)
    distance = np.hypot(level, z)
    far, aside = distance > NO_DIRECTION_M, level > NO_DIRECTION_M
    u, v = np.where(far, distance, 1.0), np.where(aside, level, 1.0)
    m = 3 if elevation else 2
    values, jacobian = np.empty((len(x), m)), np.zeros((len(x), m, 3))
    values[:, 0], values[:, 1] = distance, np.arctan2(y, x)
    jacobian[:, 0] = p_s / u[:, None] * far[:, None]
    jacobian[:, 1, 0], jacobian[:, 1, 1] = aside * -y / v**2, aside * x / v**2
    if elevation:
        values[:, 2] = np.arctan2(-z, level)
        up = far & aside
        jacobian[:, 2, 0], jacobian[:, 2, 1] = up * x * z / (v * u**2), up * y * z / (v * u**2)
        jacobian[:, 2, 2] = up * -v / u**2
    return values, jacobian


def predict(
    state: BodyState, landmark_n: Array, seen: Sighting, sensor: Sensor, range_scale: float = 0.0
) -> LandmarkPrediction:
    """A sighting of a landmark against a state: what it measures of range, bearing, elevation.

    ``range_scale`` is by what share of them the ranges are too long, as with a wrong sound speed.
    """
    observed = observe(state, landmark_n[None], sensor, elevation=seen.elevation is not None)
    rows = seen.rows
    by_scale = np.where(np.arange(len(seen.polar)) == 0, observed.values[0], 0.0)
    stretched = observed.with_ranges_scaled(1.0 + range_scale)
    return LandmarkPrediction(
        stretched.residual(seen.polar)[0, rows],
        stretched.jacobian_body[0, rows],
        seen.cov,
        stretched.jacobian_landmark[0, rows],
        by_scale[rows],
    )


def place(state: BodyState, seen: Sighting, sensor: Sensor) -> Placement:
    """Where a sighting puts its landmark: the inverse of `observe`, for state augmentation.

    Raises
    ------
    DataError
        Where it lacks the range or the bearing: it takes several such sightings.
    """
    if seen.range_m is None or seen.bearing is None:
        raise DataError("a range or a bearing alone does not tell where a landmark is")
    R_ns = state.R_nb @ sensor.R_bs
    if seen.elevation is None:
        direction_n, by_attitude, by_angles = _level_direction(R_ns, seen.bearing, sensor.R_bs)
    else:
        direction_s, by_angles_s = _direction(seen.bearing, seen.elevation)
        direction_n, by_angles = R_ns @ direction_s, R_ns @ by_angles_s
        by_attitude = -state.R_nb @ skew(sensor.R_bs @ direction_s)
    by_attitude = seen.range_m * by_attitude - state.R_nb @ skew(sensor.xyz_b)
    return Placement(
        state.p_n + state.R_nb @ sensor.xyz_b + seen.range_m * direction_n,
        np.hstack([by_attitude, state.R_nb, np.zeros((3, 3))]),
        np.column_stack([direction_n, seen.range_m * by_angles]),
    )


def _direction(bearing: float, elevation: float) -> tuple[Array, Array]:
    """Unit vector in sensor axes, and its derivatives (3, 2) in both angles."""
    cb, sb, ce, se = np.cos(bearing), np.sin(bearing), np.cos(elevation), np.sin(elevation)
    return np.array([ce * cb, ce * sb, -se]), np.array(
        [[-ce * sb, -se * cb], [ce * cb, -se * sb], [0.0, -ce]]
    )


def _level_direction(R_ns: Array, bearing: float, R_bs: Array) -> tuple[Array, Array, Array]:
    """The level unit vector that has this bearing, and its derivatives in theta_b and bearing."""
    along_s = np.array([np.cos(bearing), np.sin(bearing), 0.0])
    # tilted out of the sensor's plane until it is level
    along_s[2] = -(R_ns[2, :2] @ along_s[:2]) / R_ns[2, 2]
    along_s /= np.linalg.norm(along_s)
    direction_n = R_ns @ along_s
    direction_n[2] = 0.0
    aside_n = np.array([-direction_n[1], direction_n[0], 0.0])
    _, jacobian_polar = polar_coordinates(along_s[None], elevation=False)
    bearing_row = jacobian_polar[0, 1]
    # the direction turns in the level plane so as to keep, or follow, the bearing
    turn_by_bearing = 1.0 / (bearing_row @ R_ns.T @ aside_n)
    turn_by_attitude = -turn_by_bearing * (bearing_row @ R_bs.T @ skew(R_bs @ along_s))
    return direction_n, np.outer(aside_n, turn_by_attitude), turn_by_bearing * aside_n[:, None]
