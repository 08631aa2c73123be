"""A depth that nothing measures but ranges to deeper beacons.

A submersible without a depth gauge, on odometry: of what rolls or floats the depth is that of its
start, and the level floor is known to the millimetre; of this one nothing is known but that it is
in the water above its beacons. Their slant ranges tell how deep, the steeper the better.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.alignment import align
from gtsam_nav.series import LandmarkSeries

TELL_DEPTH = ("imu", "depth", "dvl", "gnss")
DEEPER_M = 1.0
"""Beacons that lie less deep below the start show no depth."""
DIVE_M_SQRT_S = 0.6
"""Random walk of a depth that changes unseen: at 0.15 m/s up or down for 8 s at a time."""


def depth_spread_m(mission: Mission, use_map: bool) -> float:
    """How deep below its start a vehicle may be; zero where its depth is measured, or stays.

    As deep as the beacons lie in the mean square. The start may be wherever the mission says.
    """
    known, constraints = mission.landmark_map, mission.constraints
    is_known = constraints.constant_depth or constraints.nonholonomic or _may_change(mission)
    if is_known or not use_map or known is None or not len(known.id):
        return 0.0
    sighted = [sensor.series for sensor in mission.of_type("landmarks")]
    if not any(isinstance(s, LandmarkSeries) and s.range_m is not None for s in sighted):
        return 0.0
    below_m = known.p_n[:, 2] - float(align(mission).p_n[2])
    return float(np.sqrt(np.mean(below_m**2))) if np.all(below_m > DEEPER_M) else 0.0


def _may_change(mission: Mission) -> bool:
    """Whether something tells changes of the depth."""
    return any(mission.of_type(kind) for kind in TELL_DEPTH) or mission.edges is not None


def said_of_depth(mission: Mission, use_map: bool, *, estimated: bool) -> Iterator[str]:
    """What a method says of a depth that it estimates by ranges, or that it takes for granted."""
    if mission.constraints.constant_depth and _may_change(mission):
        yield (
            "'constraints: {constant_depth: true}' counts where nothing but odometry tells the"
            " motion: it is not used here; a depth sensor's log holds a depth"
        )
    if depth_spread_m(mission, use_map):
        depth_m = float(align(mission).p_n[2])
        done = "estimated by ranges to deeper beacons" if estimated else f"held at {depth_m:g} m"
        yield (
            f"nothing measures the depth: it is {done}; a depth gauge would tell it, and"
            " 'constraints: {constant_depth: true}' says that the vehicle keeps that of its start"
        )
