"""What every registration method returns."""

from __future__ import annotations

from dataclasses import dataclass

from gtsam_nav.frames import Array


@dataclass(frozen=True)
class PlanarMatch:
    """Outcome of the registration of a new scan to a reference scan.

    Attributes
    ----------
    q : ndarray, shape (3,)
        Pose of the new scan in the reference scan: x, y (m) and yaw (rad, clockwise from above).
    cov : ndarray, shape (3, 3)
        Its covariance.
    overlap : float
        Share of the new scan's points that found a partner.
    iterations : int
    failure : str
        Why the match must not be used; empty where it may. A failed match still holds the last
        estimate, for the record.
    """

    q: Array
    cov: Array
    overlap: float
    iterations: int
    failure: str = ""

    @property
    def ok(self) -> bool:
        """Whether the registration succeeded."""
        return not self.failure
