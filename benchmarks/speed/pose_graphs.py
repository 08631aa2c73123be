"""Pose graphs through our reader and back end, against GTSAM's own reader and one LM.

Those that GTSAM brings along: city10000 (planar, loops), sphere2500 (in space, loops) and Victoria
Park (planar, landmarks), of each the first poses or all of them; and any g2o file that is named.
Ours is once the whole method (causal pass, batch, refinement and covariances), and once its batch
alone from where the LM starts, the file's odometry; both with least squares instead of kernels, so
that all seek the same optimum. ``chi2`` is that of the file's edges at either's poses. Times are
the processor's.

Of Victoria Park there are times alone: its odometry is a sensor's, and ours has states where trees
were seen, not at every pose. The LM's noise is that of our card.
"""

from __future__ import annotations

import itertools
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gtsam
import numpy as np

import gtsam_nav as gn
from benchmarks.speed.raw_pose_graphs import RawGraph, city_lines, read_raw
from gtsam_nav.config import Config
from gtsam_nav.frames import rotation_from_quaternion
from gtsam_nav.graph.backend import graph_of
from gtsam_nav.graph.exact_edges import refine_exactly
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.measurements import build_problem
from gtsam_nav.graph.outset import mission_keyframes, start_and_motion
from gtsam_nav.graph.settling import settle

CITY, SPHERE, PARK = "T1_city10000_04.txt", "sphere2500.txt", "victoria_park.txt"
WHOLE = {CITY: 10_000, SPHERE: 2500, PARK: 7120}
SHORT = {CITY: 2000, SPHERE: 500, PARK: 1500}
"""So many poses are enough; all of them take minutes. The park's trees are numbered among them."""
LEAST_SQUARES = (
    "graph.robust.loops.kernel=none",
    "graph.robust.velocity.kernel=none",
    "graph.robust.landmarks.kernel=none",
    "graph.robust.landmarks.gate_probability=null",
)
RATIOS = {
    "reading_over_gtsam": ("reading_s", "raw_reading_s"),
    "batch_over_raw": ("batch_s", "raw_lm_s"),
    "estimate_over_raw": ("estimate_s", "raw_lm_s"),
    "chi2_over_raw": ("chi2", "raw_chi2"),
    "batch_chi2_over_raw": ("batch_chi2", "raw_chi2"),
}


def measure(repeats: int, files: Sequence[Path], whole: bool) -> dict[str, Any]:
    """Seconds and chi-squares of each graph."""
    poses = WHOLE if whole else SHORT
    with tempfile.TemporaryDirectory() as folder:
        city = Path(folder) / f"city{poses[CITY]}.g2o"
        write_city(city, poses[CITY])
        sphere = Path(folder) / f"sphere{poses[SPHERE]}.txt"
        write_first(SPHERE, sphere, poses[SPHERE])
        park = Path(folder) / PARK  # the name by which its card is found
        write_first(PARK, park, poses[PARK])
        named = {path.name.partition(".")[0]: path for path in (city, sphere)}
        named[f"park{poses[PARK]}"] = park
        named |= {path.name.partition(".g2o")[0]: path for path in files}
        rows = {name: compare(path, repeats) for name, path in named.items()}
    ratios = {
        f"{what}_{name}": row[what] for name, row in rows.items() for what in RATIOS if what in row
    }
    return {"graphs": rows, "ratios": ratios}


def write_city(path: Path, poses: int) -> None:
    """The first poses of city10000 as g2o; of an edge with several hypotheses the first."""
    source = Path(gtsam.findExampleDataFile(CITY)).read_text(encoding="ascii")
    path.write_text("".join(city_lines(source.splitlines(), poses)), encoding="ascii")


def write_first(name: str, path: Path, poses: int) -> None:
    """The lines of one of GTSAM's files that begin with a word and an edge among the first poses,
    or a landmark seen from one of them."""
    lines = Path(gtsam.findExampleDataFile(name)).read_text(encoding="ascii").splitlines()
    kept = []
    for line in lines:
        word, a, b, *_ = line.split()
        if int(a) < poses and (word == "LANDMARK" or int(b) < poses):
            kept.append(f"{line}\n")
    path.write_text("".join(kept), encoding="ascii")


def compare(path: Path, repeats: int) -> dict[str, Any]:
    """Medians of one graph's figures, and their ratios."""
    gn.open_mission(path)  # imports
    runs = [_once(path) for _ in range(repeats)]
    row = {name: statistics.median(run[name] for run in runs) for name in runs[0]}
    ratios = {ratio: row[a] / row[b] for ratio, (a, b) in RATIOS.items() if a in row}
    return {**row, **ratios, "raw_over_estimate": row["raw_lm_s"] / row["estimate_s"]}


def _once(path: Path) -> dict[str, float]:
    config = gn.load_config(None, LEAST_SQUARES)
    marks = [time.process_time()]
    mission = gn.open_mission(path)
    marks.append(time.process_time())
    solution = gn.estimate(mission, "graph", config)
    marks.append(time.process_time())
    factors = read_raw(path)
    marks.append(time.process_time())
    raw = RawGraph.of(factors, mission)
    lm_s, optimum = _timed(raw.optimum)
    names = ("reading_s", "estimate_s", "raw_reading_s")
    spans = [b - a for a, b in itertools.pairwise(marks)]
    row = {
        "poses": float(len(raw.poses)),
        "edges": float(raw.graph.size()),
        **dict(zip(names, spans, strict=True)),
        "raw_lm_s": lm_s,
    }
    return row if mission.edges is None else row | _alike(mission, config, solution, raw, optimum)


def _alike(
    mission: gn.Mission, config: Config, solution: gn.Solution, raw: RawGraph, optimum: Any
) -> dict[str, float]:
    """What can be said where both graphs have the same poses."""
    batch_s, batched = _batch(mission, config, raw)
    graph = solution.pose_graph
    assert graph is not None
    ours = raw.values(rotation_from_quaternion(graph.q_nb_wxyz), graph.p_n)
    return {
        "batch_s": batch_s,
        "chi2": 2.0 * raw.graph.error(ours),
        "batch_chi2": 2.0 * raw.graph.error(batched),
        "raw_chi2": 2.0 * raw.graph.error(optimum),
    }


def _timed(solve: Callable[[], Any]) -> tuple[float, Any]:
    begin = time.process_time()
    found = solve()
    return time.process_time() - begin, found


def _batch(mission: gn.Mission, config: Config, raw: RawGraph) -> tuple[float, Any]:
    """Seconds of our batch alone, and where it leads from the LM's start."""
    alignment, motion = start_and_motion(mission, config)
    t = mission_keyframes(mission, np.empty(0), np.empty(0), config)
    problem = build_problem(mission, alignment, motion, t, config)
    values = gtsam.Values()
    for k in range(len(t)):
        R_nb, p_n = raw.start_in_ned(k)
        values.insert(X(k), gtsam.NavState(gtsam.Rot3(R_nb), p_n, R_nb @ problem.v_b[k]))

    def solve() -> Any:
        settled = settle(problem, problem.entries, values)
        if not problem.exact:
            return settled.values
        return refine_exactly(graph_of(problem.entries), settled.values, problem)[1].values

    seconds, solved = _timed(solve)
    states = [solved.atNavState(X(k)) for k in range(len(t))]
    R_nb = np.array([state.attitude().matrix() for state in states])
    p_n = np.array([state.position() for state in states])
    return seconds, raw.values(R_nb, p_n)
