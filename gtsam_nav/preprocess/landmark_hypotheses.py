"""Which landmark each sighting is of, where the sensor does not say: decided late.

A sighting may be of any landmark nearby, or of a new one, and a wrong choice shows only later. So
the best few hypotheses on all sightings so far are followed side by side, each with a filter of
its own (`FilterBank`), and the cheapest in the end is believed: Reid, *An algorithm for tracking
multiple targets*, IEEE Trans. Automatic Control 24(6), 1979. A sighting costs its squared
normalised innovation, the log of the room that its prediction left it, and twice the log of how
many landmarks it could be of; a new landmark costs a constant. Of hypotheses that put the vehicle
at the same place, with as many landmarks, only the cheapest is kept: the others would crowd out
what differs.

What was lost in a long silence forwards is often found backwards, where the silence comes when
other landmarks are known: the mission is gone through in both directions, and the cheaper
explanation wins. By inertial readings it is gone through forwards alone: it is at its start that
their errors are known.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.preprocess.landmark_bank import COURSE, POSITION, FilterBank
from gtsam_nav.preprocess.landmark_drift import Drift, of_odometry
from gtsam_nav.preprocess.planar_motion import Increments
from gtsam_nav.preprocess.planar_smoothing import SightedPoints
from gtsam_nav.series import IntArray

log = logging.getLogger(__name__)

NEW_LANDMARK = 20.0
"""What a new landmark costs: twice the log of how many places the sensor could tell apart where one
may turn up, some 1e4."""
TOO_DEAR = 30.0
"""A hypothesis that costs so much more than the best one is given up: odds of 1 to e^15."""
ALIKE = 0.5
"""Hypotheses that put a usual sighting nearer to each other, in its sigmas, are alike."""


@dataclass(frozen=True)
class Sighted:
    """A drive and what was seen on it.

    Attributes
    ----------
    increments : Increments
        Between m successive poses.
    seen : SightedPoints
        In the order of their poses.
    independence : ndarray, shape (k,)
        Share of each sighting's error, as variance, that others do not have.
    drift : Drift
        Errors of the increments that last.
    """

    increments: Increments
    seen: SightedPoints
    independence: Array
    drift: Drift

    def reversed(self) -> Sighted:
        """The same, driven backwards, of odometry: its errors are constant."""
        moved, turn = self.increments.displacement_b, self.increments.turn
        c, s = np.cos(turn), np.sin(turn)
        back = -np.column_stack(
            [c * moved[:, 0] + s * moved[:, 1], c * moved[:, 1] - s * moved[:, 0]]
        )
        variance, bent_m = self.increments.variance[::-1], -self.increments.bent_m[::-1]
        increments = Increments(back[::-1], -turn[::-1], variance, bent_m)
        seen = SightedPoints(
            len(turn) - self.seen.pose[::-1], self.seen.p_b[::-1], self.seen.cov_b[::-1]
        )
        drift = of_odometry(increments, *self.drift.sigma.tolist())
        return Sighted(increments, seen, self.independence[::-1], drift)


@dataclass(frozen=True)
class Explanation:
    """Landmark of each sighting, (k,), from zero without gaps, and what it costs."""

    landmark: IntArray
    cost: float


def explained(drive: Sighted, most: int, gate: float) -> Explanation:
    """The cheapest explanation of all sightings.

    Parameters
    ----------
    drive : Sighted
    most : int
        Hypotheses that are followed side by side.
    gate : float
        Largest squared normalised innovation of a sighting.
    """
    forwards = _Hypotheses(drive, most, gate).run()
    if not drive.drift.is_constant:
        return forwards
    backwards = _Hypotheses(drive.reversed(), most, gate).run()
    log.info("landmarks told apart: cost %.0f, backwards %.0f", forwards.cost, backwards.cost)
    if forwards.cost <= backwards.cost:
        return forwards
    return Explanation(backwards.landmark[::-1], backwards.cost)


class _Hypotheses:
    """The best hypotheses on the sightings so far, the cheapest first."""

    def __init__(self, drive: Sighted, most: int, gate: float) -> None:
        self.drive, self.most, self.gate = drive, most, gate
        self.bank = FilterBank.at_origin(drive.drift.sigma)
        self.cost = np.zeros(1)
        # of each sighting: which hypotheses led to the next ones, and what they took it for
        self.parents: list[IntArray] = []
        self.choices: list[IntArray] = []
        sigma = ALIKE * float(np.median(np.sqrt(np.linalg.eigvalsh(drive.seen.cov_b)[:, -1])))
        reach = float(np.median(np.linalg.norm(drive.seen.p_b, axis=1)))
        self.same = np.array([sigma, sigma, sigma / reach])

    def run(self) -> Explanation:
        steps, seen = self.drive.increments, self.drive.seen
        first = np.searchsorted(seen.pose, np.arange(len(steps.turn) + 2))
        for pose in range(len(steps.turn) + 1):
            if pose:
                self.bank.move(steps, self.drive.drift, pose - 1)
            for k in range(first[pose], first[pose + 1]):
                self._sight(k, int(first[pose]))
        return Explanation(self._traced(0), float(self.cost[0]))

    def _sight(self, k: int, first: int) -> None:
        """Extend the hypotheses by sighting k, of a moment that began with the first."""
        parent, landmark, cost = self._extensions(k, first)
        bank = self.bank.chosen(parent)
        bank.take(landmark, self.drive.seen.p_b[k], self.drive.seen.cov_b[k])
        kept = self._different(bank)
        self.bank, self.cost = bank.chosen(kept), cost[kept]
        self.parents.append(parent[kept])
        self.choices.append(landmark[kept])

    def _extensions(self, k: int, first: int) -> tuple[IntArray, IntArray, Array]:
        """The cheapest pairs of a hypothesis and a landmark, and their costs."""
        seen, bank = self.drive.seen, self.bank
        nis, surprise = bank.compare(seen.p_b[k], seen.cov_b[k])
        dear = np.where(nis <= self.gate, nis + surprise, np.inf)
        # a landmark is seen once at a moment
        for earlier, taken in self._taken(first):
            dear[earlier, taken] = np.inf
        # one of several: else two landmarks in one place would share its sightings to their gain
        fitting = np.maximum(np.sum(np.isfinite(dear), axis=1, keepdims=True), 1)
        dear += 2.0 * self.drive.independence[k] * np.log(fitting)
        dear = np.column_stack([dear, np.full(len(bank), NEW_LANDMARK)]) + self.cost[:, None]
        order = np.argsort(dear, axis=None, kind="stable")[: 3 * self.most]
        cost = dear.ravel()[order]
        order = order[cost <= cost[0] + TOO_DEAR]
        parent, landmark = np.divmod(order, dear.shape[1])
        landmark = np.where(landmark == bank.room, bank.count[parent], landmark)
        return parent, landmark, cost[: len(order)]

    def _taken(self, first: int) -> list[tuple[IntArray, IntArray]]:
        """Hypotheses, and the landmarks that they took the sightings since the first for."""
        now = np.arange(len(self.bank))
        which, taken = now, []
        for k in range(len(self.parents) - 1, first - 1, -1):
            taken.append((now, self.choices[k][which]))
            which = self.parents[k][which]
        return taken

    def _different(self, bank: FilterBank) -> IntArray:
        """The best hypotheses of which no two are alike."""
        at = np.column_stack([bank.x[:, POSITION], bank.x[:, COURSE]]) / self.same
        kept: list[int] = []
        for i in range(len(at)):
            near = np.all(np.abs(at[kept] - at[i]) < 1.0, axis=1)
            if not np.any(near & (bank.count[kept] == bank.count[i])):
                kept.append(i)
            if len(kept) == self.most:
                break
        return np.array(kept)

    def _traced(self, hypothesis: int) -> IntArray:
        """What a hypothesis took each sighting for."""
        landmark = np.empty(len(self.choices), dtype=np.int64)
        for k in range(len(landmark) - 1, -1, -1):
            landmark[k] = self.choices[k][hypothesis]
            hypothesis = int(self.parents[k][hypothesis])
        return landmark
