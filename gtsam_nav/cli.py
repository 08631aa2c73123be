"""The command line: what it can do, and which exit code an error gets."""

from __future__ import annotations

import logging
import signal
import sys
import traceback
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from gtsam_nav.cli_batch import batch
from gtsam_nav.cli_evaluate import evaluate
from gtsam_nav.cli_export import export
from gtsam_nav.cli_options import (
    ConfigOption,
    ForceOption,
    JsonOption,
    MissionArgument,
    QuietOption,
    SetOption,
    complete_scenario,
)
from gtsam_nav.cli_rerun import rerun
from gtsam_nav.cli_run import compare, run
from gtsam_nav.errors import GtsamNavError
from gtsam_nav.terminal import progress_bars, say, show, show_json

NO_METHOD = "none: each needs a DVL with valid samples, odometry, an IMU, 3-D clouds or edges"

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Offline factor-graph navigation and sonar SLAM for marine vehicles.",
)
config_app = typer.Typer(no_args_is_help=True, help="The configuration.")
app.add_typer(config_app, name="config")


def _tell_version(wanted: bool) -> None:
    if wanted:
        from gtsam_nav import __version__

        show(f"gtsam-nav {__version__}")
        raise typer.Exit


@app.callback()
def settle_logging(
    version: Annotated[  # noqa: ARG001
        bool,
        typer.Option("--version", is_eager=True, callback=_tell_version, help="Tell it and exit."),
    ] = False,
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
        if isinstance(error.__cause__, KeyboardInterrupt | SystemExit):
            # a signal that came while compiled code ran
            sys.exit(getattr(error.__cause__, "code", 130))
        if debug:
            traceback.print_exc()
        summary = " ".join(f"{type(error).__name__}: {error}".split())
        say(f"internal error: {summary} (use --debug for the traceback)")
        sys.exit(1)


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
    if found.sensors:
        show(sensor_table(found), "")
    if found.findings:
        show(finding_table(found.findings), "")
    if found.edges:
        more = f"; {found.edges_left_out} more left out" if found.edges_left_out else ""
        show(f"{found.edges} edges of a pose graph, {found.loops} of which close loops{more}")
    show(
        f"span {found.span_s[0]:.1f} to {found.span_s[1]:.1f} s{rest}",
        f"methods that can run: {', '.join(found.methods) or NO_METHOD}",
    )
    if contents is not None:
        show("", "card for run MISSION -c FILE:", "", contents.card)
    for warning in found.warnings:
        say(f"warning: {warning}")


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
    quiet: QuietOption = False,
) -> None:
    """Write a simulated mission as a mission folder."""
    from gtsam_nav.simulation import simulate as simulated
    from gtsam_nav.writers.mission_folder import check_free, write_mission
    from gtsam_nav.writers.run_folder import settled_output

    check_free(out, force)
    with settled_output(out.parent), progress_bars(quiet) as progress:
        progress("simulate", 0.0)
        mission = simulated(name, seed, duration)
        progress("simulate", 1.0)
        progress("write", 0.0)
        write_mission(mission, out)
    start, stop = mission.span_s
    show(f"mission '{mission.name}', {stop - start:.1f} s: {out}")


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
    from gtsam_nav.writers.mission_folder import check_free, unwritten, write_mission
    from gtsam_nav.writers.run_folder import settled_output

    card = checked_card(config)
    check_free(out, force)
    with settled_output(out.parent):
        with progress_bars(quiet) as progress:
            opened = open_mission(mission, progress, card)
        write_mission(opened, out)
    start, stop = opened.span_s
    show(f"mission '{opened.name}', {stop - start:.1f} s: {out}")
    for (sensor, reason), n in opened.dropped.items():
        show(f"dropped: {sensor}: {n} x {reason}")
    for warning in (*opened.warnings, *unwritten(opened)):
        say(f"warning: {warning}")


@config_app.command("dump")
def config_dump(config: ConfigOption = None, overrides: SetOption = []) -> None:  # noqa: B006
    """Print the whole configuration with its values."""
    from gtsam_nav.config import load_config

    typer.echo(load_config(config, overrides).to_yaml(), nl=False)


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


for command in (
    inspect, run, compare, evaluate, export, rerun, batch, simulate, convert, doctor,
):  # fmt: skip
    app.command()(command)
