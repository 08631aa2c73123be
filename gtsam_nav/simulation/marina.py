"""An invented marina: a tank, a corridor of 150 m and an outer basin, 240 m by 120 m in all."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gtsam_nav.frames import Array, Origin
from gtsam_nav.simulation.world import Course, Wall, World

ORIGIN = Origin(latitude_deg=42.2, longitude_deg=3.1)
CORRIDOR_AZIMUTH_DEG = 25.0
CENTRE_OF_TANK = (-22.0, 2.0)
"""The local NED origin in the plan's coordinates."""

# Plan coordinates, m: x along the corridor from the tank to the outer basin, y to its right.
# Each wall: its reinforcement, then its corners.
_WALLS: tuple[tuple[float, tuple[tuple[float, float], ...]], ...] = (
    # tank: right side with a landing stage and a finger, left side with a ramp
    (0.6, ((0, 10), (0, 30), (-9, 30), (-9, 22), (-10, 22), (-10, 30), (-20, 30))),
    (-0.5, ((-20, 30), (-20, 26), (-30, 26), (-30, 30), (-45, 30), (-45, 8))),
    (0.7, ((-45, 8), (-42, 5), (-45, 2), (-45, -25), (-28, -25))),
    (-0.6, ((-28, -25), (-24, -21), (-14, -21), (-14, -25), (0, -25), (0, -10))),
    # right side of the corridor: slips, and a gap at x = 100 to 107
    (0.7, ((0, 10), (34, 10), (34, 19), (48, 19))),
    (-0.9, ((48, 19), (48, 10), (70, 10), (70, 24), (76, 24), (76, 10), (88, 10))),
    (1.0, ((88, 10), (100, 10), (100, 17))),
    (-0.7, ((107, 17), (107, 10), (128, 10), (128, 14), (140, 14), (140, 10), (150, 10))),
    # left side of the corridor: slips, and a gap at x = 88 to 93
    (-0.8, ((0, -10), (18, -10), (18, -13), (26, -13), (26, -10), (42, -10))),
    (0.9, ((42, -10), (56, -10), (56, -20), (64, -20), (64, -10), (88, -10), (88, -15))),
    (-0.9, ((93, -15), (93, -10), (115, -10), (115, -16), (121, -16))),
    (0.7, ((121, -16), (121, -10), (150, -10), (150, -22))),
    # outer basin: pontoons, and the way to the sea at y = 20 to 32
    (
        -0.6,
        ((150, 10), (150, 38), (159, 38), (159, 39), (150, 39), (150, 60), (195, 60), (195, 32)),
    ),
    (0.8, ((195, 20), (195, 6), (187, 6), (187, 5), (195, 5), (195, -12))),
    (-0.8, ((195, -12), (187, -12), (187, -13), (195, -13), (195, -60))),
    (0.5, ((150, -22), (150, -40), (158, -40), (158, -41), (150, -41), (150, -60), (195, -60))),
)
_PILES = (
    *((-40, -20), (-6, -18), (-38, 22), (12, 8.6), (59, 8.8), (84, -8.7), (112, 8.7), (133, -8.8)),
    *((160, 47), (176, -46), (186, 44), (171, 52), (184, -30)),
)
_BUOYS = ((-27, -4), (30, 7.5), (90, -7.0), (168, 2), (172, -38))
_BUOY_DEPTH_M = 1.5
# out along the right side, one lap of the basin, back along the left side, one lap of the tank
_CIRCUIT = (
    *((-18, 3), (0, 3.2), (20, 2.5), (45, 3.4), (70, 2.6), (95, 3.5), (120, 2.8), (142, 3)),
    *((157, 10), (168, 21), (178, 18), (181, 2), (177, -15), (166, -20), (155, -10), (142, -3.2)),
    *((120, -2.6), (95, -3.4), (70, -2.4), (45, -3.5), (20, -2.8), (0, -3.4)),
    *((-12, -8), (-24, -14), (-35, -10), (-38, 0), (-31, 6)),
)


def marina() -> World:
    """Build the marina, turned so that no wall runs along a coordinate axis."""
    buoys = _local(_BUOYS)
    return World(
        name="marina",
        origin=ORIGIN,
        course=Course(_local(_CIRCUIT), closed=True),
        landmark_id=np.arange(1, len(buoys) + 1),
        landmarks_n=np.column_stack([buoys, np.full(len(buoys), _BUOY_DEPTH_M)]),
        walls=tuple(Wall(_local(corners), steel) for steel, corners in _WALLS),
        piles_n=_local(_PILES),
        pile_radius_m=0.3,
        flat=True,
    )


def _local(plan: ArrayLike) -> Array:
    """North and east of plan coordinates, shape (k, 2)."""
    c, s = np.cos(np.radians(CORRIDOR_AZIMUTH_DEG)), np.sin(np.radians(CORRIDOR_AZIMUTH_DEG))
    return np.asarray((np.asarray(plan) - CENTRE_OF_TANK) @ np.array([[c, s], [-s, c]]))
