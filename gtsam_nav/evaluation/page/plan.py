"""The plan view's data: paths, map, loops, landmarks and fixes where they are drawn."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gtsam_nav.evaluation.histories import foremost, line_starts, ranked
from gtsam_nav.evaluation.metrics import reference_series
from gtsam_nav.evaluation.page.columns import (
    ANGLE_DEG,
    PLACE_M,
    Document,
    every_nth,
    figure,
    packed,
    packed_path,
)
from gtsam_nav.evaluation.tracks import Track, map_name, track_of
from gtsam_nav.evaluation.used_fixes import used_fixes
from gtsam_nav.mission import Mission
from gtsam_nav.series import GnssSeries
from gtsam_nav.solution import LoopClosure, Solution

MOST_POSES = 12_000
MOST_ECHOES = 120_000
"""Drawn at most; more only make the file larger."""


def plan_document(solutions: Sequence[Solution]) -> Document:
    """All layers of the plan, the foremost solution first.

    The map is that of the foremost solution that has one, the fixes are those that the foremost
    had. A solution without absolute positions is drawn after its SE(2) alignment, as its note says.
    """
    tracks = [track_of(solution) for solution in ranked(solutions)]
    chosen = foremost(solutions)
    return {
        "reference": _reference(chosen),
        "tracks": [_track(track) for track in tracks],
        "map": next((found for track in tracks if (found := _map(track))), None),
        "survey": _survey(chosen.mission),
        "fixes": _fixes(chosen),
    }


def _reference(solution: Solution) -> Document | None:
    if solution.reference is None:
        return None
    series = reference_series(solution.reference)
    series = series.select(every_nth(len(series), MOST_POSES))
    return {
        "name": solution.reference.name,
        "starts": line_starts(series.t).tolist(),
        **packed_path(series.t, series.p_n),
    }


def _track(track: Track) -> Document:
    solution = track.solution
    which = every_nth(len(solution.trajectory), MOST_POSES)
    shown = solution.trajectory.select(which)
    turn_deg = math.degrees(math.atan2(track.R[1, 0], track.R[0, 0]))
    heading_deg = np.degrees(np.unwrap(shown.yaw)) + turn_deg
    document = {
        "method": solution.method,
        "note": track.note,
        "lever_b_m": track.lever_b[:2].tolist(),
        "starts": line_starts(shown.t).tolist(),
        **packed_path(shown.t, track.path_n[which]),
        "heading_deg": packed(heading_deg, ANGLE_DEG),
        "loops": [_loop(loop, track) for loop in solution.loops],
        "landmarks": _landmarks(track),
        "online": _online(track),
    }
    if shown.cov_pose_n is not None:
        cov = track.R @ shown.at_lever_arm(track.lever_b).cov_pose_n[:, :3, :3] @ track.R.T  # type: ignore[index]
        sigma = np.sqrt(np.maximum(np.diagonal(cov, axis1=1, axis2=2), 1e-12))
        document["sigma_n"] = packed(sigma[:, 0], PLACE_M)
        document["sigma_e"] = packed(sigma[:, 1], PLACE_M)
        document["correlation"] = packed(cov[:, 0, 1] / (sigma[:, 0] * sigma[:, 1]), 1e-3)
    return document


def _online(track: Track) -> Document | None:
    online = track.solution.online
    if online is None:
        return None
    online = online.select(every_nth(len(online), MOST_POSES))
    return packed_path(online.t, track.path_of(online))


def _loop(loop: LoopClosure, track: Track) -> Document:
    (e_a, e_b), (n_a, n_b) = track.at(np.array([loop.t_a, loop.t_b])).tolist()
    return {
        "t_a": figure(loop.t_a, 3),
        "t_b": figure(loop.t_b, 3),
        "ne_a": [figure(n_a, 2), figure(e_a, 2)],
        "ne_b": [figure(n_b, 2), figure(e_b, 2)],
        "verdict": loop.verdict,
        "reason": loop.reason,
        "score": figure(loop.score, 3),
        "weight": None if loop.weight is None else figure(loop.weight, 3),
        "dx_m": figure(loop.dx_m, 3),
        "dy_m": figure(loop.dy_m, 3),
        "dyaw_deg": figure(math.degrees(loop.dyaw), 3),
    }


def _landmarks(track: Track) -> list[Document]:
    found = track.solution.landmarks
    if found is None:
        return []
    cov_n = track.R @ found.cov_n @ track.R.T
    return [
        {
            "id": int(name),
            "ne": [figure(n, 3), figure(e, 3)],
            "cov": [figure(value, 6) for value in (cov[0, 0], cov[1, 1], cov[0, 1])],
        }
        for name, (n, e, _), cov in zip(found.id, track.place(found.p_n), cov_n, strict=True)
    ]


def _survey(mission: Mission) -> list[Document]:
    survey = mission.landmark_map
    if survey is None:
        return []
    return [
        {"id": int(name), "ne": [figure(n, 3), figure(e, 3)]}
        for name, (n, e, _) in zip(survey.id, survey.p_n, strict=True)
    ]


def _map(track: Track) -> Document | None:
    sonar_map = track.solution.sonar_map
    if sonar_map is None or not len(sonar_map.t):
        return None
    which = every_nth(len(sonar_map.t), MOST_ECHOES)
    path = packed_path(sonar_map.t[which], track.place(sonar_map.points_n[which]))
    name = map_name(track.solution.mission)
    return {"method": track.solution.method, "name": name, **path}


def _fixes(solution: Solution) -> Document:
    """The fixes that the solution used, and those that it had but did not believe."""
    reasons = {(r.sensor, r.index): r.reason for r in solution.rejections}
    rejected: list[Document] = []
    for sensor in solution.mission.of_type("gnss"):
        series = sensor.series
        assert isinstance(series, GnssSeries)
        for t, row, (n, e, _) in zip(series.t, series.row, series.p_n, strict=True):
            reason = reasons.get((sensor.name, int(row)))
            if reason is not None:
                place = [figure(n, 2), figure(e, 2)]
                rejected.append({"t": figure(t, 3), "ne": place, "reason": reason})
    return {"used": packed_path(*used_fixes(solution)), "rejected": rejected}
