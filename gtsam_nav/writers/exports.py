"""A finished run in other formats."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from gtsam_nav.errors import ConfigError, DataError, OutputError
from gtsam_nav.frames import Origin
from gtsam_nav.writers.atomic import draft_folder
from gtsam_nav.writers.frame import Frame
from gtsam_nav.writers.geo import write_geojson, write_kml
from gtsam_nav.writers.point_map import read_ply, write_ply
from gtsam_nav.writers.pose_graph import read_pose_graph, write_g2o
from gtsam_nav.writers.run_folder import Run, read_run
from gtsam_nav.writers.trajectories import KITTI_TIMES, write_kitti, write_nav, write_tum

EXPORTS = "export"
"""The folder of a run's exports, in its own."""


def export_run(folder: Path, formats: Sequence[str], frame: Frame = "ned") -> list[Path]:
    """Write a finished run in other formats, into ``folder/export/``.

    Parameters
    ----------
    folder : Path
        Of one method's run.
    formats : sequence of str
        Of `FORMATS`: tum, kitti, g2o, ply in the frame; nav, geojson, kml on the globe.
    frame : {"ned", "enu"}
        ENU turns the body axes to FLU as well; its files end in ``_enu``.

    Returns
    -------
    list of Path
        The files, in the order of the formats; KITTI's poses have their times beside them.

    Raises
    ------
    ConfigError
        For an unknown format or frame.
    DataError
        Where the run lacks what a format needs.
    OutputError
        Where the files cannot be written.
    """
    check_formats(formats)
    if frame not in ("ned", "enu"):
        raise ConfigError(f"unknown frame '{frame}'; the choices are: ned, enu")
    run = read_run(folder)
    out = folder / EXPORTS
    try:
        with draft_folder(out) as draft:
            chosen = dict.fromkeys(formats)
            written = [path for name in chosen for path in FORMATS[name](run, draft, frame)]
            out.mkdir(exist_ok=True)
            return [path.replace(out / path.name) for path in written]
    except OSError as error:
        raise OutputError(f"{out}: cannot write the export: {error}") from error


def check_formats(formats: Sequence[str]) -> None:
    """Raise a ConfigError for a format that is none of `FORMATS`."""
    if unknown := [name for name in formats if name not in FORMATS]:
        raise ConfigError(f"unknown format '{unknown[0]}'; the choices are: {', '.join(FORMATS)}")


def _export_tum(run: Run, out: Path, frame: Frame) -> tuple[Path, ...]:
    path = _named(out, "trajectory.tum", frame)
    write_tum(run.trajectory, path, frame)
    return (path,)


def _export_kitti(run: Run, out: Path, frame: Frame) -> tuple[Path, ...]:
    path = _named(out, "trajectory.kitti", frame)
    write_kitti(run.trajectory, path, frame)
    return path, path.with_name(KITTI_TIMES)


def _export_g2o(run: Run, out: Path, frame: Frame) -> tuple[Path, ...]:
    source = _result(run, "graph.g2o")
    path = _named(out, "graph.g2o", frame)
    write_g2o(read_pose_graph(source, run.folder / "vertex_times.csv"), path, frame)
    return (path,)


def _export_ply(run: Run, out: Path, frame: Frame) -> tuple[Path, ...]:
    path = _named(out, "map.ply", frame)
    write_ply(read_ply(_result(run, "map.ply")), path, frame)
    return (path,)


def _export_nav(run: Run, out: Path, _frame: Frame) -> tuple[Path, ...]:
    path = out / "nav.csv"
    write_nav(run.trajectory, _origin(run), path)
    return (path,)


def _export_geojson(run: Run, out: Path, _frame: Frame) -> tuple[Path, ...]:
    path = out / "track.geojson"
    write_geojson(run.trajectory, _origin(run), run.name, path)
    return (path,)


def _export_kml(run: Run, out: Path, _frame: Frame) -> tuple[Path, ...]:
    path = out / "track.kml"
    write_kml(run.trajectory, _origin(run), run.name, path)
    return (path,)


FORMATS: dict[str, Callable[[Run, Path, Frame], tuple[Path, ...]]] = {
    "tum": _export_tum,
    "kitti": _export_kitti,
    "g2o": _export_g2o,
    "nav": _export_nav,
    "geojson": _export_geojson,
    "kml": _export_kml,
    "ply": _export_ply,
}


def _named(out: Path, name: str, frame: Frame) -> Path:
    path = out / name
    return path.with_stem(f"{path.stem}_enu") if frame == "enu" else path


def _result(run: Run, name: str) -> Path:
    path = run.folder / name
    if not path.is_file():
        reason = run.record.skipped.get(name, "it is missing")
        raise DataError(f"the run has no {name}: {reason}", run.folder)
    return path


def _origin(run: Run) -> Origin:
    if run.record.origin is None:
        raise DataError("nav, geojson and kml need a mission with a geodetic origin", run.folder)
    return run.record.origin
