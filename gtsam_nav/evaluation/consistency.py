"""Whether errors are as large as the estimator says: NEES and NIS against chi-square."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.evaluation.matching import Matched
from gtsam_nav.frames import Array

OVERCONFIDENT = 3.0
"""Normalised squared errors that are so many times what they should be are worth a sentence."""
CAUTIOUS = 0.2
"""And so are those that are no more than this share of it."""
TINY = 1e-6
"""Stands for none at all."""


@dataclass(frozen=True)
class Consistency:
    """Normalised squared errors of a filter or smoother.

    Attributes
    ----------
    mean : float
        ``dof`` for an estimator that is honest; more is overconfident, less is timid.
    dof : int
    lower95, upper95 : float
        Bounds that hold 95 % of the samples of an honest estimator.
    fraction_inside : float
        Share of the samples within these bounds.
    """

    mean: float
    dof: int
    lower95: float
    upper95: float
    fraction_inside: float

    @property
    def doubt(self) -> str:
        """What to say of errors far larger, or smaller, than their covariance has them; empty
        where they fit."""
        times = float(np.sqrt(max(self.mean / self.dof, TINY)))
        if self.mean > OVERCONFIDENT * self.dof:
            return f"the errors are {times:.1f} times what the covariance states"
        if self.mean < CAUTIOUS * self.dof:
            return f"the covariance states errors {1 / times:.1f} times what they are"
        return ""


def consistency(squared: Array, dof: int) -> Consistency | None:
    """Compare normalised squared errors with the chi-square distribution.

    Parameters
    ----------
    squared : ndarray, shape (m,)
        NEES or NIS of each sample; what is not finite is left out.
    dof : int
        Degrees of freedom of a sample.
    """
    from scipy.special import gammaincinv

    squared = squared[np.isfinite(squared)]
    if not len(squared):
        return None
    lower, upper = (2.0 * float(gammaincinv(dof / 2.0, p)) for p in (0.025, 0.975))
    inside = (squared >= lower) & (squared <= upper)
    return Consistency(
        mean=float(np.mean(squared)),
        dof=dof,
        lower95=lower,
        upper95=upper,
        fraction_inside=float(np.mean(inside)),
    )


def horizontal_nees(matched: Matched) -> Array | None:
    """NEES on (n, e) at the antenna, shape (k,): e' (P + R_ref)^-1 e, without alignment.

    Samples whose covariance is singular (a start that was declared perfect) are left out; None
    where the estimate has no covariance.
    """
    if matched.cov_ne is None:
        return None
    error = (matched.estimate.p_n - matched.reference.p_n)[:, :2]
    cov = total_covariance_ne(matched)
    determinant = cov[:, 0, 0] * cov[:, 1, 1] - cov[:, 0, 1] * cov[:, 1, 0]
    usable = determinant > 0
    whitened = np.linalg.solve(cov[usable], error[usable, :, None])[:, :, 0]
    return np.asarray(np.sum(error[usable] * whitened, axis=1))


def total_covariance_ne(matched: Matched) -> Array:
    """Covariance of estimate minus reference on (n, e), shape (m, 2, 2), m^2."""
    assert matched.cov_ne is not None
    if matched.reference.sigma is None:
        return matched.cov_ne
    return np.asarray(matched.cov_ne + np.eye(2) * (matched.reference.sigma**2)[:, None, None])
