"""What the command line prints with: results on stdout, words for the human on stderr."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO

import typer

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from gtsam_nav.batch import BatchProgress
    from gtsam_nav.solution import Progress

PLAIN_WIDTH = 200
"""Columns of a table where there is no terminal to measure."""


def say(message: str) -> None:
    """A line for the human."""
    typer.echo(message, err=True)


def show(*results: Table | str) -> None:
    """Tables and lines; without a terminal tables have no colours."""
    for result in results:
        if isinstance(result, str):
            typer.echo(result)
        else:
            _console(sys.stdout).print(result, highlight=False)


def show_json(document: Any) -> None:
    """A document of plain values."""
    typer.echo(json.dumps(document, indent=2, allow_nan=False))


@contextmanager
def progress_bars(quiet: bool = False) -> Iterator[Progress]:
    """A bar a stage where stderr is a terminal; elsewhere nothing."""
    from gtsam_nav.solution import no_progress

    if quiet or not sys.stderr.isatty():
        yield no_progress
        return
    from rich.progress import BarColumn, TaskID, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars

    columns = TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn()
    with Bars(*columns, console=_console(sys.stderr), transient=True) as bars:
        tasks: dict[str, TaskID] = {}

        def advance(stage: str, fraction: float) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=1.0)
            bars.update(tasks[stage], completed=fraction)

        yield advance


@contextmanager
def count_bar(quiet: bool = False) -> Iterator[Callable[[BatchProgress], None] | None]:
    """A bar over the runs of a batch where stderr is a terminal; elsewhere nothing."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bars

    columns = BarColumn(), TextColumn("{task.description}", markup=False)
    with Bars(*columns, console=_console(sys.stderr), transient=True) as bars:
        task = bars.add_task("the workers start", total=None)

        def advance(state: BatchProgress) -> None:
            bars.update(task, description=str(state), total=state.total, completed=state.done)

        yield advance


def _console(stream: TextIO) -> Console:
    from rich.console import Console

    return Console(file=stream, width=None if stream.isatty() else PLAIN_WIDTH)
