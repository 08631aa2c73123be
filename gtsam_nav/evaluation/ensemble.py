"""Consistency over many missions: normalised errors averaged over the runs, time by time.

Bar-Shalom, Li & Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001),
section 5.4: with N independent runs of an honest estimator, N times the average NEES of a time is
chi-square with N times as many degrees of freedom, and so lies inside its 95 % bounds at 95 % of
the times. Innovations of an honest filter are white besides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gtsam_nav.evaluation.consistency import horizontal_nees
from gtsam_nav.evaluation.matching import match
from gtsam_nav.evaluation.metrics import reference_series
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Sensor
from gtsam_nav.solution import Innovations
from gtsam_nav.trajectory import Trajectory


@dataclass(frozen=True)
class NormalisedErrors:
    """Squared errors over their variance at given times of one run.

    Attributes
    ----------
    t : ndarray, shape (n,)
    values : mapping of str to ndarray, shape (n,)
        By quantity: ``position`` (n and e together), ``heading``, ``velocity_n``, ``velocity_e``.
    dof : mapping of str to int
    """

    t: Array
    values: Mapping[str, Array]
    dof: Mapping[str, int]


@dataclass(frozen=True)
class EnsembleConsistency:
    """Average of a normalised squared error over runs, with the bounds of an honest estimator.

    Attributes
    ----------
    t : ndarray, shape (n,)
    average : ndarray, shape (n,)
        Over the runs, for each time.
    lower95, upper95 : ndarray, shape (n,)
        That hold 95 % of the averages of an honest estimator.
    dof : int
        Expected average.
    """

    t: Array
    average: Array
    lower95: Array
    upper95: Array
    dof: int

    @property
    def mean(self) -> float:
        """Average over runs and times."""
        return float(np.mean(self.average))

    @property
    def fraction_inside(self) -> float:
        """Share of the times at which the average lies within its bounds."""
        return float(np.mean((self.average >= self.lower95) & (self.average <= self.upper95)))


def normalised_errors(trajectory: Trajectory, truth: Sensor, t: Array) -> NormalisedErrors:
    """Normalised squared errors of position, heading and velocity against a simulation's truth.

    Parameters
    ----------
    trajectory : Trajectory
        With covariances.
    truth : Sensor
        A dense reference with attitude, without noise.
    t : ndarray, shape (n,)
        Times at which to compare; a reference sample must lie within its own period of each.

    Raises
    ------
    ValueError
        Where the trajectory lacks covariances, the truth its attitude, or a time is not covered.
    """
    series = reference_series(truth)
    if series.rpy is None or trajectory.cov_pose_n is None:
        raise ValueError("consistency needs a truth with attitude and an estimate with covariances")
    if not np.all(trajectory.covers(t)):
        raise ValueError("the estimate does not cover all times")
    nearest = np.unique(np.clip(np.searchsorted(series.t, t), 1, len(series) - 2))
    # the velocity of the truth by central differences
    truth_v_n = (series.p_n[nearest + 1] - series.p_n[nearest - 1]) / (
        series.t[nearest + 1] - series.t[nearest - 1]
    )[:, None]
    matched = match(trajectory, series.select(nearest), truth.xyz_b)
    assert matched is not None
    assert matched.reference.rpy is not None
    estimate = matched.estimate
    position = horizontal_nees(matched)
    sigma_rpy = trajectory.interpolate(matched.t).sigma_rpy
    assert position is not None
    assert sigma_rpy is not None
    if len(position) < len(matched.t):
        raise ValueError("the estimate's covariance is singular at some of the times")
    heading = wrap_angle(estimate.yaw - matched.reference.rpy[:, 2]) / sigma_rpy[:, 2]
    values, dof = {"position": position, "heading": heading**2}, {"position": 2, "heading": 1}
    own = trajectory.interpolate(matched.t)
    if own.v_n is not None and own.sigma_v_n is not None and not np.any(truth.xyz_b):
        whitened = (own.v_n - truth_v_n) / own.sigma_v_n
        values |= {"velocity_n": whitened[:, 0] ** 2, "velocity_e": whitened[:, 1] ** 2}
        dof |= {"velocity_n": 1, "velocity_e": 1}
    return NormalisedErrors(matched.t, values, dof)


def ensemble_nees(runs: Sequence[NormalisedErrors]) -> dict[str, EnsembleConsistency]:
    """Average the errors of runs that were compared at the same times, by quantity."""
    first = runs[0]
    out = {}
    for name, dof in first.dof.items():
        average = np.mean([run.values[name] for run in runs], axis=0)
        count = np.full(len(first.t), len(runs))
        out[name] = EnsembleConsistency(first.t, average, *_bounds(count, dof), dof)
    return out


def ensemble_nis(runs: Sequence[Innovations], bin_s: float) -> EnsembleConsistency:
    """Average the normalised innovations of one sensor over runs and short spans of time.

    Innovations of an honest filter are independent, so those of one span count as so many runs.
    """
    t = np.concatenate([run.t for run in runs])
    nis = np.concatenate([run.nis for run in runs])
    dof = runs[0].dof
    which = np.floor(t / bin_s).astype(int)
    bins, which = np.unique(which, return_inverse=True)
    count = np.bincount(which)
    average = np.bincount(which, nis) / count
    return EnsembleConsistency((bins + 0.5) * bin_s, average, *_bounds(count, dof), dof)


BANDS = (1.0, 2.0, 3.0)
"""Sigmas of the bands whose coverage is counted."""


def band_coverage(runs: Sequence[NormalisedErrors]) -> dict[str, tuple[float, ...]]:
    """Share of the errors within the 1, 2 and 3 sigma bands, by quantity.

    A position in the plane counts as within the ellipse of the band's probability: an honest
    estimator has 0.683, 0.954 and 0.997 of any quantity.
    """
    from scipy.special import erf, gammaincinv

    shares = {}
    for name, dof in runs[0].dof.items():
        squared = np.concatenate([run.values[name] for run in runs])
        limits = [2.0 * gammaincinv(dof / 2.0, erf(k / np.sqrt(2.0))) for k in BANDS]
        shares[name] = tuple(float(np.mean(squared <= limit)) for limit in limits)
    return shares


@dataclass(frozen=True)
class Whiteness:
    """Autocorrelation of successive innovations of one sensor.

    Attributes
    ----------
    autocorrelation : float
        Mean over the runs; zero for an honest filter.
    bound95 : float
        Mean of what 95 % of the runs of an honest filter stay below, either way.
    fraction_inside : float
        Share of the runs that do.
    """

    autocorrelation: float
    bound95: float
    fraction_inside: float


def whiteness(runs: Sequence[Innovations]) -> Whiteness | None:
    """Test the innovations of one sensor for whiteness; None where a method keeps only their NIS.

    The time-average autocorrelation at a lag of one update is normal about zero, with a variance of
    one over the number of components.
    """
    found = []
    for run in runs:
        if run.whitened is None or len(run.t) < 2:
            return None
        now, then = run.whitened[1:], run.whitened[:-1]
        rho = np.sum(now * then) / np.sqrt(np.sum(now**2) * np.sum(then**2))
        found.append((rho, 1.96 / np.sqrt(now.size)))
    rho, bound = np.array(found).T
    inside = np.mean(np.abs(rho) <= bound)
    return Whiteness(float(np.mean(rho)), float(np.mean(bound)), float(inside))


def _bounds(count: NDArray[np.integer], dof: int) -> tuple[Array, Array]:
    from scipy.special import gammaincinv

    lower, upper = (2.0 * gammaincinv(count * dof / 2.0, p) / count for p in (0.025, 0.975))
    return np.asarray(lower), np.asarray(upper)
