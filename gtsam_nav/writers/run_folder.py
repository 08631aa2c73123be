"""A run's folder: written whole or not at all, and read back."""

from __future__ import annotations

import json
import math
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from gtsam_nav.config import Config
from gtsam_nav.errors import DataError, OutputError
from gtsam_nav.evaluation.metrics import Metrics, evaluate
from gtsam_nav.settings import first_fault
from gtsam_nav.solution import LandmarkEstimates, Solution
from gtsam_nav.sonar.occupancy import OccupancyGrid, occupancy_grid
from gtsam_nav.trajectory import Trajectory
from gtsam_nav.writers.atomic import missing_folders, remove_empty, replacing_folder
from gtsam_nav.writers.geo import write_geojson
from gtsam_nav.writers.point_map import write_map_image, write_ply
from gtsam_nav.writers.pose_graph import write_g2o, write_vertex_times
from gtsam_nav.writers.run_record import (
    CONFIG,
    RECORD,
    RunRecord,
    make_record,
    read_record,
    write_record,
)
from gtsam_nav.writers.tables import EXACT, write_records, write_table
from gtsam_nav.writers.trajectories import (
    read_trajectory_csv,
    read_tum,
    write_nav,
    write_trajectory_csv,
    write_tum,
)


@dataclass(frozen=True)
class Run:
    """A finished run, read back."""

    folder: Path
    record: RunRecord
    metrics: Metrics
    trajectory: Trajectory

    @property
    def name(self) -> str:
        """Mission and method, for people."""
        return f"{self.record.mission} ({self.record.method})"


def write_run(
    solution: Solution,
    config: Config,
    folder: Path | str,
    *,
    metrics: Metrics | None = None,
    wall_s: float | None = None,
    command: str | None = None,
) -> Path:
    """Write a solution as ``folder/<method>/``, replacing an earlier run of the method.

    Everything is written under a temporary name and renamed at the end. All files but run.json
    are the same bytes for the same solution.

    Parameters
    ----------
    solution : Solution
    config : Config
        As it was resolved for the run.
    folder : Path or str
        Made where it is missing.
    metrics : Metrics, optional
        Scored here where absent.
    wall_s : float, optional
        Seconds from opening the mission to this call; the time of writing is added.
    command : str, optional
        The command line that made the run.

    Returns
    -------
    Path
        The run's folder.

    Raises
    ------
    OutputError
        Where the folder cannot be written, or holds something that is not a run.
    """
    begin = time.perf_counter()
    metrics = metrics or evaluate(solution, window_s=config.evaluation.window_s)
    target = Path(folder) / solution.method
    with _replacing(target) as draft:
        skipped = _write_results(solution, draft)
        _write_metrics(metrics, draft / "metrics.json")
        (draft / CONFIG).write_text(config.to_yaml(), encoding="utf-8", newline="\n")
        record = make_record(solution, config, skipped, command, None)
        if wall_s is not None:
            wall_s += time.perf_counter() - begin
            factor = record.mission_s / wall_s
            record = replace(record, wall_s=wall_s, realtime_factor=factor)
        write_record(record, draft / RECORD)
    return target


def read_run(folder: Path) -> Run:
    """Read a finished run back.

    Raises
    ------
    DataError
        Where the folder does not hold one.
    """
    if not (folder / RECORD).is_file():
        raise DataError(f"not a run's folder: it has no {RECORD}", folder)
    path = folder / "metrics.json"
    try:
        metrics = Metrics.from_json(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError) as error:
        what = first_fault(error) if isinstance(error, ValidationError) else error
        raise DataError(f"cannot read the metrics: {what}", path) from error
    exact = read_tum(folder / "trajectory.tum")
    trajectory = read_trajectory_csv(folder / "trajectory.csv")
    if len(trajectory) != len(exact):
        raise DataError(
            f"trajectory.csv has {len(trajectory)} poses, trajectory.tum {len(exact)}", folder
        )
    return Run(
        folder=folder,
        record=read_record(folder / RECORD),
        metrics=metrics,
        trajectory=replace(trajectory, p_n=exact.p_n, q_nb_wxyz=exact.q_nb_wxyz),
    )


def find_runs(folder: Path) -> list[Path]:
    """The run folders at a path: itself, or those anywhere below it, by name.

    Raises
    ------
    DataError
        Where there is none.
    """
    runs = list(_runs_in(folder))
    if not runs:
        raise DataError(f"no run here: neither it nor a folder in it has a {RECORD}", folder)
    return runs


def _runs_in(folder: Path) -> Iterator[Path]:
    if (folder / RECORD).is_file():
        yield folder
    elif folder.is_dir() and not folder.is_symlink():
        for path in sorted(folder.glob("[!.]*")):  # those of a dot are drafts
            yield from _runs_in(path)


@contextmanager
def settled_output(folder: Path, *runs: Path) -> Iterator[None]:
    """Make a folder and see that the results can be put there, before any work is done.

    What was made goes again where no result came of the work.

    Raises
    ------
    OutputError
        Where it cannot be written, or where one of the runs' places holds something else.
    """
    for place in runs:
        if place.exists() and not (place / RECORD).is_file():
            raise OutputError(f"{place}: is there and not a run's folder; choose another --out")
    made = missing_folders(folder)
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            reason = error.strerror or type(error).__name__
            raise OutputError(f"{folder}: cannot write there: {reason}") from error
        yield
    finally:
        remove_empty(made)


@contextmanager
def _replacing(target: Path) -> Iterator[Path]:
    """A draft folder that takes the target's place when all went well, and else vanishes."""
    if target.exists() and not (target / RECORD).is_file():
        raise OutputError(
            f"{target}: exists and is not a run's folder (no {RECORD}); "
            "move it away or choose another --out"
        )
    try:
        with replacing_folder(target) as draft:
            yield draft
    except OSError as error:
        raise OutputError(f"{target}: cannot write the run: {error}") from error


def _write_results(solution: Solution, draft: Path) -> dict[str, str]:
    """Write what the solution holds; returns the files that it has not, with the reason."""
    trajectory = solution.trajectory
    write_tum(trajectory, draft / "trajectory.tum")
    write_trajectory_csv(trajectory, draft / "trajectory.csv")
    _write_biases(solution, draft / "biases.csv")
    _write_loops(solution, draft / "loops.csv")
    _write_rejections(solution, draft / "rejections.csv")
    skipped: dict[str, str] = {}
    if solution.online is not None:
        write_trajectory_csv(solution.online, draft / "trajectory_online.csv")
    else:
        skipped["trajectory_online.csv"] = (
            "the method keeps no causal estimate beside its final one"
        )
    if solution.pose_graph is not None:
        write_g2o(solution.pose_graph, draft / "graph.g2o")
        write_vertex_times(solution.pose_graph, draft / "vertex_times.csv")
    else:
        absent = "the method builds no pose graph"
        skipped |= dict.fromkeys(("graph.g2o", "vertex_times.csv"), absent)
    if solution.sonar_map is not None and len(solution.sonar_map.t):
        write_ply(solution.sonar_map, draft / "map.ply")
        write_map_image(_occupancy(solution), solution.mission.origin, draft / "map.png")
    else:
        absent = "no echo was mapped" if solution.sonar_map else "the method makes no map"
        skipped |= dict.fromkeys(("map.ply", "map.png", "map.pgw"), absent)
    if solution.landmarks is not None:
        _write_landmarks(solution.landmarks, draft / "landmarks.csv")
    else:
        skipped["landmarks.csv"] = "the method estimates no landmarks"
    if solution.mission.origin is not None:
        write_nav(trajectory, solution.mission.origin, draft / "nav.csv")
        name = f"{solution.mission.name} ({solution.method})"
        write_geojson(trajectory, solution.mission.origin, name, draft / "track.geojson")
    else:
        skipped |= dict.fromkeys(("nav.csv", "track.geojson"), "the mission has no geodetic origin")
    return skipped


def _occupancy(solution: Solution) -> OccupancyGrid:
    """Occupancy of the map as the sonar saw it; from the body's origin where no sonar is known."""
    assert solution.sonar_map is not None
    sonar = solution.scans and solution.mission.sensors.get(solution.scans.sensor)
    lever_b = sonar.xyz_b if sonar else np.zeros(3)
    return occupancy_grid(solution.sonar_map, solution.trajectory, lever_b)


def _write_metrics(metrics: Metrics, path: Path) -> None:
    text = json.dumps(metrics.to_json(), indent=2, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


def _write_biases(solution: Solution, path: Path) -> None:
    slow = solution.slow_states
    columns = {"t": (np.empty(0) if slow is None else slow.t, EXACT)}
    for name, (values, sigmas) in slow.columns.items() if slow is not None else ():
        columns[name] = (values, "%.9g")
        columns[f"sigma_{name}"] = (sigmas, "%.6g")
    write_table(path, columns)


def _write_landmarks(landmarks: LandmarkEstimates, path: Path) -> None:
    cov_n = landmarks.cov_n
    n, e, d = landmarks.p_n.T
    sigma_n, sigma_e, sigma_d = np.sqrt(np.diagonal(cov_n, axis1=1, axis2=2)).T
    columns = {
        "id": (landmarks.id.astype(float), "%d"),
        "n": (n, "%.6f"),
        "e": (e, "%.6f"),
        "d": (d, "%.6f"),
        "sigma_n": (sigma_n, "%.6g"),
        "sigma_e": (sigma_e, "%.6g"),
        "sigma_d": (sigma_d, "%.6g"),
        "cov_ne": (cov_n[:, 0, 1], "%.6g"),
    }
    write_table(path, columns)


def _write_loops(solution: Solution, path: Path) -> None:
    header = (
        *("t_a", "t_b", "dx", "dy", "dyaw_deg", "score"),
        *("sigma_x", "sigma_y", "sigma_yaw_deg", "verdict", "reason", "weight"),
    )
    rows = (
        (
            loop.t_a,
            loop.t_b,
            loop.dx_m,
            loop.dy_m,
            math.degrees(loop.dyaw),
            loop.score,
            loop.sigma_x_m,
            loop.sigma_y_m,
            math.degrees(loop.sigma_yaw),
            loop.verdict,
            loop.reason,
            loop.weight,
        )
        for loop in solution.loops
    )
    write_records(path, header, rows)


def _write_rejections(solution: Solution, path: Path) -> None:
    header = ("t", "sensor", "index", "reason", "normalised_residual")
    rows = ((r.t, r.sensor, r.index, r.reason, r.normalised_residual) for r in solution.rejections)
    write_records(path, header, rows)
