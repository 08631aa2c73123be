"""Whether the fixes of a receiver seem late or early, told by the filter's own innovations.

A clock that is off by b leaves a trace ``V b`` in the filter's errors and ``(H V + c) b`` in its
residuals, c being how fast what is measured changes. V goes through the filter as the errors do, so
that least squares over all residuals tell b beside a filter that knows nothing of it (Friedland,
*Treatment of bias in recursive filtering*, IEEE Transactions on Automatic Control 14(4), 1969).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gtsam_nav.ekf.error_state import Update
from gtsam_nav.frames import Array
from gtsam_nav.sensors.prediction import chi2_limit

SUSPECT_SIGMAS, SUSPECT_S = 5.0, 0.2
"""A timing error that is smaller is not spoken of: the filter is not quite linear."""
UNKNOWN_S = 10.0
"""Spread of a timing error of which nothing is known."""


class ClockWatch:
    """Watches the clocks of some receivers against that of the inertial unit.

    Parameters
    ----------
    receivers : sequence of str
    size : int
        Errors of the filter.
    """

    def __init__(self, receivers: Sequence[str], size: int) -> None:
        self._receivers = list(receivers)
        m = len(self._receivers)
        self._trace = np.zeros((size, m))
        self._information, self._told = np.eye(m) / UNKNOWN_S**2, np.zeros(m)
        self._misfits: list[float] = []

    def predicted(self, Phi: Array) -> None:
        """Follow the filter's errors to a later time."""
        self._trace = Phi @ self._trace

    def corrected(self, update: Update, gain: Array, receiver: str, rate: Array) -> None:
        """Take in a measurement as the filter did.

        Parameters
        ----------
        gain : ndarray, shape (size, m)
        receiver : str
            Whose measurement it is; of others the clocks are the inertial unit's.
        rate : ndarray, shape (m,)
            Change a second of what it measures.
        """
        slope = update.H @ self._trace
        if receiver in self._receivers:
            slope[:, self._receivers.index(receiver)] += rate
            self._misfits.append(update.nis / chi2_limit(0.5, len(update.R)))
        assert update.S_inverse is not None
        self._information += slope.T @ update.S_inverse @ slope
        self._told -= slope.T @ update.S_inverse @ update.residual
        self._trace = self._trace - gain @ slope

    def doubts(self) -> Iterator[str]:
        """A warning for each receiver whose fixes seem to be off in time."""
        misfit = np.sqrt(max(1.0, float(np.median(self._misfits or [1.0]))))
        cov = np.linalg.inv(self._information)
        found = zip(self._receivers, cov @ self._told, misfit * np.sqrt(np.diag(cov)), strict=True)
        for name, offset_s, sigma_s in found:
            if abs(offset_s) > max(SUSPECT_S, SUSPECT_SIGMAS * sigma_s):
                yield (
                    f"'{name}' seems to be {abs(offset_s):.2f} s"
                    f" {'late' if offset_s < 0 else 'early'} (sigma {sigma_s:.2f} s) against the"
                    " IMU: ins-ekf takes its stamps as they are; the method graph estimates the"
                    " offset where its card says time_offset: {estimate: true}; an arm of the"
                    " antenna that is wrong along the bow looks the same at a steady speed"
                )
