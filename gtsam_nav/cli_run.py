"""The commands ``run`` and ``compare``: missions estimated, and finished runs side by side."""

from __future__ import annotations

import logging
import shlex
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gtsam_nav.cli_options import (
    ConfigOption,
    JsonOption,
    MethodOption,
    MissionArgument,
    QuietOption,
    SetOption,
)
from gtsam_nav.errors import DataError, EstimationError, GtsamNavError
from gtsam_nav.terminal import progress_bars, say, show, show_json

if TYPE_CHECKING:
    from gtsam_nav.config import Config
    from gtsam_nav.mission import Mission
    from gtsam_nav.simulation import Fault
    from gtsam_nav.solution import Progress, Solution

logger = logging.getLogger(__name__)

OutOption = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Results; out/MISSION where not given.")
]
StartOption = Annotated[
    float, typer.Option(metavar="S", show_default=False, help="Leave out what was before.")
]
StopOption = Annotated[
    float, typer.Option(metavar="S", show_default=False, help="Leave out from here on.")
]
InjectOption = Annotated[
    list[str],
    typer.Option(
        "--inject",
        metavar="FAULT",
        help="Spoil what the methods see, as in gnss:outliers=0.3 or dvl:drop=300:420; repeatable.",
    ),
]


def run(
    mission: MissionArgument,
    method: MethodOption = ["graph"],  # noqa: B006
    out: OutOption = None,
    config: ConfigOption = None,
    overrides: SetOption = [],  # noqa: B006
    start: StartOption = -inf,
    stop: StopOption = inf,
    inject: InjectOption = [],  # noqa: B006
    quiet: QuietOption = False,
) -> None:
    """Estimate a mission, score it and write a report."""
    from gtsam_nav.audit import with_alerts
    from gtsam_nav.cards import with_mission
    from gtsam_nav.config import load_config
    from gtsam_nav.evaluation.report import write_report
    from gtsam_nav.methods import check_faults, check_method
    from gtsam_nav.simulation import parse_fault
    from gtsam_nav.writers.run_folder import find_runs, settled_output

    resolved = load_config(config, overrides)
    names = list(dict.fromkeys(method))
    faults = [parse_fault(spec) for spec in inject]
    for name in names:
        check_method(name)
        check_faults(name, faults)
    folder = out or Path("out") / mission.resolve().name
    places = [folder / name for name in names]
    with settled_output(folder, *places), progress_bars(quiet) as progress:
        begin = time.perf_counter()
        opened = with_alerts(open_cropped(mission, start, stop, progress, with_mission(config)))
        solutions, failures = estimate_each(
            opened, names, resolved, faults, folder, begin, progress
        )
        wall_s = time.perf_counter() - begin
        report = write_report(solutions, folder, resolved) if solutions else None
    if report is not None:
        show_runs({solution.method: folder / solution.method for solution in solutions})
        show("", f"{wall_s:.1f} s from opening the mission to the last result", f"report: {report}")
        tell_hints(solutions, resolved)
        beside = (found for found in find_runs(folder) if found.parent == folder)
        earlier = [found.name for found in beside if found.name not in names]
        if earlier:
            say(f"note: {folder} also holds an earlier run of {', '.join(earlier)}")
    if not solutions:  # else they are among the warnings of the runs
        for warning in opened.warnings:
            say(f"warning: {warning}")
    for name, error in failures.items():
        say(f"error: {name}: {error}")
    if failures:
        raise typer.Exit(max(error.exit_code for error in failures.values()))


def tell_hints(solutions: Sequence[Solution], config: Config) -> None:
    """Say which trajectories seem to be in other axes than what they are scored on."""
    from gtsam_nav.evaluation.frame_hint import frame_hint
    from gtsam_nav.evaluation.metrics import reference_series

    for solution in solutions:
        truth = solution.reference
        if truth is not None:
            hint = frame_hint(
                solution.trajectory,
                reference_series(truth),
                truth.xyz_b,
                config.evaluation.window_s,
                georeferenced=solution.georeferenced,
            )
            if hint is not None:
                say(f"hint: {solution.method}: {hint}; or its reference is")


def compare(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="DIR/METHOD, or DIR for all in it.")
    ],
    as_json: JsonOption = False,
) -> None:
    """Put finished runs side by side."""
    from gtsam_nav.writers.run_folder import find_runs

    show_runs({str(folder): folder for path in runs for folder in find_runs(path)}, as_json)


def open_cropped(
    path: Path, start_s: float, stop_s: float, progress: Progress, card: Path | None = None
) -> Mission:
    """Open a mission and keep the samples of start <= t < stop.

    Raises
    ------
    DataError
        Where nothing is left.
    """
    from gtsam_nav.readers import open_mission

    opened = open_mission(path, progress, card)
    cropped = opened.crop(start_s, stop_s)
    holds = any(len(sensor.series) for sensor in cropped.sensors.values())
    if not holds and cropped.edges is None:
        first, last = opened.span_s
        raise DataError(
            f"no sample between {start_s:g} and {stop_s:g} s; "
            f"the mission spans {first:.1f} to {last:.1f} s",
            path,
        )
    return cropped


def estimate_each(
    mission: Mission,
    methods: Sequence[str],
    config: Config,
    faults: Sequence[Fault],
    folder: Path,
    begin: float,
    progress: Progress,
) -> tuple[list[Solution], dict[str, GtsamNavError]]:
    """Run the methods one after the other; each is written as it ends, failures are kept.

    A method's wall time is that of opening the mission (since ``begin``) and its own.
    """
    from gtsam_nav.methods import estimate
    from gtsam_nav.writers.run_folder import write_run

    opening_s = time.perf_counter() - begin
    command = shlex.join(["gtsam-nav", *sys.argv[1:]])
    solutions: list[Solution] = []
    failures: dict[str, GtsamNavError] = {}
    for name in methods:
        started = time.perf_counter()
        try:
            solution = estimate(mission, name, config, progress, faults)
            wall_s = opening_s + time.perf_counter() - started
            write_run(solution, config, folder, wall_s=wall_s, command=command)
        except (DataError, EstimationError) as error:
            logger.debug("%s failed", name, exc_info=error)
            failures[name] = error
        else:
            solutions.append(solution)
    return solutions, failures


def show_runs(folders: Mapping[str, Path], as_json: bool = False) -> None:
    """Finished runs side by side under the names given, and what the user must hear of them."""
    from gtsam_nav.evaluation.comparison import comparison_row
    from gtsam_nav.evaluation.metrics import WHY_NONE
    from gtsam_nav.writers.run_folder import read_run

    runs = {name: read_run(folder) for name, folder in folders.items()}
    rows = [comparison_row(name, run.metrics, run.record.wall_s) for name, run in runs.items()]
    if as_json:
        show_json([asdict(row) for row in rows])
    else:
        from gtsam_nav.tables import comparison_tables

        show(*comparison_tables(rows))
    concerned: dict[str, list[str]] = {}
    for row in rows:
        for fault in runs[row.name].record.faults:
            concerned.setdefault(f"injected {fault}", []).append(row.name)
        for warning in runs[row.name].record.warnings:
            concerned.setdefault(warning, []).append(row.name)
        nees = runs[row.name].metrics.nees
        if nees is not None and nees.doubt:
            concerned.setdefault(f"NEES {nees.mean:.1f}: {nees.doubt}", []).append(row.name)
        if row.coverage is None and row.relations is None:
            used = runs[row.name].metrics.gnss_used
            why = (
                f": the method used all {used} fixes, and gnss.use withheld none (with"
                " --set gnss.use=every_k it keeps most of them for scoring)"
            ) * (used > 0)
            concerned.setdefault(f"no score: nothing to score on{why}", []).append(row.name)
        elif row.failed:
            failed = f"failed: covers only {row.coverage:.1%} of the reference"
            concerned.setdefault(failed, []).append(row.name)
        ate = runs[row.name].metrics.ate
        if ate.se2 is not None and ate.none is None:
            why = f"no error without alignment: {WHY_NONE['none']}"
            concerned.setdefault(why, []).append(row.name)
    for warning, names in concerned.items():
        say(f"warning: {', '.join(names)}: {warning}")
