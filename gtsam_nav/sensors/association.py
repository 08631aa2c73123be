"""Which landmark each sighting of one moment is of, where the sensor does not say.

Individual compatibility takes for each sighting the nearest landmark that passes the gate. Joint
compatibility searches the largest set of pairings that agree with each other too, through the
errors that they share: where the vehicle is wrong, all sightings are wrong alike. Neira and Tardos,
*Data association in stochastic mapping using the joint compatibility test*, IEEE Trans. Robotics
and Automation 17(6), 2001.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.series import BoolArray, IntArray

NONE = -1
"""A sighting that is of no known landmark."""

MOST_NODES = 3000
"""The search for a joint pairing ends here with the best so far."""


class Compared(Protocol):
    """What may be of what: s things against k landmarks, m values each.

    Attributes
    ----------
    m : int
    nis : ndarray, shape (s, k)
        Normalised innovation squared of each pairing, infinite where it cannot be.
    """

    @property
    def m(self) -> int: ...

    @property
    def nis(self) -> Array: ...

    def joint_nis(self, sightings: list[int], landmarks: list[int]) -> float:
        """Normalised innovation squared of several pairings together."""
        ...


@dataclass(frozen=True)
class Comparison:
    """The s sightings of one moment against k landmarks.

    Attributes
    ----------
    residual : ndarray, shape (s, k, m)
        Predicted less measured.
    spread : ndarray, shape (k, m, k, m)
        Joint covariance of the predictions.
    noise : ndarray, shape (s, m, m)
        Covariance of each sighting.
    """

    residual: Array
    spread: Array
    noise: Array

    @property
    def m(self) -> int:
        """Values of a sighting."""
        return int(self.residual.shape[2])

    @cached_property
    def nis(self) -> Array:
        """Normalised innovation squared of each pairing, shape (s, k); infinite where its
        covariance is singular."""
        k = np.arange(self.residual.shape[1])
        S = self.spread[k, :, k, :] + self.noise[:, None]
        return _squared(S, self.residual)

    def of(self, sightings: IntArray, landmarks: BoolArray) -> Comparison:
        """Some of the sightings against some of the landmarks."""
        return Comparison(
            self.residual[sightings][:, landmarks],
            self.spread[landmarks][:, :, landmarks],
            self.noise[sightings],
        )

    def joint_nis(self, sightings: list[int], landmarks: list[int]) -> float:
        """Normalised innovation squared of several pairings together."""
        n, m = len(sightings), self.residual.shape[2]
        S = self.spread[landmarks][:, :, landmarks].copy()
        each = np.arange(n)
        S[each, :, each] += self.noise[sightings]
        stacked = self.residual[sightings, landmarks].ravel()
        return float(_squared(S.reshape(n * m, n * m), stacked))


def _squared(S: Array, residual: Array) -> Array:
    """``r' S^-1 r``, stacked; infinite where S is not positive definite."""
    try:
        L = np.linalg.cholesky(S)
    except np.linalg.LinAlgError:
        if S.ndim == 2:
            return np.array(np.inf)
        return np.stack([_squared(*pair) for pair in zip(S, residual, strict=True)])
    whitened = np.linalg.solve(L, residual[..., None])[..., 0]
    return np.asarray(np.sum(whitened**2, axis=-1))


def nearest(seen: Compared, probability: float) -> IntArray:
    """Each sighting's nearest landmark, shape (s,): a landmark goes to one sighting, the nearest.

    Parameters
    ----------
    seen : Compared
    probability : float
        Of the chi-square gate.
    """
    n, k = seen.nis.shape
    taken = np.full(n, NONE)
    pairings = seen.nis.ravel()
    for pairing in np.argsort(pairings, kind="stable"):
        if not pairings[pairing] <= chi2_limit(probability, seen.m):
            break
        s, landmark = divmod(int(pairing), k)
        if taken[s] == NONE and landmark not in taken:
            taken[s] = landmark
    return taken


def joint(seen: Compared, probability: float) -> IntArray:
    """The largest jointly compatible pairing, shape (s,); of equals, the one that fits best.

    Branch and bound, a sighting a level, its nearest landmark first; the search is bounded
    (`MOST_NODES`), and begins with the pairing that a quick descent finds.

    Parameters
    ----------
    seen : Compared
    probability : float
        Of the chi-square gates, individual and joint.
    """
    return _Search(seen, probability).run()


class _Search:
    def __init__(self, seen: Compared, probability: float) -> None:
        n, self.m = len(seen.nis), seen.m
        self.seen, self.probability = seen, probability
        gate = chi2_limit(probability, self.m)
        self.choices = [
            [int(k) for k in np.argsort(row, kind="stable") if row[k] <= gate] for row in seen.nis
        ]
        # the sightings with the fewest choices first: mistakes show early
        open_ones = [s for s in range(n) if self.choices[s]]
        self.order = sorted(open_ones, key=lambda s: (len(self.choices[s]), s))
        self.best: list[tuple[int, int]] = []
        self.best_nis = np.inf
        self.nodes = 0

    def run(self) -> IntArray:
        self._descend(0, [], 0.0)
        found = np.full(len(self.choices), NONE)
        for s, landmark in self.best:
            found[s] = landmark
        return found

    def _descend(self, level: int, pairs: list[tuple[int, int]], nis: float) -> None:
        self.nodes += 1
        if (len(pairs), -nis) > (len(self.best), -self.best_nis):
            self.best, self.best_nis = pairs, nis
        if level == len(self.order) or self.nodes > MOST_NODES:
            return
        if not self._can_win(len(pairs) + len(self.order) - level, nis):
            return
        s = self.order[level]
        taken = {landmark for _, landmark in pairs}
        for landmark in self.choices[s]:
            if landmark not in taken:
                longer = [*pairs, (s, landmark)]
                joint_nis = self.seen.joint_nis(*map(list, zip(*longer, strict=True)))
                if joint_nis <= chi2_limit(self.probability, self.m * len(longer)):
                    self._descend(level + 1, longer, joint_nis)
        # the sighting may be of nothing known
        self._descend(level + 1, pairs, nis)

    def _can_win(self, most_pairs: int, nis: float) -> bool:
        """Whether so many pairings could be better than the best: their NIS can only grow."""
        return (most_pairs, -nis) > (len(self.best), -self.best_nis)
