"""What every sensor model returns: residual, Jacobian and covariance of a measurement."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from gtsam_nav.frames import Array


@dataclass(frozen=True)
class BodyState:
    """Attitude, position and velocity of the body's origin.

    Errors are ordered (theta_b, rho_b, nu_b): ``R_nb Exp(theta_b)``, ``p_n + R_nb rho_b`` and
    ``v_n + R_nb nu_b``.
    """

    R_nb: Array
    p_n: Array
    v_n: Array


@dataclass(frozen=True)
class Prediction:
    """A measurement against a state.

    Attributes
    ----------
    residual : ndarray, shape (m,)
        Predicted less measured.
    jacobian : ndarray, shape (m, 9)
        Of the residual in the errors of `BodyState`.
    cov : ndarray, shape (m, m)
        Of the measurement noise.
    """

    residual: Array
    jacobian: Array
    cov: Array

    @property
    def whitened_cost(self) -> float:
        """Squared Mahalanobis norm of the residual."""
        return float(self.residual @ np.linalg.solve(self.cov, self.residual))


@cache
def chi2_limit(probability: float, dof: int) -> float:
    """Value that a chi-square variable exceeds with one minus this probability."""
    from scipy.special import gammaincinv  # scipy.stats takes a second to import

    return 2.0 * float(gammaincinv(dof / 2, probability))
