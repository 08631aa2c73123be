"""The project's acceptance runs: ``python -m benchmarks.acceptance [--stpere PATH] [--json FILE]``.

Simulated marina missions of five seeds with and without sonar; with ``--stpere`` the St. Pere logs
too. The graph is scored against fixes or a truth that it never saw.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np

import gtsam_nav as gn
from gtsam_nav.errors import GtsamNavError

SEEDS = (1, 2, 3, 4, 5)
MARINA = ("gnss.use=window", "gnss.window_s=[0,120]")
STPERE_SCORED = "evaluation.window_s=[0,3020]"
STPERE = {
    "window": ("gnss.use=window", "gnss.window_s=[0,300]"),
    "none": ("gnss.use=none",),
}
GnssUse = Literal["window", "none"]


@dataclass(frozen=True)
class RunResult:
    """Scores (m) of one method on one mission; what cannot be told is None."""

    mission: str
    method: str
    overrides: tuple[str, ...]
    ate_none_mean: float | None
    ate_none_rmse: float | None
    ate_se2_mean: float | None
    ate_online_none_mean: float | None
    ate_online_se2_mean: float | None
    nees_mean: float | None
    coverage: float | None
    sonar: str | None
    wall_s: float
    """Of the estimate and its scoring; reading and writing are not in it."""


def run(mission: gn.Mission, method: str, overrides: Iterable[str]) -> RunResult:
    """Estimate and score a mission with ``key=value`` settings."""
    config = gn.load_config(None, tuple(overrides))
    begin = time.perf_counter()
    solution = gn.estimate(mission, method, config)
    metrics = gn.evaluate(solution, window_s=config.evaluation.window_s)
    wall_s = time.perf_counter() - begin
    none, se2, online = metrics.ate.none, metrics.ate.se2, metrics.ate_online
    return RunResult(
        mission=mission.name,
        method=method,
        overrides=tuple(overrides),
        ate_none_mean=none and none.mean,
        ate_none_rmse=none and none.rmse,
        ate_se2_mean=se2 and se2.mean,
        ate_online_none_mean=online and online.none and online.none.mean,
        ate_online_se2_mean=online and online.se2 and online.se2.mean,
        nees_mean=metrics.nees and metrics.nees.mean,
        coverage=metrics.coverage,
        sonar=metrics.sonar,
        wall_s=wall_s,
    )


def marina(seed: int, sonar: bool, method: str = "graph") -> RunResult:
    """The simulated marina of a seed, ten minutes, with GNSS over the first two."""
    use = f"sonar.use={str(sonar).lower()}"
    return run(gn.simulate("marina", seed=seed), method, (*MARINA, use))


def stpere(mission: gn.Mission, gnss: GnssUse, method: str = "graph") -> RunResult:
    """The St. Pere logs over the sonar's span."""
    return run(mission, method, (*STPERE[gnss], STPERE_SCORED))


def stpere_wall_s(folder: Path) -> float:
    """Seconds from opening the St. Pere logs to the last result of dr and graph, without plots."""
    config = gn.load_config(None, (*STPERE["window"], STPERE_SCORED))
    begin = time.perf_counter()
    mission = gn.open_mission(folder)
    with tempfile.TemporaryDirectory() as out:
        for method in ("dr", "graph"):
            gn.write_run(gn.estimate(mission, method, config), config, out)
    return time.perf_counter() - begin


def main() -> None:
    """Print the table as the runs end, and write it as JSON where asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.acceptance", description=__doc__)
    parser.add_argument("--stpere", type=Path, help="folder of the St. Pere logs")
    parser.add_argument("--json", type=Path, help="write the figures here")
    arguments = parser.parse_args()
    try:
        mission = gn.open_mission(arguments.stpere) if arguments.stpere else None
    except GtsamNavError as error:
        parser.error(str(error))
    print(HEADER)
    results: list[RunResult] = []
    wall_s = None
    if mission is not None:
        for gnss in ("window", "none"):
            results += [show(stpere(mission, gnss, method)) for method in ("dr", "graph")]
        wall_s = stpere_wall_s(arguments.stpere)
        print(f"St. Pere, dr and graph from reading to results written: {wall_s:.1f} s")
    with_sonar = [show(marina(seed, sonar=True)) for seed in SEEDS]
    without = [show(marina(seed, sonar=False)) for seed in SEEDS]
    worse = [b.ate_none_rmse / a.ate_none_rmse for a, b in zip(with_sonar, without, strict=True)]
    nees = float(np.mean([r.nees_mean for r in with_sonar]))
    print(f"marina: mean NEES {nees:.2f}; without sonar worse by {min(worse):.1f} or more")
    if arguments.json:
        document = {
            "runs": [asdict(r) for r in (*results, *with_sonar, *without)],
            "stpere_wall_s": wall_s,
            "marina_nees_mean": nees,
            "marina_worse_without_sonar": worse,
        }
        arguments.json.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


HEADER = (
    "mission          method none mean none rmse  se2 mean online se2    NEES  coverage"
    "  wall s  sonar, settings"
)


def show(r: RunResult) -> RunResult:
    """Print one row."""
    scores = (r.ate_none_mean, r.ate_none_rmse, r.ate_se2_mean, r.ate_online_se2_mean, r.nees_mean)
    columns = " ".join("        -" if s is None else f"{s:9.2f}" for s in scores)
    sonar = "no sonar" if r.sonar is None else f"{r.sonar} sonar"
    print(
        f"{r.mission:<16.16} {r.method:<6} {columns}  {r.coverage or 0:8.3f}  {r.wall_s:6.1f}"
        f"  {sonar}, {' '.join(r.overrides)}",
        flush=True,
    )
    return r


if __name__ == "__main__":
    main()
