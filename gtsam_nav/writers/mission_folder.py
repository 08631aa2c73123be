"""Missions as mission folders, written so that `gtsam_nav.readers.folder` reads them back.

Floats are written exactly, positions of GNSS as latitude, longitude and height where the mission
has an origin (exact to about 1e-8 m). What was dropped stands in ``rejections.csv``, by its row in
the source. What a folder cannot say is not written: warnings, surveyed relations (`unwritten`), row
numbers of what was kept. Reading sets time zero to the earliest sample.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gtsam_nav.errors import OutputError
from gtsam_nav.frames import Array, geodetic_from_ned, rpy_from_rotation
from gtsam_nav.mission import Constraints, InitialState, LandmarkMap, Mission, Sensor
from gtsam_nav.pose_edges import PoseEdges
from gtsam_nav.readers._edge_table import edge_columns
from gtsam_nav.readers._mission_yaml import MISSION_FILE
from gtsam_nav.readers._rejections import COLUMNS, REJECTIONS_FILE
from gtsam_nav.readers.clouds import cloud_table, load
from gtsam_nav.readers.layout import GEODETIC_COLUMNS, HEIGHT_COLUMN, LAYOUTS, NED_COLUMNS
from gtsam_nav.series import (
    BeamSeries,
    CloudSeries,
    ReferenceSeries,
    ScanSeries,
    Series,
)
from gtsam_nav.writers.atomic import replacing_folder
from gtsam_nav.writers.tables import EXACT, write_records, write_table
from gtsam_nav.yaml_files import read_yaml_file

LANDMARK_MAP, EDGES = "landmark_map", "edges"
FOLDED_BY_YAML = "\x85\u2028\u2029"
"""Line breaks that would read back as spaces if they were not escaped."""


def write_mission(mission: Mission, folder: Path | str) -> None:
    """Write a mission as a folder, under a temporary name first: no half mission stays behind.

    A folder that holds nothing but an earlier mission is replaced.

    Parameters
    ----------
    mission : Mission
    folder : Path or str
        Made, with its parents.

    Raises
    ------
    OutputError
        Where the place cannot be written, or holds anything else.
    """
    target = Path(folder).resolve()
    if not _replaceable(target):
        raise OutputError(f"{target} exists and is no mission folder; choose another place")
    try:
        with replacing_folder(target) as draft:
            _write_files(mission, draft)
    except OSError as error:
        raise OutputError(f"{target}: the mission cannot be written: {error}") from error


def unwritten(mission: Mission) -> list[str]:
    """What is said of that which a folder has no place for."""
    relations = mission.relations
    if relations is None:
        return []
    return [f"{len(relations.t)} surveyed relations have no place in a folder: left out"]


def check_free(folder: Path, force: bool) -> None:
    """Raise an OutputError where something is in the place of a folder, unless that is forced."""
    if not force and folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise OutputError(f"{folder} is there; --force replaces a mission folder")


def _replaceable(target: Path) -> bool:
    """Whether nothing is there, or only what an earlier mission's description names."""
    if not target.exists():
        return True
    if not target.is_dir():
        return False
    present = {str(p.relative_to(target)) for p in target.rglob("*") if not p.is_dir()}
    try:
        entries = read_yaml_file(target / MISSION_FILE)["sensors"]
        named = {str(entry["file"]) for entry in entries.values()}
        of_clouds = {
            str(entry["file"])
            for name, entry in entries.items()
            if entry.get("type", name) == CloudSeries.TYPE
        }
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return not present
    clouds = {name.removesuffix(".csv") for name in of_clouds}
    ours = named | {MISSION_FILE, REJECTIONS_FILE}
    return all(name in ours or str(Path(name).parent) in clouds for name in present)


def _write_files(mission: Mission, folder: Path) -> None:
    description: dict[str, Any] = {"name": mission.name}
    if mission.origin is not None:
        description["origin"] = {
            "latitude_deg": float(mission.origin.latitude_deg),
            "longitude_deg": float(mission.origin.longitude_deg),
            "height_m": float(mission.origin.height_m),
        }
    if mission.start_utc is not None:
        description["start_utc"] = float(mission.start_utc)
    initial = _initial(mission.initial)
    if initial:
        description["initial"] = initial
    if mission.constraints != Constraints():
        description["constraints"] = asdict(mission.constraints)
    entries: dict[str, Any] = {}
    for stem, sensor in zip(_file_stems(mission), mission.sensors.values(), strict=True):
        file_name = _write_series(sensor.series, mission, folder, stem)
        entries[sensor.name] = _entry(sensor, file_name)
    if mission.landmark_map is not None:
        _write_landmark_map(mission.landmark_map, folder / f"{LANDMARK_MAP}.csv")
        name = _unused(LANDMARK_MAP, set(entries))
        entries[name] = {"type": LANDMARK_MAP, "file": f"{LANDMARK_MAP}.csv"}
    if mission.edges is not None:
        _write_edges(mission.edges, folder / f"{EDGES}.csv")
        entries[_unused(EDGES, set(entries))] = {"type": EDGES, "file": f"{EDGES}.csv"}
    description["sensors"] = entries
    if mission.rejections:
        rows = [(r.t, r.sensor, r.index, r.reason) for r in mission.rejections]
        write_records(folder / REJECTIONS_FILE, COLUMNS, rows)
    text = yaml.safe_dump(description, sort_keys=False, allow_unicode=True)
    if any(character in text for character in FOLDED_BY_YAML):
        text = yaml.safe_dump(description, sort_keys=False)
    (folder / MISSION_FILE).write_text(text, encoding="utf-8", newline="\n")


def _initial(state: InitialState) -> dict[str, Any]:
    found: dict[str, Any] = {}
    if state.p_n is not None:
        found["position_ned_m"] = [float(x) for x in state.p_n]
    if state.heading is not None:
        found["heading_deg"] = float(np.degrees(state.heading))
    if found or state != InitialState():
        found["sigma_position_m"] = float(state.sigma_p)
        found["sigma_heading_deg"] = float(np.degrees(state.sigma_heading))
    return found


def _entry(sensor: Sensor, file_name: str) -> dict[str, Any]:
    entry: dict[str, Any] = {"type": sensor.type, "file": file_name}
    if np.any(sensor.xyz_b):
        entry["xyz_m"] = [float(x) for x in sensor.xyz_b]
    rpy_deg = np.degrees(rpy_from_rotation(sensor.R_bs))
    if np.any(rpy_deg):
        entry["rpy_deg"] = [float(x) for x in rpy_deg]
    if sensor.noise:
        entry["noise"] = {
            figure: value if isinstance(value, bool | None) else float(value)
            for figure, value in sensor.noise.items()
        }
    if sensor.time_offset_sigma_s > 0:
        # the stamps that are written have the card's own offset in them
        entry["time_offset"] = {"sigma_s": float(sensor.time_offset_sigma_s), "estimate": True}
    if sensor.simulated:
        entry["simulated"] = True
    if isinstance(sensor.series, ReferenceSeries) and not sensor.series.vertical_usable:
        entry["vertical_usable"] = False
    return entry


def _file_stems(mission: Mission) -> list[str]:
    """One file name a sensor, without its ending, whatever the sensors are called."""
    taken = {LANDMARK_MAP, EDGES, Path(REJECTIONS_FILE).stem}
    stems = []
    for name in mission.sensors:
        stem = _unused(re.sub(r"[^A-Za-z0-9_-]+", "_", name) or "sensor", taken)
        taken.add(stem)
        stems.append(stem)
    return stems


def _unused(name: str, taken: set[str]) -> str:
    candidate, k = name, 2
    while candidate in taken:
        candidate, k = f"{name}_{k}", k + 1
    return candidate


def _write_series(series: Series, mission: Mission, folder: Path, stem: str) -> str:
    """Write the samples and return the file's name."""
    if isinstance(series, BeamSeries):
        np.savez(
            folder / f"{stem}.npz",
            t=series.t,
            angle=series.angle,
            intensity=series.intensity,
            resolution_m=np.array(series.resolution_m),
        )
        return f"{stem}.npz"
    if isinstance(series, ScanSeries):
        np.savez(folder / f"{stem}.npz", t=series.t, first=series.first, points=series.points_b)
        return f"{stem}.npz"
    path = folder / f"{stem}.csv"
    if isinstance(series, CloudSeries):
        _write_clouds(series, path)
    else:
        _write_numbers(series, mission, path)
    return path.name


def _write_numbers(series: Series, mission: Mission, path: Path) -> None:
    columns: dict[str, tuple[Array, str]] = {"t": (series.t, EXACT)}
    worded: dict[str, Callable[[float], str]] = {}
    for spec in LAYOUTS[series.TYPE]:
        values = getattr(series, spec.series)
        if values is None:
            continue
        names = spec.columns
        if spec.degrees:
            values = np.degrees(values)
        if names == NED_COLUMNS and series.TYPE == "gnss" and mission.origin is not None:
            names = (*GEODETIC_COLUMNS, HEIGHT_COLUMN)
            values = np.column_stack(geodetic_from_ned(values, mission.origin))
        if spec.words is not None:
            worded[names[0]] = {number: word for word, number in spec.words.items()}.__getitem__
        number_format = "%d" if spec.integer else EXACT
        table = np.asarray(values, dtype=float).reshape(len(series), len(names))
        for name, column in zip(names, table.T, strict=True):
            columns[name] = (column, number_format)
    if not worded:
        write_table(path, columns)
        return
    cells = [
        [worded[name](value) for value in column.tolist()]
        if name in worded
        else (column if number_format == EXACT else column.astype(np.int64)).tolist()
        for name, (column, number_format) in columns.items()
    ]
    write_records(path, list(columns), zip(*cells, strict=True))


def _write_clouds(series: CloudSeries, path: Path) -> None:
    clouds = path.with_suffix("")
    clouds.mkdir()
    names = []
    for k, source in enumerate(series.clouds):
        copy = clouds / f"{k:06d}{source.suffix if isinstance(source, Path) else '.npy'}"
        if isinstance(source, Path):
            shutil.copyfile(source, copy)
        else:
            np.save(copy, cloud_table(load(source)))
        names.append(f"{clouds.name}/{copy.name}")
    write_records(path, ("t", "file"), zip(series.t.tolist(), names, strict=True))


def _write_landmark_map(landmarks: LandmarkMap, path: Path) -> None:
    n, e, d = landmarks.p_n.reshape(-1, 3).T
    columns = {
        "id": (landmarks.id.astype(float), "%d"),
        "n": (n, EXACT),
        "e": (e, EXACT),
        "d": (d, EXACT),
        "sigma": (landmarks.sigma, EXACT),
    }
    write_table(path, columns)


def _write_edges(edges: PoseEdges, path: Path) -> None:
    columns = edge_columns(edges)
    write_table(path, {name: (values, EXACT) for name, values in columns.items()})
