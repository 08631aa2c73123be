"""The command ``rerun``: whether a finished run can be had again."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from gtsam_nav.cli_options import QuietOption
from gtsam_nav.errors import OutputError, RepetitionError
from gtsam_nav.terminal import progress_bars, say, show


def rerun(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="DIR/METHOD, or DIR for all in it.")],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Keep the repetition here; thrown away where not given."),
    ] = None,
    quiet: QuietOption = False,
) -> None:
    """Repeat finished runs from their records, and compare every result."""
    from gtsam_nav.rerun import CHANGED, repeat
    from gtsam_nav.tables import repetition_table
    from gtsam_nav.writers.run_folder import find_runs
    from gtsam_nav.writers.run_record import CONFIG

    folders = find_runs(run)
    if out is not None and any(
        (out / folder.relative_to(run).parent / folder.name).resolve() == folder.resolve()
        for folder in folders
    ):
        raise OutputError(f"{out}: holds the runs themselves; choose another --out")
    differing = []
    with TemporaryDirectory(prefix="gtsam-nav-") as made:
        for folder in folders:
            with progress_bars(quiet) as progress:
                place = (out or Path(made)) / folder.relative_to(run).parent
                repetition = repeat(folder, place, progress)
            show(repetition_table(str(folder), repetition))
            for name, (then, now) in repetition.versions.items():
                say(f"note: {name} was {then or 'not there'}, is {now or 'not there'} now")
            if repetition.files[CONFIG] == CHANGED:
                say(f"note: {folder / CONFIG} {CHANGED}: this was a run of other settings")
            if not repetition.is_same:
                differing.append(str(folder.relative_to(run.parent)))
    if differing:
        raise RepetitionError(f"{run}: not the same again: {', '.join(differing)}")
    show(f"{run}: the same again")
