"""How far a registration looks around its prior."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array

PRIOR_FLOOR = np.array([0.3, 0.3, np.radians(2.0)])
"""A registration always looks at least this far (x, y, yaw) around its prior."""
PRIOR_CAP = np.array([4.0, 4.0, np.radians(20.0)])
"""And never further: from worse starts it would settle on the wrong wall."""
LEAST_VARIANCE = 1e-12


def looked_around(cov_prior: Array) -> Array:
    """Covariance (3, 3) of a prior with standard deviations that are no smaller or larger."""
    sigma = np.sqrt(np.maximum(np.diag(cov_prior), LEAST_VARIANCE))
    factor = np.clip(sigma, PRIOR_FLOOR, PRIOR_CAP) / sigma
    return np.asarray(cov_prior * np.outer(factor, factor))
