"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer


def _beginning(choices: Iterable[str], incomplete: str) -> list[str]:
    return [choice for choice in choices if choice.startswith(incomplete)]


def complete_method(incomplete: str) -> list[str]:
    """Names of methods, for the shell."""
    from gtsam_nav.methods import methods

    return _beginning(methods(), incomplete)


def complete_scenario(incomplete: str) -> list[str]:
    """Names of simulated missions, for the shell."""
    from gtsam_nav.simulation import SCENARIOS

    return _beginning(SCENARIOS, incomplete)


def complete_formats(incomplete: str) -> list[str]:
    """The formats so far and one more, for the shell."""
    from gtsam_nav.writers.exports import FORMATS

    *given, last = incomplete.split(",")
    return [",".join([*given, name]) for name in _beginning(FORMATS, last) if name not in given]


def complete_frame(incomplete: str) -> list[str]:
    """Axes of files, for the shell."""
    return _beginning(("ned", "enu"), incomplete)


MissionArgument = Annotated[Path, typer.Argument(metavar="MISSION", help="Mission folder or logs.")]
MethodOption = Annotated[
    list[str],
    typer.Option(
        "--method",
        "-m",
        metavar="NAME",
        help="Method; repeatable.",
        autocompletion=complete_method,
    ),
]
ConfigOption = Annotated[
    Path | None, typer.Option("--config", "-c", metavar="FILE", help="Settings; a card (YAML).")
]
SetOption = Annotated[
    list[str], typer.Option("--set", metavar="KEY=VALUE", help="Override a setting; repeatable.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="No progress bars.")]
FrameOption = Annotated[
    str,
    typer.Option(metavar="FRAME", help="Axes of files: ned or enu.", autocompletion=complete_frame),
]
ForceOption = Annotated[
    bool, typer.Option("--force", help="Replace a mission folder that is there.")
]
