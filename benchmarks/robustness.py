"""What faults do to the graph: ``python -m benchmarks.robustness``.

Each fault is injected into the simulated marina and, with ``--stpere PATH``, into the St. Pere logs
(simulated sonar); the error is compared with that of the clean run of the same case. Figures with a
target say whether they are within it. The control shows that the test bites: the same outliers
without kernel and gate. ``--only WORD`` picks rows, ``--json FILE`` writes all figures.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

import gtsam_nav as gn
from gtsam_nav.errors import ConfigError, GtsamNavError

GAUSSIAN = ("graph.robust.gnss.kernel=none", "graph.robust.gnss.gate_probability=null")
UNREFINED = ("graph.refinement.max_iterations=0",)
GNC = ("graph.loops.arbiter=gnc",)
UNCHECKED = "graph.loops.consistency_probability=null"
LEAST_SQUARES = "graph.robust.loops.kernel=none"


@dataclass(frozen=True)
class Case:
    """A way to run a mission, of which the clean run is the standard.

    Attributes
    ----------
    name : str
    overrides : tuple of str
    alignment : {"none", "se2"}
        Under which the mean error is compared.
    """

    name: str
    overrides: tuple[str, ...]
    alignment: str


@dataclass(frozen=True)
class Row:
    """A fault in a case.

    Attributes
    ----------
    case : Case
    fault : str
        Empty for the clean run.
    variant, overrides : str, tuple of str
        What is different from the case, for a comparison or a control.
    at_most, at_least : float or None
        Target of the ratio to the clean run's error.
    """

    case: Case
    fault: str = ""
    variant: str = ""
    overrides: tuple[str, ...] = ()
    at_most: float | None = None
    at_least: float | None = None


@dataclass(frozen=True)
class Outcome:
    """Figures of a row; what cannot be told is None.

    ``error_m`` is the mean horizontal error, ``ratio`` over the clean run's; ``within`` says
    whether the target, if there is one, is met.
    """

    mission: str
    case: str
    fault: str
    variant: str
    overrides: tuple[str, ...]
    error_m: float | None
    ratio: float | None
    target: str
    within: bool | None
    nees: float | None
    gnss_used: int | None
    loops: str
    warnings: tuple[str, ...]
    wall_s: float
    failure: str = ""


def rows(stpere: bool) -> Iterator[Row]:
    """The matrix of faults."""
    sparse = Case("one fix in 30 s", ("gnss.use=every_k", "gnss.every_k=30"), "none")
    start_s = 300 if stpere else 120
    window = Case(
        f"fixes of {start_s} s", ("gnss.use=window", f"gnss.window_s=[0,{start_s}]"), "se2"
    )
    graph_only = Case(f"{window.name}, not refined", (*window.overrides, *UNREFINED), "se2")
    yield Row(sparse)
    # the marina has twenty fixes: there the loss of half of them already counts
    limits = {0.3: 1.2, 0.5: 1.5} if stpere else {0.3: None, 0.5: None}
    for extra in ("", ",burst=5", ",burst=5,coherent"):
        for share, limit in limits.items():
            yield Row(sparse, f"gnss:outliers={share},size=20:100{extra}", at_most=limit)
    yield Row(sparse, "gnss:outliers=0.3,size=20:100", "least squares", GAUSSIAN, at_least=5.0)
    for fault in ("clock:gnss=+0.5", "clock:dvl=+0.5", "clock:imu=+0.3"):
        yield Row(sparse, fault)
    for case in (window, graph_only):
        yield Row(case)
        yield Row(case, "loops:false=0.5", at_most=1.3)
        yield Row(case, "loops:false=0.2,group=10", at_most=1.3)
    for fault in ("loops:false=0.5", "loops:false=0.2,group=10"):
        yield Row(graph_only, fault, "consistency, then GNC", GNC, at_most=1.3)
        yield Row(graph_only, fault, "GNC alone", (*GNC, UNCHECKED), at_most=1.3)
        yield Row(graph_only, fault, "Cauchy alone", (UNCHECKED,))
    yield Row(graph_only, "loops:false=0.5", "least squares", (UNCHECKED, LEAST_SQUARES))
    for fault in (
        "dvl:drop=300:420",
        "sonar:drop=300:420",
        "sonar:drop=0.5",
        "heading:bias=15@300:600",
        "imu:gap=300:310",
    ):
        yield Row(window, fault)


def run(mission: gn.Mission, row: Row, scored: tuple[str, ...], clean_m: float | None) -> Outcome:
    """Estimate and score one row against the clean run's error."""
    config = gn.load_config(None, (*scored, *row.case.overrides, *row.overrides))
    begin = time.perf_counter()
    try:
        faults = (row.fault,) if row.fault else ()
        solution = gn.estimate(mission, "graph", config, faults=faults)
    except ConfigError:
        raise
    except GtsamNavError as error:
        return _outcome(mission, row, clean_m, time.perf_counter() - begin, failure=str(error))
    wall_s = time.perf_counter() - begin
    return _outcome(mission, row, clean_m, wall_s, solution, config)


def _outcome(
    mission: gn.Mission,
    row: Row,
    clean_m: float | None,
    wall_s: float,
    solution: gn.Solution | None = None,
    config: gn.Config | None = None,
    failure: str = "",
) -> Outcome:
    error_m, nees, loops = None, None, ""
    if solution is not None and config is not None:
        metrics = gn.evaluate(solution, window_s=config.evaluation.window_s)
        aligned = getattr(metrics.ate, row.case.alignment)
        error_m, nees = aligned and aligned.mean, metrics.nees and metrics.nees.mean
        loops = _loops(solution)
    ratio = error_m / clean_m if error_m is not None and clean_m else None
    return Outcome(
        mission=mission.name,
        case=row.case.name,
        fault=row.fault or "clean",
        variant=row.variant,
        overrides=(*row.case.overrides, *row.overrides),
        error_m=error_m,
        ratio=ratio,
        target=_target(row),
        within=_within(row, ratio),
        nees=nees,
        gnss_used=solution and solution.gnss_used,
        loops=loops,
        warnings=solution.warnings if solution else (),
        wall_s=wall_s,
        failure=failure,
    )


def _target(row: Row) -> str:
    if row.at_most is not None:
        return f"<= {row.at_most:g}"
    return "" if row.at_least is None else f">= {row.at_least:g}"


def _within(row: Row, ratio: float | None) -> bool | None:
    if row.at_most is None and row.at_least is None:
        return None
    if ratio is None:
        return False
    return ratio <= row.at_most if row.at_most is not None else ratio >= (row.at_least or 0.0)


def _loops(solution: gn.Solution) -> str:
    """True closures accepted of all, and false ones."""
    counts = []
    for injected in (False, True):
        own = [x for x in solution.loops if x.reason.startswith("injected") == injected]
        if own:
            believed = sum(x.verdict == "accepted" for x in own)
            counts.append(f"{'false' if injected else 'true'} {believed}/{len(own)}")
    return " ".join(counts)


HEADER = f"{'mission':<12} {'case':<28} {'fault':<50} {'error m':>8} {'ratio':>7}  target"


def show(o: Outcome) -> None:
    """Print one row."""
    error = "-" if o.error_m is None else f"{o.error_m:.3f}"
    ratio = "-" if o.ratio is None else f"{o.ratio:.2f}"
    verdict = "" if o.within is None else ("met" if o.within else "MISSED")
    nees = "" if o.nees is None else f"NEES {o.nees:.1f}"
    fault = f"{o.fault} ({o.variant})" if o.variant else o.fault
    notes = "  ".join(piece for piece in (verdict, nees, o.loops, o.failure) if piece)
    print(
        f"{o.mission:<12.12} {o.case:<28} {fault:<50} {error:>8} {ratio:>7}  {o.target:<7}"
        f" {notes}  {o.wall_s:.0f} s",
        flush=True,
    )


def matrix(mission: gn.Mission, stpere: bool, only: str) -> Iterator[Outcome]:
    """All rows whose case or fault contains a word, each against its case's clean run."""
    scored = ("evaluation.window_s=[0,3020]",) if stpere else ()

    @cache
    def clean(case: Case) -> Outcome:
        return run(mission, Row(case), scored, None)

    for row in rows(stpere):
        if only not in f"{row.case.name} {row.fault} {row.variant}":
            continue
        standard = clean(row.case)
        yield run(mission, row, scored, standard.error_m) if row.fault else standard


def main() -> None:
    """Print the matrix as the runs end, and write it as JSON where asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.robustness", description=__doc__)
    parser.add_argument("--stpere", type=Path, help="folder of the St. Pere logs")
    parser.add_argument("--seed", type=int, default=1, help="of the simulated marina")
    parser.add_argument("--only", default="", help="rows whose case or fault contains this")
    parser.add_argument("--json", type=Path, help="write the figures here")
    arguments = parser.parse_args()
    print(HEADER)
    outcomes = []
    missions = [(gn.simulate("marina", seed=arguments.seed), False)]
    if arguments.stpere:
        missions.append((gn.open_mission(arguments.stpere), True))
    for mission, stpere in missions:
        for outcome in matrix(mission, stpere, arguments.only):
            show(outcome)
            outcomes.append(outcome)
    missed = [o for o in outcomes if o.within is False]
    print(f"{len(missed)} of {sum(o.within is not None for o in outcomes)} targets missed")
    if arguments.json:
        document = [asdict(o) for o in outcomes]
        arguments.json.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
