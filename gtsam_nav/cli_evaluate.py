"""The command ``evaluate``: a trajectory of any origin, scored."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gtsam_nav.cli_options import FrameOption, JsonOption, complete_frame
from gtsam_nav.errors import ConfigError
from gtsam_nav.terminal import say, show, show_json

if TYPE_CHECKING:
    from gtsam_nav.frames import Array


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
    from gtsam_nav.evaluation.frame_hint import frame_hint
    from gtsam_nav.evaluation.metrics import evaluate_trajectory, reference_series
    from gtsam_nav.evaluation.references import open_reference
    from gtsam_nav.writers.frame import frame_named
    from gtsam_nav.writers.run_record import read_record
    from gtsam_nav.writers.trajectories import read_trajectory

    lever_b = None if lever_arm is None else numbers("--lever-arm", lever_arm, 3)
    window_s = None if window is None else numbers("--window", window, 2)
    # a run's own files say which fixes it saw, what it scored and whether it knew where it was
    run = run_folder(trajectory)
    beside, record = run / "config.yaml", run / "run.json"
    config = load_config(beside if beside.is_file() else None)
    estimated = read_trajectory(trajectory, frame_named(frame))
    truth, warnings = open_reference(
        reference, config.gnss, frame=frame_named(reference_frame or frame)
    )
    scored = config.evaluation.window_s if window_s is None else (window_s[0], window_s[1])
    georeferenced = read_record(record).georeferenced if record.is_file() else True
    compared = (
        estimated,
        reference_series(truth),
        truth.xyz_b if lever_b is None else lever_b,
        scored,
    )
    scores = evaluate_trajectory(*compared, georeferenced=georeferenced)
    hint = frame_hint(*compared, georeferenced=georeferenced)
    if as_json:
        show_json(scores.to_json())
    else:
        show(f"{trajectory} against {truth.name} of {reference}", str(scores))
    for warning in warnings:
        say(f"warning: {warning}")
    if scores.failed:
        say(
            f"hint: it covers {scores.coverage:.1%} of the reference: the trajectory"
            f" {span(estimated.t)}, the reference {span(truth.series.t)}; mission time begins with"
            " the first sample"
        )
    if hint is not None:
        say(f"hint: {hint}; --frame and --reference-frame say in which axes a file is")


def run_folder(trajectory: Path) -> Path:
    """Where the run's own files would be: beside its trajectory, or above its exports."""
    from gtsam_nav.writers.exports import EXPORTS

    folder = trajectory.resolve().parent
    exported = folder.name == EXPORTS and (folder.parent / "run.json").is_file()
    return folder.parent if exported else folder


def span(t: Array) -> str:
    """From when to when."""
    return f"spans {t[0]:.1f} to {t[-1]:.1f} s" if len(t) else "is empty"


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
