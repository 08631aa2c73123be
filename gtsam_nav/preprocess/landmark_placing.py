"""Where a landmark is that single sightings do not place: from ranges alone, or bearings alone.

A circle of places, or a ray, fits one sighting. Several, along the vehicle's own motion, leave a
few: each is found by least squares from starts all along the circle or the ray. A landmark is
placed once one place is left, and that is certain enough to linearise about: after parallax for
bearings; for ranges after a turn, because along a straight line two mirrored places fit alike.
Lemaire, Lacroix and Sola, *A practical 3D bearing-only SLAM algorithm*, IROS 2005, delay likewise.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.sensors.landmarks import Sighting, polar_coordinates
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.series import BoolArray

LEAST_VIEWS, MOST_VIEWS = 3, 60
"""A place needs so many; more are thinned evenly."""
GROWTH = 1.2
"""A further attempt is made once there are so many times more views."""
AROUND, UP_RAD = 24, np.radians([-60.0, -30.0, 0.0, 30.0, 60.0])
"""Starts on a circle, and elevations of the circles on a sphere."""
ALONG_M = np.geomspace(1.0, 200.0, 16)
"""Starts on a ray."""
STEPS = 15
GATE = chi2_limit(0.999, 1)
RIVAL = chi2_limit(0.999, 2)
"""A place whose cost is this much higher than the best one's is no rival."""
APART_SIGMAS = 3.0
"""Places that are nearer to each other are the same."""
MOST_SIGMA_SHARE = 0.1
"""How uncertain a place may be, as a share of its distance."""
LEAST_FITTING = 0.6
"""Share of the views that must agree with a place."""

TWO_PLACES = "two mirrored places fit its ranges: the path is too straight, or too flat"
NO_PARALLAX = "too little parallax to place the landmark"
NO_PLACE = "no place fits most of its sightings"


@dataclass(frozen=True)
class Views:
    """Sightings of one landmark along dead-reckoned motion, in the order of time.

    Attributes
    ----------
    sightings : list of Sighting
        All of the same kind.
    R_ns : ndarray, shape (k, 3, 3)
        The sensor's axes.
    p_n : ndarray, shape (k, 3)
        Its places, m.
    position_variance, yaw_variance : ndarray, shape (k,)
        Of the motion since the start, m^2 and rad^2.
    """

    sightings: list[Sighting]
    R_ns: Array
    p_n: Array
    position_variance: Array
    yaw_variance: Array

    def __len__(self) -> int:
        return len(self.sightings)

    def until(self, n: int) -> Views:
        """The first n, thinned."""
        k = np.unique(np.linspace(0, n - 1, MOST_VIEWS).astype(int))
        return Views(
            [self.sightings[i] for i in k],
            self.R_ns[k],
            self.p_n[k],
            self.position_variance[k],
            self.yaw_variance[k],
        )


@dataclass(frozen=True)
class Placed:
    """A landmark's place in the frame of the motion, and how many views it took."""

    p_n: Array
    n_views: int


def place_by_views(views: Views, *, level: bool, range_scale_sigma: float) -> Placed | str:
    """Place a landmark as early as its sightings allow; why not, where they never do.

    Parameters
    ----------
    views : Views
    level : bool
        The landmark is taken to lie level with the sensor.
    range_scale_sigma : float
        Spread of the share by which all ranges are too long.
    """
    why = NO_PARALLAX
    for n in _attempts(len(views)):
        found = _Search(views.until(n), level, range_scale_sigma).place()
        if not isinstance(found, str):
            return Placed(found, n)
        why = found
    return why


def _attempts(n_views: int) -> Iterator[int]:
    n = LEAST_VIEWS
    while n < n_views:
        yield n
        n = max(n + 1, int(GROWTH * n))
    if n_views >= LEAST_VIEWS:
        yield n_views


@dataclass(frozen=True)
class _Fit:
    """A place, its covariance, its cost, and how many views agree."""

    p_n: Array
    cov: Array
    cost: float
    share: float


class _Search:
    """Places that fit some views; parameters are n, e[, d] and the range scale."""

    def __init__(self, views: Views, level: bool, range_scale_sigma: float) -> None:
        self.views, self.level = views, level
        self.polar = np.array([seen.polar for seen in views.sightings])
        self.rows = views.sightings[0].rows
        self.sigma = np.sqrt([np.diag(seen.cov) for seen in views.sightings])
        self.axes = 2 if level else 3
        self.scale_precision = 1.0 / max(range_scale_sigma, 1e-6) ** 2

    def place(self) -> Array | str:
        refined = [self._refined(start) for start in self._starts()]
        fits = [fit for fit in refined if fit is not None and fit.share >= LEAST_FITTING]
        if not fits:
            return NO_PARALLAX if None in refined else NO_PLACE
        best = min(fits, key=lambda fit: fit.cost)
        if not self._is_certain(best):
            return NO_PARALLAX
        rivals = [fit for fit in fits if fit.cost - best.cost < RIVAL and _is_apart(fit, best)]
        return TWO_PLACES if rivals else best.p_n

    def _starts(self) -> list[Array]:
        """Along the circle, sphere or ray of the middle view."""
        k = len(self.views) // 2
        seen, up = self.views.sightings[k], np.zeros(1) if self.level else UP_RAD
        if seen.bearing is None:
            assert seen.range_m is not None
            along = np.array([seen.range_m])
            around = np.arange(AROUND) * 2 * np.pi / AROUND
        else:
            along, around = ALONG_M, np.array([seen.bearing])
            up = up if seen.elevation is None else np.array([seen.elevation])
        distance, bearing, elevation = (
            grid.ravel() for grid in np.meshgrid(along, around, up, indexing="ij")
        )
        level = distance * np.cos(elevation)
        p_s = np.column_stack(
            [level * np.cos(bearing), level * np.sin(bearing), -distance * np.sin(elevation)]
        )
        return list(self.views.p_n[k] + p_s @ self.views.R_ns[k].T)

    def _refined(self, p_n: Array) -> _Fit | None:
        """Gauss-Newton under Cauchy's weights."""
        n, x = self.axes, np.append(p_n[: self.axes], 0.0)
        for _ in range(STEPS):
            residual, J, sigma = self._residuals(np.append(x[:n], p_n[n:]), x[n])
            whitened = residual / sigma
            weight = 1.0 / (1.0 + whitened**2 / GATE) / sigma**2
            normal = np.einsum("km,kmi,kmj->ij", weight, J, J)
            normal[n, n] += self.scale_precision
            gradient = np.einsum("km,kmi,km->i", weight, J, residual)
            gradient[n] += self.scale_precision * x[n]
            if not np.all(np.isfinite(normal)) or np.linalg.cond(normal) > 1e12:
                return None
            step = np.linalg.solve(normal, gradient)
            x = x - step
            if np.max(np.abs(step[:n])) < 1e-4:
                break
        squared = np.sum(whitened**2, axis=1)
        cov = np.linalg.inv(normal)[:n, :n]
        cost = float(np.sum(np.minimum(squared, GATE)) + self.scale_precision * x[n] ** 2)
        return _Fit(np.append(x[:n], p_n[n:]), cov, cost, float(np.mean(squared <= GATE)))

    def _residuals(self, p_n: Array, scale: float) -> tuple[Array, Array, Array]:
        """Residuals (k, m), Jacobians (k, m, axes + 1) and sigmas (k, m) with the drift's share."""
        v, stretch = self.views, 1.0 + scale
        offset_n = p_n - v.p_n
        if self.level:
            offset_n[:, 2] = 0.0
        p_s = np.einsum("kji,kj->ki", v.R_ns, offset_n)
        values, by_point = polar_coordinates(p_s, self.polar.shape[1] == 3)
        J = np.zeros((*values.shape, self.axes + 1))
        J[..., : self.axes] = (by_point @ np.swapaxes(v.R_ns, 1, 2))[..., : self.axes]
        J[:, 0, : self.axes] *= stretch
        J[:, 0, -1] = values[:, 0]
        residual = values - self.polar
        residual[:, 0] += scale * values[:, 0]
        residual[:, 1:] = wrap_angle(residual[:, 1:])
        # the motion's errors since the latest view
        moved = v.position_variance[-1] - v.position_variance
        turned = v.yaw_variance[-1] - v.yaw_variance
        moved = moved + turned * np.sum((v.p_n - v.p_n[-1]) ** 2, axis=1) / 3
        drift = np.column_stack(
            [moved, *[moved / np.maximum(values[:, 0], 1.0) ** 2 + turned] * (values.shape[1] - 1)]
        )
        sigma = np.sqrt(self.sigma**2 + drift[:, self.rows])
        return residual[:, self.rows], J[:, self.rows], sigma

    def _is_certain(self, fit: _Fit) -> bool:
        distance = float(np.min(np.linalg.norm(fit.p_n - self.views.p_n, axis=1)))
        sigma = float(np.sqrt(np.linalg.eigvalsh(fit.cov)[-1]))
        return sigma <= MOST_SIGMA_SHARE * distance


def _is_apart(fit: _Fit, best: _Fit) -> BoolArray:
    off = (fit.p_n - best.p_n)[: len(best.cov)]
    return np.asarray(off @ np.linalg.solve(best.cov + fit.cov, off) > APART_SIGMAS**2)
