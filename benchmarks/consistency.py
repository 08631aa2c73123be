"""Are the estimators as good as they say?

``python -m benchmarks.consistency [--runs N] [--out FOLDER]`` runs every method on N simulated
missions whose noise is what the sensors' cards state, averages NEES and NIS over the runs, and
prints the share of the times at which the average lies inside its 95 % chi-square bounds. With
``--out`` it writes the figures as JSON and draws them.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

import gtsam_nav as gn
from gtsam_nav.evaluation import plots
from gtsam_nav.evaluation.ensemble import (
    EnsembleConsistency,
    NormalisedErrors,
    ensemble_nees,
    ensemble_nis,
    normalised_errors,
)
from gtsam_nav.simulation.settings import SimulationSettings, StartSimulation
from gtsam_nav.solution import Innovations

BIN_S = 1.0
"""Innovations of so long a span are averaged together: that of the slowest sensor."""
START = StartSimulation(sigma_position_m=0.1, sigma_heading_deg=0.5)


@dataclass(frozen=True)
class Case:
    """A method on missions of one kind.

    Attributes
    ----------
    name : str
    scenario : str
    method : str
    overrides : tuple of str
        ``key=value`` settings.
    promised : bool
        Whether the method promises consistency; the SLAM filters are known to grow over-confident
        with heading errors, and are only measured.
    """

    name: str
    scenario: str
    method: str
    overrides: tuple[str, ...] = ()
    promised: bool = True


CASES = (
    Case("laps, ins-ekf", "laps", "ins-ekf"),
    Case("laps, ins-ekf smoothed", "laps", "ins-ekf", ("ins_ekf.smooth=true",)),
    Case("laps, graph", "laps", "graph"),
    Case("marina, ins-ekf", "marina", "ins-ekf", ("gnss.use=all",)),
    Case("marina, graph", "marina", "graph", ("gnss.use=all",)),
    Case("marina, graph without sonar", "marina", "graph", ("gnss.use=all", "sonar.use=false")),
    Case("marina, landmark-ekf", "marina", "landmark-ekf", ("gnss.use=none",), promised=False),
    Case("marina, pose-ekf", "marina", "pose-ekf", ("gnss.use=none",), promised=False),
)


@dataclass(frozen=True)
class Run:
    """What one run says of itself."""

    errors: NormalisedErrors
    innovations: Mapping[str, Innovations]


def run(case: Case, seed: int) -> Run:
    """One mission of a case."""
    settings = None
    if case.scenario == "marina":
        # without fixes the start must be stated: errors in a local frame say nothing
        start = None if "gnss.use=all" in case.overrides else START
        settings = SimulationSettings.matched().model_copy(update={"start": start})
    mission = gn.simulate(case.scenario, seed=seed, settings=settings)
    solution = gn.estimate(mission, case.method, gn.load_config(None, case.overrides))
    assert mission.reference is not None
    begin, end = mission.span_s
    t = np.arange(np.ceil(begin) + 1.0, np.floor(end) - 1.0)
    return Run(normalised_errors(solution.trajectory, mission.reference, t), solution.innovations)


@dataclass(frozen=True)
class Outcome:
    """Averages over the runs of a case, by quantity and by sensor."""

    case: Case
    nees: Mapping[str, EnsembleConsistency]
    nis: Mapping[str, EnsembleConsistency]


def outcome(case: Case, seeds: range, workers: int) -> Outcome:
    """Run a case over seeds."""
    with ProcessPoolExecutor(max_workers=workers) as pool:
        runs = list(pool.map(partial(run, case), seeds))
    sensors = runs[0].innovations
    nis = {name: ensemble_nis([r.innovations[name] for r in runs], BIN_S) for name in sensors}
    return Outcome(case, ensemble_nees([r.errors for r in runs]), nis)


def main() -> None:
    """Print a line a quantity; write and draw them where asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.consistency", description=__doc__)
    parser.add_argument("--runs", type=int, default=50, help="missions a case")
    parser.add_argument("--case", nargs="+", help="only cases whose name contains one of these")
    parser.add_argument("--out", type=Path, help="folder for consistency.json and the plots")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes")
    arguments = parser.parse_args()
    wanted = [
        case for case in CASES if not arguments.case or any(w in case.name for w in arguments.case)
    ]
    print(f"{'case':<30} {'quantity':<16} {'mean/dof':>8}  inside 95 % bounds")
    document = []
    for case in wanted:
        found = outcome(case, range(arguments.runs), arguments.workers)
        rows = [("NEES", *item) for item in found.nees.items()]
        rows += [("NIS", *item) for item in found.nis.items()]
        for kind, name, q in rows:
            label = f"{kind} {name}"
            inside, mean = q.fraction_inside, q.mean / q.dof
            note = "" if case.promised else "  (measured, not promised)"
            print(f"{case.name:<30} {label:<16} {mean:8.2f}  {inside:.2f}{note}", flush=True)
            document.append(
                {"case": case.name, "runs": arguments.runs, "quantity": label}
                | {"mean_per_dof": mean, "fraction_inside": inside, "promised": case.promised}
            )
        if arguments.out:
            _draw(found, arguments.out)
    if arguments.out:
        text = json.dumps(document, indent=2) + "\n"
        (arguments.out / "consistency.json").write_text(text, encoding="utf-8")


def _draw(found: Outcome, out: Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    stem = found.case.name.replace(", ", "_").replace(" ", "_")
    quantities = {f"NEES_{name}": q for name, q in found.nees.items()}
    quantities |= {f"NIS_{name}": q for name, q in found.nis.items()}
    figure = plots.ensemble_figure({found.case.method: quantities})
    plots.save_png(figure, out / f"{stem}.png")


if __name__ == "__main__":
    main()
