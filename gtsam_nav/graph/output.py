"""From the graph's values to trajectory, uncertainty, slow states, loops and map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gtsam_nav.frames import Array, quaternion_from_rotation
from gtsam_nav.graph.block_covariances import joint_covariances
from gtsam_nav.graph.exported import match_weight
from gtsam_nav.graph.factors import B, parts
from gtsam_nav.graph.measurements.edges import KeyframeEdge
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.robust import Robustness
from gtsam_nav.graph.scan_matching import LOOP, SCAN_MATCH, ScanMatch
from gtsam_nav.graph.sensor_posterior import CALIBRATION, Constants, SensorPosterior, free_part
from gtsam_nav.mission import Mission, Rejection
from gtsam_nav.series import IntArray
from gtsam_nav.solution import LandmarkEstimates, LoopClosure, SlowStates
from gtsam_nav.sonar.scans import Scan
from gtsam_nav.trajectory import Trajectory


def smoothed_covariances(
    graph: Any, keys: list[int], posterior: SensorPosterior, is_stiff: bool = False
) -> list[Array]:
    """Marginal covariances of the variables' free parts, the constant errors' share included."""
    alone = [(key,) for key in keys]
    without = joint_covariances(graph, posterior.system.values, alone, is_stiff)
    covariances = []
    for key, cov in zip(keys, without, strict=True):
        own, free = posterior.system.columns[key], free_part(key)
        spread = posterior.spread[own]
        covariances.append(cov[free, free] + spread @ spread.T)
    return covariances


def keyframe_trajectory(t: Array, states: list[Any], covariances: list[Array]) -> Trajectory:
    """NavStates and their tangent covariances as a trajectory."""
    R_nb, p_n, v_n = parts(states)
    cov = np.array(covariances)
    to_n = np.zeros((len(t), 6, 9))
    to_n[:, :3, 3:6] = R_nb
    to_n[:, 3:, :3] = R_nb
    cov_v = R_nb @ cov[:, 6:, 6:] @ np.swapaxes(R_nb, 1, 2)
    return Trajectory(
        t=t,
        p_n=p_n,
        q_nb_wxyz=quaternion_from_rotation(R_nb),
        v_n=v_n,
        cov_pose_n=to_n @ cov @ np.swapaxes(to_n, 1, 2),
        sigma_v_n=np.sqrt(np.maximum(np.diagonal(cov_v, axis1=1, axis2=2), 0.0)),
        keyframe=np.ones(len(t), dtype=bool),
    )


def constant_errors(problem: Problem, constants: Constants) -> dict[str, tuple[float, float]]:
    """Constant errors of the sensors by name with unit: estimates and sigmas, all sensors together.

    Those of the velocity that are known beforehand are left out.
    """
    mean, cov = constants.mean, constants.cov
    names = [f"velocity_{name}" for name in CALIBRATION] + [c.name for c in problem.constants]
    if problem.timing is not None:
        mean = mean + np.append(np.zeros(len(names)), problem.timing.corrected_s)
        names += problem.timing.names
    known = dict(zip(names, problem.calibration_sigma == 0.0, strict=False))
    found = zip(names, mean.tolist(), np.sqrt(np.diag(cov)).tolist(), strict=True)
    return {name: (value, sigma) for name, value, sigma in found if not known.get(name)}


def slow_states(
    problem: Problem,
    values: Any,
    covariances: dict[int, Array],
    constants: Mapping[str, tuple[float, float]],
) -> SlowStates:
    """Heading bias, IMU biases, range scales and constant errors at each keyframe, with sigmas."""
    n = len(problem.t)
    columns = {
        name: (np.full(n, value), np.full(n, sigma)) for name, (value, sigma) in constants.items()
    }
    index = range(n)
    if problem.compass:
        # the compass frame's yaw is what must be added to the reading
        yaw = np.array([values.atNavState(key).attitude().yaw() for key in problem.compass])
        sigma = np.sqrt([covariances[key][0, 0] for key in problem.compass])
        columns["heading_bias_rad"] = (-yaw, sigma)
    if problem.uses_imu:
        vectors = np.array([values.atConstantBias(B(k)).vector() for k in index])
        sigmas = np.sqrt([np.diag(covariances[B(k)]) for k in index])
        names = [f"accel_{a}_m_s2" for a in "xyz"] + [f"gyro_{a}_rad_s" for a in "xyz"]
        for c, name in enumerate(names):
            columns[name] = (vectors[:, c], sigmas[:, c])
    for sensor, key in problem.range_scales.items():
        scale = np.full(len(problem.t), values.atNavState(key).position()[0])
        columns[f"{sensor}_range_scale"] = (
            scale,
            np.full(len(problem.t), np.sqrt(covariances[key][0, 0])),
        )
    return SlowStates(problem.t, columns)


def landmark_estimates(
    problem: Problem, values: Any, covariances: dict[int, Array], seen: set[int]
) -> LandmarkEstimates | None:
    """Landmarks with at least one sighting that was believed; None without any."""
    known = sorted((i, key) for i, key in problem.landmarks.items() if key in seen)
    if not known:
        return None
    cov_n = np.array([covariances[key] for _, key in known])
    for m, (landmark, _) in enumerate(known):
        if landmark in problem.level_landmarks:
            cov_n[m, 2, :] = cov_n[m, :, 2] = 0.0
    return LandmarkEstimates(
        id=np.array([landmark for landmark, _ in known]),
        p_n=np.array([values.atNavState(key).position() for _, key in known]),
        cov_n=cov_n,
    )


def loop_closures(
    matches: list[ScanMatch],
    t_scans: Array,
    scan_keyframe: IntArray,
    values: Any,
    robustness: Robustness,
) -> tuple[LoopClosure, ...]:
    """Every candidate with its verdict; accepted ones with their weight at given values."""
    closures = []
    for m in matches:
        if not m.is_loop:
            continue
        weight = match_weight(m, scan_keyframe, values, robustness) if m.accepted else None
        # a registration that never ran has nothing to report
        tried = 1.0 if m.match.iterations else np.nan
        q, sigma = tried * m.match.q, tried * np.sqrt(np.diag(m.match.cov))
        closures.append(
            LoopClosure(
                t_a=float(t_scans[m.a]),
                t_b=float(t_scans[m.b]),
                dx_m=float(q[0]),
                dy_m=float(q[1]),
                dyaw=float(q[2]),
                sigma_x_m=float(sigma[0]),
                sigma_y_m=float(sigma[1]),
                sigma_yaw=float(sigma[2]),
                score=m.match.overlap,
                verdict="accepted" if m.accepted else "rejected",
                reason=m.recorded_reason,
                weight=weight,
            )
        )
    return tuple(closures)


def stated_closures(
    stated: Sequence[KeyframeEdge], mission: Mission, values: Any, robustness: Robustness
) -> tuple[LoopClosure, ...]:
    """The loops that the mission's edges close: all are accepted, with their weight."""
    edges = mission.edges
    if edges is None:
        return ()
    q, sigma = edges.q, np.sqrt(np.diagonal(edges.cov, axis1=1, axis2=2))
    closures = []
    for e in stated:
        if not e.is_loop:
            continue
        closures.append(
            LoopClosure(
                t_a=float(edges.t[e.row, 0]),
                t_b=float(edges.t[e.row, 1]),
                dx_m=float(q[e.row, 0]),
                dy_m=float(q[e.row, 1]),
                dyaw=float(q[e.row, 2]),
                sigma_x_m=float(sigma[e.row, 0]),
                sigma_y_m=float(sigma[e.row, 1]),
                sigma_yaw=float(sigma[e.row, 2]),
                score=np.nan,
                verdict="accepted",
                reason="",
                weight=e.weight_at(values, robustness),
            )
        )
    return tuple(closures)


def match_rejections(matches: list[ScanMatch], t_scans: Array) -> tuple[Rejection, ...]:
    """Registrations that succeeded and were not believed, at the new scan; ``index`` is its own."""
    return tuple(
        Rejection(
            float(t_scans[m.b]),
            LOOP if m.is_loop else SCAN_MATCH,
            m.b,
            m.recorded_reason,
            m.normalised_residual,
        )
        for m in matches
        if m.normalised_residual is not None
    )


def thin_scan_rejections(scans: Sequence[Scan], min_points: int) -> tuple[Rejection, ...]:
    """Scans that hold too few points to be registered; ``index`` is the scan's."""
    reason = f"fewer than {min_points} points"
    return tuple(
        Rejection(scan.t_ref, SCAN_MATCH, k, reason)
        for k, scan in enumerate(scans)
        if len(scan) < min_points
    )
