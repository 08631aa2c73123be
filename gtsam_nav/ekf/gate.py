"""Which measurements count: a chi-square gate on the innovation that does not lock itself out.

A filter that is lost rejects everything that would bring it back. What tells its rejections from
outliers is that they agree with each other: the innovations of good measurements against a filter
that has gone astray move smoothly, those of outliers jump. Outliers that agree with each other for
as long as `RUN_S` cannot be told from a filter that has gone astray, and are followed.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from gtsam_nav.ekf.error_state import Update
from gtsam_nav.frames import Array
from gtsam_nav.sensors.prediction import chi2_limit

Verdict = Literal["accept", "reject", "reopen"]

RUN_MEASUREMENTS, RUN_S = 12, 10.0
"""A run of rejections is believed once it has so many, and none was accepted for so long."""
AGREEMENT_SIGMAS, AGREEMENT_SHARE = 3.0, 0.1
"""A run agrees with itself where its scatter is within these of its noise, or of its size."""
LEAST_AGREEING = 0.75
"""Share of a run that must agree: outliers go on while a filter is lost."""


class Gate:
    """Judges the innovations of one sensor, one after another.

    Parameters
    ----------
    probability : float or None
        An innovation is an outlier where a chi-square variable would stay below its normalised
        square with this probability. None lets everything pass.
    """

    def __init__(self, probability: float | None) -> None:
        self.probability = probability
        self._accepted_s = np.inf
        self._t: list[float] = []
        self._residual: list[Array] = []
        self._sigma: list[float] = []

    def judge(self, t: float, update: Update) -> Verdict:
        """What becomes of a measurement; "reopen" asks the filter to doubt itself and take it."""
        if self.probability is None or update.nis <= chi2_limit(self.probability, len(update.R)):
            self._forget()
            self._accepted_s = t
            return "accept"
        self._accepted_s = min(self._accepted_s, t)
        self._t.append(t)
        self._residual.append(update.residual)
        self._sigma.append(float(np.sqrt(np.trace(update.R) / len(update.R))))
        if not self._run_agrees():
            return "reject"
        return "reopen"

    def offset(self) -> tuple[Array, Array]:
        """How far a run of rejections lies off by now, and how fast that grows a second."""
        _, fit = self._agreement()
        self._accepted_s = self._t[-1]
        self._forget()
        return fit[0], fit[1]

    def _forget(self) -> None:
        for entries in (self._t, self._residual, self._sigma):
            entries.clear()

    def _run_agrees(self) -> bool:
        if len(self._t) < RUN_MEASUREMENTS or self._t[-1] - self._accepted_s < RUN_S:
            return False
        self._keep_the_newest()
        agrees, _ = self._agreement()
        return agrees

    def _keep_the_newest(self) -> None:
        """Forget what is older than a run that is believed: outliers of long ago say nothing."""
        recent = sum(t > self._t[-1] - RUN_S for t in self._t)
        for entries in (self._t, self._residual, self._sigma):
            del entries[: -max(recent, RUN_MEASUREMENTS)]

    def _agreement(self) -> tuple[bool, Array]:
        """Whether all but a few outliers of a run follow a parabola in time; its coefficients now.

        The worst are left out one by one.
        """
        t, residual = np.array(self._t) - self._t[-1], np.array(self._residual)
        powers = np.vander(t, 3, increasing=True)
        kept = np.ones(len(t), dtype=bool)
        while True:
            fit, *_ = np.linalg.lstsq(powers[kept], residual[kept], rcond=None)
            off = np.linalg.norm(residual - powers @ fit, axis=1) / np.sqrt(residual.shape[1])
            size = float(np.sqrt(np.mean(residual[kept] ** 2)))
            noise = float(np.sqrt(np.mean(np.square(self._sigma))))
            allowed = max(AGREEMENT_SIGMAS * noise, AGREEMENT_SHARE * size)
            if np.sqrt(np.mean(off[kept] ** 2)) <= allowed:
                return True, np.asarray(fit)
            kept[np.argmax(np.where(kept, off, -1.0))] = False
            if np.sum(kept) < LEAST_AGREEING * len(t):
                return False, np.asarray(fit)
