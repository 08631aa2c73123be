"""[B] Pose-based SLAM with a mechanically scanned sonar, on St. Pere and on simulated marinas."""

from __future__ import annotations

import time
from pathlib import Path

import gtsam_nav as gn
from benchmarks.seeds.runs import Job, run_all
from benchmarks.seeds.table import Row, Spread, Table

METHODS = ("dr", "scan-match", "pose-ekf", "graph")
PUBLISHED_M = {"dr": "17.46", "scan-match": "3.99", "pose-ekf": "1.90", "graph": ""}
STPERE = ("gnss.use=window", "gnss.window_s=[0,300]", "evaluation.window_s=[0,3020]")
SPAN_S = 3020.0
COST_SHARES = (0.25, 0.5, 0.75, 1.0)


def stpere(folder: Path) -> Table:
    """Mean error against DGPS over the sonar's span, under every alignment."""
    mission = gn.open_mission(folder)
    config = gn.load_config(None, STPERE)
    rows = []
    sonar = None
    for method in METHODS:
        begin = time.perf_counter()
        solution = gn.estimate(mission, method, config)
        wall_s = time.perf_counter() - begin
        metrics = gn.evaluate(solution, window_s=config.evaluation.window_s)
        sonar = metrics.sonar
        found = (metrics.ate.none, metrics.ate.start, metrics.ate.se2, metrics.ate.se3)
        figures = [None if f is None else Spread.of([f.mean]) for f in found]
        nees = None if metrics.nees is None else Spread.of([metrics.nees.mean])
        rows.append(Row(method, (*figures, nees, Spread.of([wall_s])), (PUBLISHED_M[method],)))
    return Table(
        f"[B] St. Pere, {sonar} sonar: mean error against DGPS, m, by alignment",
        ("none", "start", "se2", "se3", "NEES", "wall s"),
        ("mean",),
        tuple(rows),
        "Published with the real sonar: feature-based SLAM 1.91 m, loop detection 1.58 m. The"
        f" sonar here is {sonar}: these figures do not compare with those.",
    )


def simulated(seeds: int, workers: int) -> Table:
    """Errors on simulated marinas, with GNSS over the first two minutes."""
    window = ("gnss.use=window", "gnss.window_s=[0,120]")
    jobs = [Job(m, "marina", 1 + k, m, window) for k in range(seeds) for m in METHODS]
    found = run_all(jobs, workers)
    rows = [
        Row(method, (Spread.of([e.mean_horizontal for e in found[method]]),), ())
        for method in METHODS
    ]
    title = f"[B] simulated marina, 10 min: mean error without alignment, m, {seeds} missions"
    return Table(title, ("none",), (), tuple(rows))


def cost(folder: Path) -> Table:
    """Wall time of the augmented-state filter against the number of scans."""
    mission = gn.open_mission(folder)
    config = gn.load_config(None, STPERE)
    rows = []
    for share in COST_SHARES:
        part = mission.crop(stop_s=share * SPAN_S)
        begin = time.perf_counter()
        solution = gn.estimate(part, "pose-ekf", config)
        wall_s = time.perf_counter() - begin
        figures = (Spread.of([wall_s]), Spread.of([1e3 * wall_s / solution.n_keyframes]))
        rows.append(Row(f"{solution.n_keyframes} scans", figures, ()))
    return Table("[B] cost of pose-ekf on St. Pere", ("wall s", "ms a scan"), (), tuple(rows))
