"""First-order Gauss-Markov sequences as ties and links: their exact information matrix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array


@dataclass(frozen=True)
class GaussMarkov:
    """Precisions of a stationary sequence about its mean.

    Attributes
    ----------
    tie : ndarray, shape (n,)
        Of each state to the mean.
    link : ndarray, shape (n - 1,)
        Of the difference of neighbours.
    """

    tie: Array
    link: Array


def gauss_markov(t: Array, sigma: float, time_s: float) -> GaussMarkov:
    """Sequence of spread sigma that forgets itself over a time.

    The information matrix of such a sequence is tridiagonal; written as squared differences of
    neighbours (links) it leaves a positive rest on each state (ties).

    Parameters
    ----------
    t : ndarray, shape (n,)
        Strictly increasing.
    sigma : float
        Stationary standard deviation.
    time_s : float
        Correlation time.
    """
    phi = np.exp(-np.diff(t) / time_s)
    innovation = sigma**2 * (1 - phi**2)
    rest = (phi**2 - phi) / innovation  # own precision less the link's
    tie = np.full(len(t), 1.0 / sigma**2)
    tie[:-1] += rest
    tie[1:] += rest
    return GaussMarkov(tie, phi / innovation)
