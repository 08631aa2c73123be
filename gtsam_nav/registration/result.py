"""What every registration method returns."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gtsam_nav.frames import Array


@dataclass(frozen=True)
class PlanarMatch:
    """Outcome of the registration of a new scan to a reference scan.

    Attributes
    ----------
    q : ndarray, shape (3,)
        Pose of the new scan in the reference scan: x, y (m) and yaw (rad, clockwise from above).
    cov : ndarray, shape (3, 3)
        Its covariance; huge in a direction that the points do not tell.
    overlap : float
        Share of the new scan's points that found a partner.
    iterations : int
    failure : str
        Why the match must not be used; empty where it may. A failed match still holds the last
        estimate, for the record.
    unobserved : ndarray, shape (k, 3)
        The directions of x, y and yaw that the points do not tell, in which the match still has
        what it began with: one along a corridor, none in most places.
    """

    q: Array
    cov: Array
    overlap: float
    iterations: int
    failure: str = ""
    unobserved: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def ok(self) -> bool:
        """Whether the registration succeeded."""
        return not self.failure


@dataclass(frozen=True)
class RelativePose:
    """Pose of one body or cloud in another, with its uncertainty.

    Attributes
    ----------
    R_ab : ndarray, shape (3, 3)
        Turns vectors of b into a.
    p_a : ndarray, shape (3,)
        Origin of b in a, m.
    cov : ndarray, shape (6, 6)
        Of a small turn (rad) and shift (m) of b, in this order, both along the axes of b: the pose
        is ``R_ab Exp(turn)``, ``p_a + R_ab shift``.
    """

    R_ab: Array
    p_a: Array
    cov: Array

    def error_of(self, R_ab: Array, p_a: Array) -> Array:
        """Turn and shift, shape (6,), that make this pose the given one."""
        from scipy.spatial.transform import Rotation

        turn = Rotation.from_matrix(self.R_ab.T @ R_ab).as_rotvec()
        return np.concatenate([turn, self.R_ab.T @ (p_a - self.p_a)])


@dataclass(frozen=True)
class CloudMatch:
    """Outcome of the registration of a new point set to a reference.

    Attributes
    ----------
    pose : RelativePose
        Of the new points in the reference.
    fitness : float
        Share of the new points that found a partner.
    failure : str
        Why the match must not be used; empty where it may. A failed match still holds the last
        estimate, for the record.
    """

    pose: RelativePose
    fitness: float
    failure: str = ""

    @property
    def ok(self) -> bool:
        """Whether the registration succeeded."""
        return not self.failure
