"""Places of a planar motion on a map: north, east (m) and the turn (rad) of its axes."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.series import BoolArray

OTHER_PLACE_M, OTHER_HEADING_RAD = 1.0, np.radians(30.0)
"""Places that differ by more are different answers."""
MOST_SIGMA_RAD = np.radians(15.0)
"""A place whose turn is less certain is none yet."""


def rotated(vectors: Array, angle: Array) -> Array:
    """Vectors (k, 2), each turned by its angle (k,)."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = vectors[:, 0], vectors[:, 1]
    return np.column_stack([c * x - s * y, s * x + c * y])


def moved(place: Array, p: Array) -> Array:
    """Where points (k, 2) of the motion are, at a place (3,) of its axes."""
    return place[:2] + rotated(p, np.full(len(p), place[2]))


def are_elsewhere(places: Array, other: Array) -> BoolArray:
    """Which of several places (s, 3) are a different answer than another one (3,)."""
    far = np.hypot(places[:, 0] - other[0], places[:, 1] - other[1]) > OTHER_PLACE_M
    return np.asarray(far | (np.abs(wrap_angle(places[:, 2] - other[2])) > OTHER_HEADING_RAD))
