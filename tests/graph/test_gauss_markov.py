"""Gauss-Markov sequences: the precisions invert to the known covariance."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gtsam_nav.frames import Array
from gtsam_nav.graph.gauss_markov import GaussMarkov, gauss_markov


def information(sequence: GaussMarkov) -> Array:
    matrix = np.diag(sequence.tie)
    for k, link in enumerate(sequence.link):
        matrix[k : k + 2, k : k + 2] += link * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return matrix


@given(
    steps=st.lists(st.floats(0.1, 200.0), min_size=1, max_size=12),
    sigma=st.floats(0.01, 10.0),
    time_s=st.floats(5.0, 500.0),
)
def test_information_inverts_to_the_covariance(
    steps: list[float], sigma: float, time_s: float
) -> None:
    t = np.concatenate([[3.0], 3.0 + np.cumsum(steps)])
    sequence = gauss_markov(t, sigma, time_s)
    assert np.all(sequence.tie > 0)
    assert np.all(sequence.link > 0)
    wanted = sigma**2 * np.exp(-np.abs(t[:, None] - t) / time_s)
    np.testing.assert_allclose(np.linalg.inv(information(sequence)), wanted, atol=1e-6 * sigma**2)


def test_single_state_is_tied_to_the_mean_alone() -> None:
    sequence = gauss_markov(np.array([5.0]), 2.0, 60.0)
    np.testing.assert_allclose(sequence.tie, [0.25])
    assert len(sequence.link) == 0
