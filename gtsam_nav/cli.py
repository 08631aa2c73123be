"""The command line: what it can do, and which exit code an error gets."""

from __future__ import annotations

import logging
import shlex
import signal
import sys
import time
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gtsam_nav.cli_batch import batch
from gtsam_nav.cli_export import export
from gtsam_nav.cli_options import (
    ConfigOption,
    ForceOption,
    FrameOption,
    JsonOption,
    MethodOption,
    QuietOption,
    SetOption,
    complete_frame,
    complete_scenario,
)
from gtsam_nav.cli_rerun import rerun
from gtsam_nav.errors import ConfigError, DataError, EstimationError, GtsamNavError
from gtsam_nav.terminal import progress_bars, say, show, show_json

if TYPE_CHECKING:
    from gtsam_nav.config import Config
    from gtsam_nav.mission import Mission
    from gtsam_nav.simulation import Fault
    from gtsam_nav.solution import Progress, Solution

logger = logging.getLogger(__name__)

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Offline factor-graph navigation and sonar SLAM for marine vehicles.",
)
config_app = typer.Typer(no_args_is_help=True, help="The configuration.")
app.add_typer(config_app, name="config")
for command in (batch, export, rerun):
    app.command()(command)

MissionArgument = Annotated[Path, typer.Argument(metavar="MISSION", help="Mission folder or logs.")]
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


@app.callback()
def settle_logging(
    debug: Annotated[
        bool, typer.Option("--debug", help="Log more, and show the traceback of errors.")
    ] = False,
) -> None:
    """Options that stand before or after any command."""
    logging.basicConfig(format="%(levelname)s %(name)s: %(message)s")
    logging.getLogger("gtsam_nav").setLevel(logging.DEBUG if debug else logging.ERROR)


def main() -> None:
    """Run the command line; errors become one line on stderr and an exit code."""
    # a batch system's request to end unwinds like Ctrl-C, so that no draft stays behind
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    # --debug belongs to the program, wherever it was typed
    arguments = sorted(sys.argv[1:], key=lambda argument: argument != "--debug")
    debug = "--debug" in arguments
    try:
        app(arguments, prog_name="gtsam-nav")
    except GtsamNavError as error:
        if debug:
            traceback.print_exc()
        say(f"error: {error}")
        sys.exit(error.exit_code)
    except Exception as error:  # noqa: BLE001
        if debug:
            traceback.print_exc()
        summary = " ".join(f"{type(error).__name__}: {error}".split())
        say(f"internal error: {summary} (use --debug for the traceback)")
        sys.exit(1)


@app.command()
def inspect(
    mission: MissionArgument,
    config: ConfigOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Check rates, gaps, clocks, units and signs of a mission; list a bag and print its card."""
    from gtsam_nav.audit import audit
    from gtsam_nav.config import checked_card
    from gtsam_nav.readers import describe, open_mission
    from gtsam_nav.tables import finding_table, sensor_table, stream_table

    card = checked_card(config)
    contents = describe(mission, card)
    if contents is not None and not as_json:
        show(stream_table(contents), "")
    with progress_bars(quiet) as progress:
        found = audit(open_mission(mission, progress, card))
    if as_json:
        listed = None if contents is None else asdict(contents)
        show_json({**found.to_json(), "contents": listed})
        return

    rest = f", at rest for at least the first {found.rest_s:.0f} s" if found.rest_s else ""
    show(
        sensor_table(found),
        "",
    )
    if found.findings:
        show(finding_table(found.findings), "")
    show(
        f"span {found.span_s[0]:.1f} to {found.span_s[1]:.1f} s{rest}",
        f"methods that can run: {', '.join(found.methods) or 'none'}",
    )
    if contents is not None:
        show("", "card for run MISSION -c FILE:", "", contents.card)
    for warning in found.warnings:
        say(f"warning: {warning}")


@app.command()
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
    from gtsam_nav.methods import check_method
    from gtsam_nav.simulation import parse_fault
    from gtsam_nav.writers.run_folder import find_runs, settle_output

    resolved = load_config(config, overrides)
    names = list(dict.fromkeys(method))
    for name in names:
        check_method(name)
    faults = [parse_fault(spec) for spec in inject]
    folder = out or Path("out") / mission.resolve().name
    settle_output(folder, *(folder / name for name in names))
    with progress_bars(quiet) as progress:
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
        earlier = [found.name for found in find_runs(folder) if found.name not in names]
        if earlier:
            say(f"note: {folder} also holds an earlier run of {', '.join(earlier)}")
    if not solutions:  # else they are among the warnings of the runs
        for warning in opened.warnings:
            say(f"warning: {warning}")
    for name, error in failures.items():
        say(f"error: {name}: {error}")
    if failures:
        raise typer.Exit(max(error.exit_code for error in failures.values()))


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
    if not any(len(sensor.series) for sensor in cropped.sensors.values()):
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
        if row.coverage is None and row.relations is None:
            concerned.setdefault("no score: nothing to score on", []).append(row.name)
        elif row.failed:
            failed = f"failed: covers only {row.coverage:.1%} of the reference"
            concerned.setdefault(failed, []).append(row.name)
    for warning, names in concerned.items():
        say(f"warning: {', '.join(names)}: {warning}")


@app.command()
def compare(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="DIR/METHOD, or DIR for all in it.")
    ],
    as_json: JsonOption = False,
) -> None:
    """Put finished runs side by side."""
    from gtsam_nav.writers.run_folder import find_runs

    show_runs({str(folder): folder for path in runs for folder in find_runs(path)}, as_json)


@app.command()
def evaluate(
    trajectory: Annotated[Path, typer.Argument(metavar="TRAJECTORY", help=".tum, .kitti or .csv.")],
    reference: Annotated[Path, typer.Argument(metavar="REFERENCE", help="Such, or a mission.")],
    lever_arm: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="Reference's antenna in the body, m.")
    ] = None,
    window: Annotated[
        str | None, typer.Option(metavar="FROM,TO", help="Score this span of time only, s.")
    ] = None,
    frame: FrameOption = "ned",
    reference_frame: Annotated[
        str | None,
        typer.Option(
            metavar="FRAME",
            help="Axes of the reference; those of --frame where not given.",
            autocompletion=complete_frame,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Score a trajectory against a reference."""
    from gtsam_nav.config import load_config
    from gtsam_nav.evaluation.metrics import evaluate_trajectory, reference_series
    from gtsam_nav.evaluation.references import open_reference
    from gtsam_nav.writers.frame import frame_named
    from gtsam_nav.writers.run_record import read_record
    from gtsam_nav.writers.trajectories import read_trajectory

    lever_b = None if lever_arm is None else numbers("--lever-arm", lever_arm, 3)
    window_s = None if window is None else numbers("--window", window, 2)
    # a run's own files say which fixes it saw, what it scored and whether it knew where it was
    beside, record = trajectory.with_name("config.yaml"), trajectory.with_name("run.json")
    config = load_config(beside if beside.is_file() else None)
    estimated = read_trajectory(trajectory, frame_named(frame))
    truth = open_reference(reference, config.gnss, frame=frame_named(reference_frame or frame))
    scored = config.evaluation.window_s if window_s is None else (window_s[0], window_s[1])
    scores = evaluate_trajectory(
        estimated,
        reference_series(truth),
        truth.xyz_b if lever_b is None else lever_b,
        scored,
        georeferenced=read_record(record).georeferenced if record.is_file() else True,
    )
    if as_json:
        show_json(scores.to_json())
    else:
        show(f"{trajectory} against {truth.name} of {reference}", str(scores))


def numbers(option: str, text: str, count: int) -> list[float]:
    """Numbers that are separated by commas."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count:
        example = ",".join(["0"] * count)
        raise ConfigError(f"{option} is '{text}'; it needs {count} numbers, as in {example}")
    return values


@app.command()
def simulate(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help="marina, laps, ranger, submarine or harbour.",
            autocompletion=complete_scenario,
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Mission folder to write.")],
    seed: Annotated[int, typer.Option(metavar="N", help="Same seed, same mission.")] = 0,
    duration: Annotated[
        float | None, typer.Option(metavar="S", help="Length; the scenario's own where not given.")
    ] = None,
    force: ForceOption = False,
) -> None:
    """Write a simulated mission as a mission folder."""
    from gtsam_nav.simulation import simulate as simulated
    from gtsam_nav.writers.mission_folder import check_free, write_mission
    from gtsam_nav.writers.run_folder import settle_output

    check_free(out, force)
    settle_output(out.parent)
    mission = simulated(name, seed, duration)
    write_mission(mission, out)
    start, stop = mission.span_s
    show(f"mission '{mission.name}', {stop - start:.1f} s: {out}")


@app.command()
def convert(
    mission: MissionArgument,
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Mission folder to write.")],
    config: ConfigOption = None,
    force: ForceOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write a mission of any format as a mission folder."""
    from gtsam_nav.config import checked_card
    from gtsam_nav.readers import open_mission
    from gtsam_nav.writers.mission_folder import check_free, write_mission
    from gtsam_nav.writers.run_folder import settle_output

    card = checked_card(config)
    check_free(out, force)
    settle_output(out.parent)
    with progress_bars(quiet) as progress:
        opened = open_mission(mission, progress, card)
    write_mission(opened, out)
    start, stop = opened.span_s
    show(f"mission '{opened.name}', {stop - start:.1f} s: {out}")
    for (sensor, reason), n in opened.dropped.items():
        show(f"dropped: {sensor}: {n} x {reason}")
    for warning in opened.warnings:
        say(f"warning: {warning}")


@config_app.command("dump")
def config_dump(config: ConfigOption = None, overrides: SetOption = []) -> None:  # noqa: B006
    """Print the whole configuration with its values."""
    from gtsam_nav.config import load_config

    typer.echo(load_config(config, overrides).to_yaml(), nl=False)


@app.command()
def doctor() -> None:
    """Say which versions are installed and what is missing."""
    from gtsam_nav import __version__
    from gtsam_nav.doctor import examine, interpreter
    from gtsam_nav.tables import package_table

    packages = examine()
    show(f"gtsam-nav {__version__}", interpreter(), "", package_table(packages))
    missing = [p.name for p in packages if p.trouble is not None and not p.optional]
    if missing:
        raise GtsamNavError(f"cannot import {', '.join(missing)}; reinstall with pip")
