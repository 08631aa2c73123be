"""Pose graphs through our reader and back end, against GTSAM's own reader and one LM.

city10000, which GTSAM brings along, and any planar g2o file that is named. Ours is once the whole
method (causal pass, batch, refinement and covariances), and once its batch alone from where the LM
starts, the file's odometry; both with least squares instead of kernels, so that all seek the same
optimum. ``chi2`` is that of the file's edges at either's poses. Times are the processor's.
"""

from __future__ import annotations

import itertools
import statistics
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gtsam
import numpy as np

import gtsam_nav as gn
from gtsam_nav.config import Config
from gtsam_nav.frames import rotation_from_rpy, rpy_from_quaternion
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.measurements import build_problem
from gtsam_nav.graph.outset import mission_keyframes, start_and_motion
from gtsam_nav.graph.settling import settle

CITY, CITY_POSES = "T1_city10000_04.txt", 10_000
SHORT_POSES = 2000
"""So many of city10000 are enough; all of them take minutes."""
CITY_INFORMATION = "900 0 0 900 0 10000"
"""Of 1/30 m, 1/30 m and 1/100 rad, as in GTSAM's own example."""
LEAST_SQUARES = ("graph.robust.loops.kernel=none", "graph.robust.velocity.kernel=none")


def measure(repeats: int, files: Sequence[Path], whole: bool) -> dict[str, Any]:
    """Seconds and chi-squares of each graph."""
    rows = {}
    with tempfile.TemporaryDirectory() as folder:
        poses = CITY_POSES if whole else SHORT_POSES
        city = Path(folder) / f"city{poses}.g2o"
        write_city(city, poses)
        for path in (city, *files):
            rows[path.name.partition(".g2o")[0]] = _compare(path, repeats)
    ratios = {
        f"{what}_{name}": row[what]
        for name, row in rows.items()
        for what in (
            "reading_over_gtsam",
            "batch_over_raw",
            "estimate_over_raw",
            "chi2_over_raw",
            "batch_chi2_over_raw",
        )
    }
    return {"graphs": rows, "ratios": ratios}


def write_city(path: Path, poses: int) -> None:
    """The first poses of city10000 as g2o; of an edge with several hypotheses the first."""
    lines = []
    for line in Path(gtsam.findExampleDataFile(CITY)).read_text(encoding="ascii").splitlines():
        _, a, _, b, _, _, x, y, theta, *_ = line.split()
        if max(int(a), int(b)) < poses:
            lines.append(f"EDGE_SE2 {a} {b} {x} {y} {theta} {CITY_INFORMATION}\n")
    path.write_text("".join(lines), encoding="ascii")


def _compare(path: Path, repeats: int) -> dict[str, Any]:
    gn.open_mission(path)  # imports
    runs = [_once(path) for _ in range(repeats)]
    row = {name: statistics.median(run[name] for run in runs) for name in runs[0]}
    return {
        **row,
        "reading_over_gtsam": row["reading_s"] / row["raw_reading_s"],
        "batch_over_raw": row["batch_s"] / row["raw_lm_s"],
        "estimate_over_raw": row["estimate_s"] / row["raw_lm_s"],
        "raw_over_estimate": row["raw_lm_s"] / row["estimate_s"],
        "chi2_over_raw": row["chi2"] / row["raw_chi2"],
        "batch_chi2_over_raw": row["batch_chi2"] / row["raw_chi2"],
    }


def _once(path: Path) -> dict[str, float]:
    config = gn.load_config(None, LEAST_SQUARES)
    marks = [time.process_time()]
    mission = gn.open_mission(path)
    marks.append(time.process_time())
    solution = gn.estimate(mission, "graph", config)
    marks.append(time.process_time())
    graph, _ = gtsam.readG2o(str(path), False)
    marks.append(time.process_time())
    start = _odometry(graph)
    anchored = gtsam.NonlinearFactorGraph(graph)
    anchored.push_back(gtsam.NonlinearEqualityPose2(0, gtsam.Pose2()))
    raw = gtsam.LevenbergMarquardtOptimizer(anchored, start).optimize()
    marks.append(time.process_time())
    batch_s, batched = _batch(mission, config, start)
    names = ("reading_s", "estimate_s", "raw_reading_s", "raw_lm_s")
    spans = [b - a for a, b in itertools.pairwise(marks)]
    return {
        "poses": float(start.size()),
        "edges": float(graph.size()),
        **dict(zip(names, spans, strict=True)),
        "batch_s": batch_s,
        "chi2": 2.0 * graph.error(_poses(solution)),
        "batch_chi2": 2.0 * graph.error(batched),
        "raw_chi2": 2.0 * graph.error(raw),
    }


def _batch(mission: gn.Mission, config: Config, start: Any) -> tuple[float, Any]:
    """Seconds of our batch alone, and where it leads from given poses."""
    alignment, motion = start_and_motion(mission, config)
    t = mission_keyframes(mission, np.empty(0), np.empty(0), config)
    problem = build_problem(mission, alignment, motion, t, config)
    values = gtsam.Values()
    for k in range(len(t)):
        pose = start.atPose2(k)
        R_nb = rotation_from_rpy([0.0, 0.0, -pose.theta()])
        p_n = np.array([pose.x(), -pose.y(), 0.0])
        values.insert(X(k), gtsam.NavState(gtsam.Rot3(R_nb), p_n, R_nb @ problem.v_b[k]))
    begin = time.process_time()
    settled = settle(problem, problem.entries, values)
    seconds = time.process_time() - begin
    poses = gtsam.Values()
    for k in range(len(t)):
        state = settled.values.atNavState(X(k))
        x, y, _ = state.position()
        poses.insert(k, gtsam.Pose2(x, -y, -state.attitude().yaw()))
    return seconds, poses


def _odometry(graph: Any) -> Any:
    """The poses one after the other, from edge to edge between neighbours."""
    values = gtsam.Values()
    values.insert(0, gtsam.Pose2())
    for n in range(graph.size()):
        edge = graph.at(n)
        a, b = edge.keys()
        if b == a + 1 and not values.exists(b):
            values.insert(b, values.atPose2(a).compose(edge.measured()))
    return values


def _poses(solution: gn.Solution) -> Any:
    """The keyframes in the file's axes: y to port, theta counter-clockwise."""
    graph, values = solution.pose_graph, gtsam.Values()
    assert graph is not None
    yaw = rpy_from_quaternion(np.asarray(graph.q_nb_wxyz))[:, 2]
    for k, (p_n, turn) in enumerate(zip(graph.p_n.tolist(), yaw.tolist(), strict=True)):
        values.insert(k, gtsam.Pose2(p_n[0], -p_n[1], -turn))
    return values
