"""Are the estimators as good as they say?

``python -m benchmarks.consistency [--runs N] [--case NAME ...] [--out FOLDER]`` runs every method
on N simulated missions. Where the noise is what the sensors' cards state (matched), NEES and NIS
averaged over the runs lie inside their 95 % chi-square bounds at 90 % of the times at least; with
everything that the simulator can do wrong (disturbed), their mean per degree of freedom lies
between 0.5 and 1.5. Beside them: how much of the errors the 1, 2 and 3 sigma bands hold, and
whether successive innovations are independent. With ``--out`` the figures are written as JSON and
drawn.

A method is held to the model that it claims (``promised``), and the suite fails where it does not
hold; others are only measured: registration has errors that no covariance of a match knows.
What does not hold is run on as many missions more, and judged over all of them: where an error is
one draw a run, as that of a heading that only the start tells, its averages lie inside at all times
or at none, and at none in one set of missions out of twenty, however good the estimator.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

import gtsam_nav as gn
from gtsam_nav.evaluation import plots
from gtsam_nav.evaluation.ensemble import (
    EnsembleConsistency,
    NormalisedErrors,
    Whiteness,
    band_coverage,
    ensemble_nees,
    ensemble_nis,
    normalised_errors,
    whiteness,
)
from gtsam_nav.mission import InitialState, Mission
from gtsam_nav.simulation.settings import SimulationSettings, StartSimulation
from gtsam_nav.solution import Innovations

BIN_S = 1.0
"""Innovations of so long a span are averaged together: that of the slowest sensor."""
START = StartSimulation(sigma_position_m=0.1, sigma_heading_deg=0.5)
LEAST_INSIDE = 0.9
"""Share of the times at which a matched average lies inside its 95 % bounds."""
DISTURBED_MEAN = (0.5, 1.5)
"""Mean per degree of freedom of a disturbed one."""


def _without(*sensors: str) -> SimulationSettings:
    return SimulationSettings.matched().model_copy(update=dict.fromkeys(sensors))


SIMULATIONS: dict[str, Callable[[], SimulationSettings]] = {
    "matched": SimulationSettings.matched,
    "matched, no IMU": partial(_without, "imu"),
    "matched, odometry alone": partial(_without, "dvl", "heading"),
    "disturbed": SimulationSettings,
}


@dataclass(frozen=True)
class Case:
    """A method on missions of one kind.

    Attributes
    ----------
    method : str
    scenario : str
    noise : str
        What the marina's sensors do wrong, by `SIMULATIONS`; another scenario has its own.
    overrides : tuple of str
        ``key=value`` settings.
    promised : bool
        Whether the method claims to know all of these errors.
    duration_s : float or None
        The scenario's own where None.
    """

    method: str
    scenario: str = "marina"
    noise: str = "matched"
    overrides: tuple[str, ...] = ()
    promised: bool = True
    duration_s: float | None = None

    @property
    def name(self) -> str:
        """For people."""
        settings = [o for o in self.overrides if not o.startswith("gnss.")]
        return ", ".join([self.scenario, self.method, self.noise, *settings])

    @property
    def is_disturbed(self) -> bool:
        """Whether the noise is beyond what the cards state."""
        return self.noise == "disturbed"

    def holds(self, found: EnsembleConsistency) -> bool:
        """Whether a quantity is as good as it says."""
        if self.is_disturbed:
            return DISTURBED_MEAN[0] <= found.mean / found.dof <= DISTURBED_MEAN[1]
        return found.fraction_inside >= LEAST_INSIDE


FIXES, NO_FIXES, NO_SONAR = ("gnss.use=all",), ("gnss.use=none",), "sonar.use=false"
CASES = (
    Case("ins-ekf", "laps"),
    Case("ins-ekf", "laps", overrides=("ins_ekf.smooth=true",)),
    Case("graph", "laps"),
    Case("ins-ekf", overrides=FIXES),
    Case("graph", overrides=FIXES),
    Case("graph", overrides=(*FIXES, NO_SONAR)),
    Case("graph", noise="matched, no IMU", overrides=FIXES),
    Case("landmark-ekf", overrides=NO_FIXES),
    Case("landmark-ekf", noise="matched, odometry alone", overrides=NO_FIXES),
    Case("dr", overrides=NO_FIXES),
    Case("scan-match", overrides=NO_FIXES, promised=False),
    Case("pose-ekf", overrides=NO_FIXES, promised=False),
    Case("kiss", "harbour", overrides=FIXES, duration_s=60.0),
    Case("ins-ekf", noise="disturbed", overrides=FIXES),
    Case("graph", noise="disturbed", overrides=FIXES),
    Case("landmark-ekf", noise="disturbed", overrides=NO_FIXES),
    Case("dr", noise="disturbed", overrides=NO_FIXES),
    Case("scan-match", noise="disturbed", overrides=NO_FIXES, promised=False),
    Case("pose-ekf", noise="disturbed", overrides=NO_FIXES, promised=False),
)


@dataclass(frozen=True)
class Run:
    """What one run says of itself."""

    errors: NormalisedErrors
    innovations: Mapping[str, Innovations]


def run(case: Case, duration_s: float | None, seed: int) -> Run:
    """One mission of a case."""
    mission = _simulated(case.scenario, case.noise, duration_s or case.duration_s, seed)
    if case.scenario == "marina" and "gnss.use=none" not in case.overrides:
        mission = replace(mission, initial=InitialState())
    solution = gn.estimate(mission, case.method, gn.load_config(None, case.overrides))
    assert mission.reference is not None
    begin, end = mission.span_s
    t = np.arange(np.ceil(begin) + 1.0, np.floor(end) - 1.0)
    return Run(normalised_errors(solution.trajectory, mission.reference, t), solution.innovations)


@lru_cache(maxsize=1)
def _simulated(scenario: str, noise: str, duration_s: float | None, seed: int) -> Mission:
    """A mission, which cases that differ in nothing else have one after the other."""
    settings = None
    if scenario == "marina":
        # without fixes the start must be stated: errors in a local frame say nothing
        settings = SIMULATIONS[noise]().model_copy(update={"start": START})
    return gn.simulate(scenario, seed=seed, duration_s=duration_s, settings=settings)


@dataclass(frozen=True)
class Outcome:
    """Averages over the runs of a case, by quantity and by sensor."""

    case: Case
    runs: int
    nees: Mapping[str, EnsembleConsistency]
    bands: Mapping[str, tuple[float, ...]]
    nis: Mapping[str, EnsembleConsistency]
    white: Mapping[str, Whiteness | None]

    @property
    def holds(self) -> bool:
        """Whether every quantity does."""
        return all(self.case.holds(found) for found in (*self.nees.values(), *self.nis.values()))

    def rows(self) -> list[dict[str, Any]]:
        """A row a quantity and a sensor."""
        named = [("NEES", *item) for item in self.nees.items()]
        named += [("NIS", *item) for item in self.nis.items()]
        return [self._row(kind, name, found) for kind, name, found in named]

    def _row(self, kind: str, name: str, found: EnsembleConsistency) -> dict[str, Any]:
        row: dict[str, Any] = {
            "case": self.case.name,
            "runs": self.runs,
            "quantity": f"{kind} {name}",
            "mean_per_dof": found.mean / found.dof,
            "fraction_inside": found.fraction_inside,
            "holds": self.case.holds(found),
            "promised": self.case.promised,
        }
        if kind == "NEES":
            return row | {"within_1_2_3_sigma": self.bands[name]}
        white = self.white[name]
        if white is None:
            return row
        return row | {"autocorrelation": white.autocorrelation, "white": white.fraction_inside}


def outcome(case: Case, seeds: range, workers: int, duration_s: float | None = None) -> Outcome:
    """Run a case over seeds."""
    return averaged(case, ensembles([case], seeds, workers, duration_s)[0])


def ensembles(
    cases: Sequence[Case], seeds: range, workers: int, duration_s: float | None = None
) -> list[list[Run]]:
    """The runs of each case over seeds; all cases have a seed's mission together."""
    with ProcessPoolExecutor(max_workers=workers) as pool:
        by_seed = list(pool.map(partial(_runs, cases, duration_s), seeds))
    return [list(runs) for runs in zip(*by_seed, strict=True)]


def _runs(cases: Sequence[Case], duration_s: float | None, seed: int) -> list[Run]:
    return [run(case, duration_s, seed) for case in cases]


def averaged(case: Case, runs: Sequence[Run]) -> Outcome:
    """Average the runs of a case."""
    errors = [r.errors for r in runs]
    by_sensor = {
        name: [r.innovations[name] for r in runs if name in r.innovations]
        for name in runs[0].innovations
    }
    return Outcome(
        case,
        len(runs),
        ensemble_nees(errors),
        band_coverage(errors),
        {name: ensemble_nis(found, BIN_S) for name, found in by_sensor.items()},
        {name: whiteness(found) for name, found in by_sensor.items()},
    )


def judged(cases: Sequence[Case], runs: int, workers: int) -> Iterator[list[Outcome]]:
    """Of each case what was found, and beside it over twice the runs where it does not hold."""
    for case, few in zip(cases, ensembles(cases, range(runs), workers), strict=True):
        found = averaged(case, few)
        if not case.promised or found.holds:
            yield [found]
            continue
        more = ensembles([case], range(runs, 2 * runs), workers)[0]
        yield [found, averaged(case, [*few, *more])]


def main() -> None:
    """Print a line a quantity; write and draw them where asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.consistency", description=__doc__)
    parser.add_argument("--runs", type=int, default=100, help="missions a case")
    parser.add_argument("--case", nargs="+", help="only cases whose name contains one of these")
    parser.add_argument("--out", type=Path, help="folder for consistency.json and the plots")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes")
    arguments = parser.parse_args()
    parts = arguments.case or [""]
    for part in parts:
        if not any(part in case.name for case in CASES):
            choices = "; ".join(case.name for case in CASES)
            parser.error(f"no case's name contains '{part}'; the cases are: {choices}")
    wanted = [case for case in CASES if any(part in case.name for part in parts)]
    by_mission: dict[tuple[str, str, float | None], list[Case]] = {}
    for case in wanted:
        by_mission.setdefault((case.scenario, case.noise, case.duration_s), []).append(case)
    document: list[dict[str, Any]] = []
    broken: list[dict[str, Any]] = []
    for cases in by_mission.values():
        for found in judged(cases, arguments.runs, arguments.workers):
            for each in found:
                document += _told(each, arguments.out)
            broken += [row for row in found[-1].rows() if row["promised"] and not row["holds"]]
    if arguments.out:
        text = json.dumps(document, indent=2) + "\n"
        (arguments.out / "consistency.json").write_text(text, encoding="utf-8")
    for row in broken:
        print(f"does not hold: {row['case']}: {row['quantity']}")
    sys.exit(bool(broken))


def _told(found: Outcome, out: Path | None) -> list[dict[str, Any]]:
    """The rows of an outcome, printed, and drawn where asked."""
    note = "" if found.case.promised else " (measured, not promised)"
    print(f"\n{found.case.name}, {found.runs} runs{note}", flush=True)
    rows = found.rows()
    _print(rows)
    if out:
        _draw(found, out)
    return rows


def _print(rows: Sequence[Mapping[str, Any]]) -> None:
    for row in rows:
        beside = ""
        if "within_1_2_3_sigma" in row:
            beside = "within 1 2 3 sigma " + " ".join(f"{s:.3f}" for s in row["within_1_2_3_sigma"])
        if "white" in row:
            beside = f"autocorrelation {row['autocorrelation']:+.3f}, {row['white']:.2f} white"
        print(
            f"  {row['quantity']:<20} {row['mean_per_dof']:6.2f} per dof"
            f"  inside {row['fraction_inside']:.2f}  {'yes' if row['holds'] else 'NO':<3}"
            f"  {beside}",
            flush=True,
        )


def _draw(found: Outcome, out: Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    stem = f"{found.case.name}, {found.runs}".replace(", ", "_").replace(" ", "_")
    quantities = {f"NEES_{name}": q for name, q in found.nees.items()}
    quantities |= {f"NIS_{name}": q for name, q in found.nis.items()}
    figure = plots.ensemble_figure({found.case.method: quantities})
    plots.save_png(figure, out / f"{stem}.png")


if __name__ == "__main__":
    main()
