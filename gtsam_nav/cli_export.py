"""The command ``export``: finished runs in other formats."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from gtsam_nav.cli_options import FrameOption, complete_formats
from gtsam_nav.errors import DataError
from gtsam_nav.terminal import say, show

if TYPE_CHECKING:
    from gtsam_nav.writers.frame import Frame


def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="DIR/METHOD, or DIR for all in it.")],
    to: Annotated[
        str,
        typer.Option(
            metavar="FORMATS",
            help="Of tum,kitti,g2o,nav,geojson,kml,ply.",
            autocompletion=complete_formats,
        ),
    ],
    frame: FrameOption = "ned",
) -> None:
    """Write finished runs in other formats."""
    from gtsam_nav.writers.exports import check_formats, export_run
    from gtsam_nav.writers.run_folder import find_runs

    folders, formats = find_runs(run), to.split(",")
    check_formats(formats)
    written = 0
    failures: list[DataError] = []
    for folder in folders:
        for name in formats:
            try:
                paths = export_run(folder, [name], cast("Frame", frame))
            except DataError as error:
                failures.append(error)
                continue
            written += 1
            show(*map(str, paths))
    # among several runs one may lack what another has
    excused = len(folders) > 1 and written > 0
    for failure in dict.fromkeys(map(str, failures)):
        say(f"{'warning' if excused else 'error'}: {failure}")
    if failures and not excused:
        raise typer.Exit(failures[0].exit_code)
