"""How far a registration looks: between a floor and a cap, correlations kept."""

from __future__ import annotations

import numpy as np

from gtsam_nav.registration.prior import looked_around


def test_a_prior_in_between_stays_what_it_is() -> None:
    cov = np.diag([1.0, 2.0, 0.01])
    cov[0, 1] = cov[1, 0] = 0.5
    np.testing.assert_array_equal(looked_around(cov), cov)


def test_sharp_priors_are_widened_and_vague_ones_narrowed() -> None:
    R = np.array([[1.0, 0.6, 0.0], [0.6, 1.0, -0.3], [0.0, -0.3, 1.0]])
    for sigma, expected in (
        ([1e-3, 50.0, 1e-4], [0.3, 4.0, np.radians(2.0)]),
        ([50.0, 1e-3, 3.0], [4.0, 0.3, np.radians(20.0)]),
    ):
        found = looked_around(R * np.outer(sigma, sigma))
        np.testing.assert_allclose(found, R * np.outer(expected, expected))
