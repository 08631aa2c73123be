"""Whether a sensor is as good as it states, judged by its innovations over the last seconds.

Wheels slip, an instrument is mounted askew, a driver states a figure that nobody measured: then the
innovations of most readings, not of some, are larger than they may be. A gate alone would throw the
sensor away and leave the filter to the accelerometers. The median of the normalised innovations
squared tells the two apart: outliers do not move it while they are fewer than the rest. What it is
above that of the chi-square distribution is put down to the sensor, whose covariance grows by it
(innovation-based adaptive estimation: Mehra, *Approaches to adaptive filtering*, IEEE Transactions
on Automatic Control 17(5), 1972; by the median, so that it is robust).
"""

from __future__ import annotations

from bisect import insort
from collections import deque

from gtsam_nav.sensors.prediction import chi2_limit

WINDOW_S, LEAST_READINGS = 5.0, 12
"""The median is that of so many seconds, and of so many readings at least."""
BELIEVED_FACTOR = 4.0
"""A stated variance is taken as it is while the innovations bear it out within this factor."""

SAID_SHARE = 0.1
"""Fewer readings that are worse than stated are not worth a warning."""


class NoiseWatch:
    """Watches the innovations of one sensor, used or not.

    Attributes
    ----------
    readings, doubted : int
        How many there were, and how many had their variance enlarged.
    largest_factor : float
        By which it was, at most.
    """

    def __init__(self) -> None:
        self.readings, self.doubted, self.largest_factor = 0, 0, 1.0
        self._recent: deque[tuple[float, float]] = deque()
        self._sorted: list[float] = []

    def variance_factor(self, t: float, nis: float, size: int) -> float:
        """By what the stated variance is too small by now; 1 where it is borne out.

        Parameters
        ----------
        t : float
            Time of the newest reading, s.
        nis : float
            Its normalised innovation squared, by the stated noise.
        size : int
            Its components.
        """
        self.readings += 1
        self._recent.append((t, nis))
        insort(self._sorted, nis)
        while len(self._recent) > LEAST_READINGS and self._recent[0][0] < t - WINDOW_S:
            self._sorted.remove(self._recent.popleft()[1])
        if len(self._recent) < LEAST_READINGS:
            return 1.0
        factor = self._sorted[len(self._sorted) // 2] / chi2_limit(0.5, size)
        if factor <= BELIEVED_FACTOR:
            return 1.0
        self.doubted += 1
        self.largest_factor = max(self.largest_factor, factor)
        return factor

    def warning(self, name: str) -> str | None:
        """What to say of a sensor of this name that was worse than it states for long."""
        if self.doubted <= SAID_SHARE * self.readings:
            return None
        return (
            f"{name}: its readings differ from what the filter expects by more than its noise"
            f" states, at worst {self.largest_factor**0.5:.1f} times:"
            f" {self.doubted} of {self.readings} counted as so much noisier"
        )
