"""Vehicles of which nothing measures how they turn."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.sensors.silences import longest_step_s, silent_spells
from gtsam_nav.trajectory import UNIFORM_YAW_SIGMA, Trajectory

TURNING_TYPES = {"heading": "a heading", "imu": "an IMU", "odometry": "odometry"}
"""Sensors that measure a heading or a rate of turn."""
WITHOUT_GYRO = ("dr", "scan-match", "pose-ekf")
"""Methods whose dead reckoning takes no rates from an IMU."""
HARDLY_TOLD_RAD = np.radians(5.0)
"""A yaw that fixes have shown well is surer."""
NOT_TOLD_RAD = np.radians(18.0)
"""A less sure one is not told: the cost is so flat, and so far from a parabola, that its curvature
claims twice what there is."""
LONG_S = 5.0
"""Over less the yaw goes on as it did."""
TURN_S = 5.0
"""How long a vehicle keeps a rate of turn, or thereabouts."""


def unmeasured_yaw_variance_rad2_s(settings: MotionSettings) -> float:
    """Growth of the variance of a yaw that nothing measures.

    A rate of turn that walks for `TURN_S` and then begins anew turns the vehicle by
    ``q TURN_S^3 / 3`` each time, q being the density of its acceleration.
    """
    return settings.sigma_yaw_accel_rad_s2**2 * TURN_S**2 / 3.0


def warnings_on_turns(method: str, mission: Mission) -> tuple[str, ...]:
    """What a user must hear of a mission whose heading nothing tells a method."""
    used = [kind for kind in TURNING_TYPES if kind != "imu" or method not in WITHOUT_GYRO]
    if mission.first("dvl") is None:
        return ()
    if any(mission.first(kind) for kind in used):
        spells = untold_turns(mission, used)
        if not len(spells):
            return ()
        begin, end = spells[np.argmax(spells[:, 1] - spells[:, 0])]
        return (
            f"nothing measures how the vehicle turns from {begin:.1f} s to {end:.1f} s: unless"
            " fixes or scans tell it, the yaw there is a guess",
        )
    lacking = " nor ".join(TURNING_TYPES[kind] for kind in used)
    return (
        f"nothing measures how the vehicle turns: {method} finds neither {lacking}; unless fixes or"
        " scans tell it, the yaw stays that of the start and its sigma grows to that of a direction"
        " nobody knows",
    )


def untold_turns(mission: Mission, kinds: Collection[str] = tuple(TURNING_TYPES)) -> Array:
    """First and last moment of each time that all sensors of some types are silent, shape (k, 2),
    s."""
    stamps = [sensor.series.t for kind in kinds for sensor in mission.of_type(kind)]
    t = np.sort(np.concatenate([np.empty(0), *stamps]))
    return silent_spells(t, *mission.span_s, max(LONG_S, longest_step_s(t)))


def unknown_where_not_told(mission: Mission, *of_one: Trajectory | None) -> list[Any]:
    """A solution's trajectories, which claim no yaw where fixes alone tell it and do not.

    Parameters
    ----------
    of_one : Trajectory or None
        The first, by which the others are judged too.
    """
    sigma = _sigma_by_fixes(mission, of_one[0])
    if sigma is None or sigma < NOT_TOLD_RAD:
        return list(of_one)
    return [trajectory and _of_any_yaw(trajectory) for trajectory in of_one]


def warnings_on_yaw(mission: Mission, trajectory: Trajectory) -> tuple[str, ...]:
    """What a user must hear of a yaw that accelerations beside fixes show, and hardly do."""
    sigma = _sigma_by_fixes(mission, trajectory)
    if sigma is None or sigma < HARDLY_TOLD_RAD:
        return ()
    shown = f"to {np.degrees(sigma):.0f} deg (median sigma)"
    if sigma > NOT_TOLD_RAD:
        shown = (
            "too little to tell one: the yaw is stated as unknown, and may be wrong by any angle"
        )
    return (
        "nothing measures the heading; fixes show it where the vehicle accelerates, here"
        f" {shown}; where the antenna is, is known better than all that is not there",
    )


def _sigma_by_fixes(mission: Mission, trajectory: Trajectory | None) -> float | None:
    """Median sigma of a yaw that accelerations beside fixes tell, rad; None where more does."""
    others = ("heading", "odometry", "dvl", "landmarks", "scans")
    told = mission.initial.heading is not None or any(mission.first(kind) for kind in others)
    if told or trajectory is None or mission.first("gnss") is None:
        return None
    sigma = trajectory.sigma_rpy
    return None if sigma is None else float(np.median(sigma[:, 2]))


def _of_any_yaw(trajectory: Trajectory) -> Trajectory:
    if trajectory.cov_pose_n is None:
        return trajectory
    cov = trajectory.cov_pose_n.copy()
    cov[:, 5, 5] = np.maximum(cov[:, 5, 5], UNIFORM_YAW_SIGMA**2)
    return replace(trajectory, cov_pose_n=cov)


def bounded_by_way(trajectory: Trajectory) -> Trajectory:
    """A trajectory no less sure of its place than the way that it has gone allows.

    To first order a yaw that may be any puts a vehicle at any distance, and across its way alone.
    But where its speed was measured, two ways of length L from the same start end at most 2 L
    apart, and ``sqrt(2) L`` in the root mean square over all directions. Where the yaw is less sure
    than one of which nothing is known, and the place than that, the place is taken to lie
    anywhere about it; the velocity, which is as fast in any direction, likewise.
    """
    if trajectory.cov_pose_n is None:
        return trajectory
    cov, sigma_v_n = trajectory.cov_pose_n.copy(), trajectory.sigma_v_n
    steps = np.linalg.norm(np.diff(trajectory.p_n[:, :2], axis=0), axis=1)
    way_m = np.concatenate([[0.0], np.cumsum(steps)])
    spread = cov[:, 0, 0] + cov[:, 1, 1]
    most = spread[0] + 2.0 * way_m**2
    lost = (cov[:, 5, 5] > UNIFORM_YAW_SIGMA**2) & (spread > most)
    if not np.any(lost):
        return trajectory
    cov[lost, :2], cov[lost, :, :2] = 0.0, 0.0
    cov[lost, 0, 0] = cov[lost, 1, 1] = 0.5 * most[lost]
    if trajectory.v_n is not None and sigma_v_n is not None:
        speed = np.hypot(np.linalg.norm(trajectory.v_n, axis=1), sigma_v_n[:, 2])
        sigma_v_n = sigma_v_n.copy()
        sigma_v_n[lost, :2] = speed[lost, None]
    return replace(trajectory, cov_pose_n=cov, sigma_v_n=sigma_v_n)
