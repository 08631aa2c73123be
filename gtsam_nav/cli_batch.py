"""The command ``batch``: many missions at once."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from gtsam_nav.cli_options import ConfigOption, JsonOption, MethodOption, QuietOption, SetOption
from gtsam_nav.terminal import count_bar, say, show, show_json


def batch(
    missions: Annotated[
        list[str], typer.Argument(metavar="GLOB...", help="Missions, or patterns that match them.")
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Table, summary and run folders.")],
    method: MethodOption = ["graph"],  # noqa: B006
    config: ConfigOption = None,
    overrides: SetOption = [],  # noqa: B006
    sweep: Annotated[
        list[str],
        typer.Option(
            metavar="KEY=V1,V2,...", help="Try these values of a setting; all combinations."
        ),
    ] = [],  # noqa: B006
    workers: Annotated[
        int | None,
        typer.Option(metavar="N", show_default=False, help="Processes; one a core otherwise."),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Use this Dask scheduler's workers.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Leave out what DIR's table has finished.")
    ] = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Estimate many missions, on many workers; a bad one never stops the rest."""
    from gtsam_nav.batch import REPORT
    from gtsam_nav.batch import batch as run_batch
    from gtsam_nav.batch.plan import parse_sweep
    from gtsam_nav.batch.ranking import rank
    from gtsam_nav.batch.table import TABLE
    from gtsam_nav.cards import with_mission
    from gtsam_nav.config import load_config

    with count_bar(quiet) as progress:
        results = run_batch(
            missions,
            out,
            method,
            config=load_config(config, overrides),
            card=with_mission(config),
            sweep=parse_sweep(sweep),
            workers=workers,
            scheduler=scheduler,
            resume=resume,
            progress=progress,
        )
    ranking = rank(results)
    if as_json:
        show_json(asdict(ranking))
    else:
        from gtsam_nav.tables import ranking_table

        show(ranking_table(ranking), "", f"table: {out / TABLE}", f"summary: {out / REPORT}")
    failures = results[results["cause"].notna()]
    for cause, rows in failures.groupby("cause"):
        first = rows.iloc[0]
        say(
            f"warning: {cause}: {len(rows)} of {len(results)} runs failed,"
            f" the first {first['mission']}, {first['method']}: {first['error']}"
        )
    if failures["exit_code"].any():
        raise typer.Exit(int(failures["exit_code"].max()))
