"""When the data tell two explanations apart: by their own noise, never by a tuned figure."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array

FALSE_ALARM = 1e-4
"""Probability, for each question that is put to the data, that noise alone answers it."""


def quantile(n_free: int, questions: int = 1, false_alarm: float = FALSE_ALARM) -> float:
    """Of Student's distribution: what noise exceeds, to either side, in so few of the cases.

    Parameters
    ----------
    n_free : int
        Degrees of freedom; infinite where there are none, so that nothing is significant.
    questions : int
        Alternatives of which the best is judged (Bonferroni).
    """
    from scipy.stats import t

    if n_free < 1:
        return np.inf
    return float(t.isf(0.5 * false_alarm / questions, n_free))


def limit(noise: float, n_free: int, stated: float) -> float:
    """What noise that is estimated, and a spread that is stated, explain together.

    Parameters
    ----------
    noise : float
        Standard deviation, with ``n_free`` degrees of freedom.
    stated : float
        Standard deviation that is taken for known.
    """
    return float(np.hypot(quantile(n_free) * noise, quantile(10**6) * stated))


def losses(errors: Array) -> Array:
    """Cauchy's loss of errors of several explanations, on the scale of what is left of the best.

    Parameters
    ----------
    errors : ndarray, shape (h, n)
        Of h explanations on n blocks of data.
    """
    scale = max(float(np.min(np.median(np.abs(errors), axis=1))), 1e-9)
    return np.asarray(np.log1p((errors / scale) ** 2))


def prefers(
    stated: Array, other: Array, questions: int = 1, false_alarm: float = FALSE_ALARM
) -> bool:
    """Whether another explanation fits better than the stated one.

    A paired test of two explanations of which neither contains the other (Vuong 1989): the mean
    difference of their losses against its scatter from block to block.

    Parameters
    ----------
    stated, other : ndarray, shape (n,)
        Loss of each block of data under either.
    """
    gain = stated - other
    if len(gain) < 2:
        return False
    sigma = float(np.std(gain, ddof=1)) / np.sqrt(len(gain))
    return bool(np.mean(gain) > quantile(len(gain) - 1, questions, false_alarm) * sigma)


def best(loss: Array) -> int:
    """Which explanation the data call for, zero being the stated one.

    Parameters
    ----------
    loss : ndarray, shape (h, n)
        Of h explanations on n blocks of data.

    Returns
    -------
    int
        The best one if it is significantly better than the stated one; else zero.
    """
    winner = int(np.argmin(np.mean(loss, axis=1)))
    return winner if prefers(loss[0], loss[winner], max(len(loss) - 1, 1)) else 0


def tied(loss: Array, winner: int) -> list[int]:
    """The explanations that the data cannot tell from the winner, itself among them."""
    others = len(loss) - 1
    return [k for k in range(len(loss)) if not prefers(loss[k], loss[winner], max(others, 1))]


def decided(loss: Array) -> int | None:
    """The explanation that is significantly better than each other one; None without one."""
    winner = int(np.argmin(np.mean(loss, axis=1)))
    return winner if tied(loss, winner) == [winner] else None
