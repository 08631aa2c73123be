"""Which measurements count: a chi-square gate on the innovation that does not lock itself out.

A filter that is lost rejects everything that would bring it back. What tells its rejections from
outliers is that they agree with each other: the innovations of good measurements against a filter
that has gone astray move smoothly, those of outliers jump.
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
LONGEST_RUN = 200


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
        _, fit = self._fit()
        self._accepted_s = self._t[-1]
        self._forget()
        return fit[0], fit[1]

    def _forget(self) -> None:
        for entries in (self._t, self._residual, self._sigma):
            entries.clear()

    def _run_agrees(self) -> bool:
        if len(self._t) < RUN_MEASUREMENTS or self._t[-1] - self._accepted_s < RUN_S:
            return False
        for entries in (self._t, self._residual, self._sigma):
            del entries[:-LONGEST_RUN]
        scatter, _ = self._fit()
        size = float(np.sqrt(np.mean(np.square(self._residual))))
        noise = float(np.sqrt(np.mean(np.square(self._sigma))))
        return scatter <= max(AGREEMENT_SIGMAS * noise, AGREEMENT_SHARE * size)

    def _fit(self) -> tuple[float, Array]:
        """Scatter of the run about a parabola in time, and the parabola's coefficients now."""
        t = np.array(self._t) - self._t[-1]
        powers = np.vander(t, 3, increasing=True)
        fit, *_ = np.linalg.lstsq(powers, np.array(self._residual), rcond=None)
        scatter = float(np.sqrt(np.mean((np.array(self._residual) - powers @ fit) ** 2)))
        return scatter, np.asarray(fit)
