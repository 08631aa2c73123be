"""The mission folder: ``mission.yaml`` beside CSV (plain or .gz) and .npz files.

``mission.yaml``::

    name: harbour survey
    origin: {latitude_deg: 42.2, longitude_deg: 3.1, height_m: 0.0}
    start_utc: 2024-05-17T09:30:00Z     # of stamp zero; POSIX seconds will do
    initial:                            # all of it is optional
      position_ned_m: [0, 0, 0]         # or position_geodetic, a map like origin
      heading_deg: 30
      sigma_position_m: 1
      sigma_heading_deg: 3
    constraints: {nonholonomic: true, zero_velocity: true}      # on wheels; both default to false
    sensors:
      dvl: {file: dvl.csv, xyz_m: [0.2, 0, 0.1], rpy_deg: [180, 0, 45], time_offset_s: -0.1,
            noise: {sigma_m_s: 0.02}}
      imu: {file: imu.csv, time_offset: {value_s: 0.0, sigma_s: 0.5, estimate: true}}
      stern_gnss: {type: gnss, file: fixes.csv.gz}
      sonar: {type: beams, file: beams.npz, simulated: true}
      imu: {file: log.csv, columns: {t: stamp_ns, gx: rate_x}, scale: {t: 1.0e-9, gx: 0.0174533}}

`layout` holds the columns of each file. Angles of a turned compass, attitude sensor or reference
(``rpy_deg``) become those of the body, and its mounting in the mission turns nothing. A
``time_offset`` stands for ``time_offset_s`` where the clock is doubted; the graph estimates what it
is off by. Without an origin the first fix of a file with latitudes is taken, and a warning says so.
``rejections.csv`` (t, sensor, index, reason) holds the samples that a conversion dropped.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from gtsam_nav.cards import read_yaml
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Origin
from gtsam_nav.mission import LandmarkMap, Mission, Rejection, Sensor
from gtsam_nav.pose_edges import PoseEdges
from gtsam_nav.preprocess.cleaning import screen, tidy
from gtsam_nav.preprocess.no_returns import without_no_returns
from gtsam_nav.preprocess.repeats import without_repeats
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.readers._columns import not_whole, of_a_log, values_of
from gtsam_nav.readers._edge_table import read_edges
from gtsam_nav.readers._gnss import (
    NO_HEIGHTS,
    OFF_THE_GLOBE,
    OFF_THE_GLOBE_MENDED,
    geodetic_fixes,
    without_heights,
)
from gtsam_nav.readers._mended_table import mended, onto_one_day, said_of_midnight
from gtsam_nav.readers._mission_yaml import (
    EDGES,
    LANDMARK_MAP,
    MISSION_FILE,
    MissingFileError,
    MissionFile,
    SensorEntry,
    file_inside,
)
from gtsam_nav.readers._mounting import in_body_axes
from gtsam_nav.readers._npz import read_beams, read_scans
from gtsam_nav.readers._rejections import REJECTIONS_FILE, read_rejections
from gtsam_nav.readers._table import Table, read_named_files, read_table, truncation
from gtsam_nav.readers.layout import (
    GEODETIC_COLUMNS,
    HEIGHT_COLUMN,
    LAYOUTS,
    NED_COLUMNS,
    Field,
)
from gtsam_nav.sensors.noise import NOISE_MODELS
from gtsam_nav.series import SERIES_TYPES, CloudSeries, ScanSeries, Series
from gtsam_nav.solution import Progress, no_progress

NAME = "mission folder"
EXPECTS = f"a folder with {MISSION_FILE}"

DATA_SUFFIXES = (".csv", ".csv.gz", ".npz")
MOST_NAMED = 10
MENDED = {
    OFF_THE_GLOBE: OFF_THE_GLOBE_MENDED,
    "implausible speed": "; 'noise: {max_speed_m_s: ...}' says how fast it may be",
}
"""What a card says where all samples of a sensor are refused for a reason."""

Cleaned = tuple[Series | None, list[Rejection]]


def can_open(path: Path) -> bool:
    """Whether the path is a folder with a ``mission.yaml``."""
    return (path / MISSION_FILE).is_file()


def read(path: Path, progress: Progress = no_progress) -> Mission:
    """Read a mission folder.

    Raises
    ------
    DataError
        Where a file is missing or malformed; names the file and the line or the key.
    """
    description = file_inside(path, MISSION_FILE)
    described = read_yaml(description, MissionFile)
    mission = read_described(path, described, description, progress, read_rejections(path))
    unnamed = _unnamed_files(path, mission.sources)
    if not unnamed:
        return mission
    named = ", ".join(unnamed[:MOST_NAMED]) + " and others" * (len(unnamed) > MOST_NAMED)
    warning = f"{MISSION_FILE} does not name {named}: left out"
    return replace(mission, warnings=(*mission.warnings, warning))


def _unnamed_files(folder: Path, named: Sequence[Path]) -> list[str]:
    """Files of data in the folder itself that its description has forgotten, or lost."""
    known = {REJECTIONS_FILE, *(path.name for path in named if path.parent == folder)}
    return sorted(
        path.name
        for path in folder.iterdir()
        if path.name.endswith(DATA_SUFFIXES) and path.name not in known and path.is_file()
    )


def read_described(
    folder: Path,
    described: MissionFile,
    description: Path,
    progress: Progress,
    rejections: Sequence[Rejection] = (),
) -> Mission:
    """Read the files of a folder that a description, from wherever it came, names.

    To what is dropped here come the ``rejections`` of an earlier reading.
    """
    origin = None if described.origin is None else described.origin.to_origin()
    reading = _Reading(folder, origin, description.name)
    for k, (name, entry) in enumerate(described.sensors.items()):
        progress("read mission", k / len(described.sensors))
        reading.add(name, entry)
    progress("read mission", 1.0)
    night = reading.past_midnight
    told = [
        *said_of_midnight(night),
        *onto_one_day(reading.sensors, reading.rejections, night),
    ]
    mission = Mission(
        name=described.name or folder.resolve().name,
        sensors=reading.sensors,
        origin=reading.origin,
        start_utc=described.start_utc,
        initial=described.initial.to_state(reading.origin, description),
        landmark_map=reading.landmark_map,
        edges=reading.edges,
        constraints=described.constraints.to_constraints(),
        rejections=(*rejections, *reading.rejections),
        warnings=(*reading.warnings, *told, *reading.unknown_columns()),
        sources=(description, *reading.sources),
    )
    offsets = {rejection.sensor: 0.0 for rejection in rejections}
    offsets |= {
        EDGES if entry.type == EDGES else name: entry.time_offset_s
        for name, entry in described.sensors.items()
    }
    return on_mission_time(mission, offsets)


@dataclass
class _Reading:
    """What has been read so far; stamps are those of the files."""

    folder: Path
    origin: Origin | None
    description: str
    sensors: dict[str, Sensor] = field(default_factory=dict)
    rejections: list[Rejection] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    sources: list[Path] = field(default_factory=list)
    landmark_map: LandmarkMap | None = None
    edges: PoseEdges | None = None
    past_midnight: list[str] = field(default_factory=list)
    unread: dict[Path, dict[str, tuple[str, ...]]] = field(default_factory=dict)

    def add(self, name: str, entry: SensorEntry) -> None:
        """Read one entry of the mission."""
        path = file_inside(self.folder, entry.file)
        self.sources.append(self.folder / entry.file)
        if entry.type == LANDMARK_MAP:
            self.landmark_map = self._landmark_map(path)
            return
        if entry.type == EDGES:
            self.edges, dropped = read_edges(path, entry.factors.get("t", 1.0))
            self.rejections += dropped
            if dropped:
                self.warnings.append(f"{path.name}: {len(dropped)} unusable edges are left out")
            return
        series, rejections = self._series(name, entry, path)
        self.rejections += rejections
        if series is None:
            reasons = Counter(rejection.reason for rejection in rejections).most_common(1)
            mostly = "".join(f", mostly for: {reason}" for reason, _ in reasons)
            self.warnings.append(
                f"sensor '{name}' is left out: {entry.file} holds no valid sample "
                f"({len(rejections)} dropped{mostly})"
                + "".join(mend for reason, mend in MENDED.items() if mostly.endswith(reason))
            )
            return
        if entry.drop_repeats:
            series, repeats = without_repeats(name, series)
            self.rejections += repeats
        sensor = Sensor(
            name=name,
            type=entry.type,
            series=series,
            xyz_b=entry.xyz_b,
            R_bs=entry.R_bs,
            noise=entry.noise,
            simulated=entry.simulated,
            time_offset_sigma_s=entry.time_offset_sigma_s,
        )
        if entry.type != ScanSeries.TYPE or entry.scanner_axes:
            sensor = in_body_axes(sensor)
        self.sensors[name], warnings = without_no_returns(sensor)
        self.warnings += warnings

    def _series(self, name: str, entry: SensorEntry, path: Path) -> Cleaned:
        if entry.type in ("beams", "scans"):
            read_points = read_beams if entry.type == "beams" else read_scans
            series, rejections, midnight = read_points(name, path, entry.factors.get("t", 1.0))
            self.past_midnight += [name] * midnight
            return series, rejections
        if entry.type == "clouds":
            return self._clouds(name, path, entry.factors.get("t", 1.0))
        return self._numbers(name, entry, path)

    def _numbers(self, name: str, entry: SensorEntry, path: Path) -> Cleaned:
        layout = LAYOUTS[entry.type]
        table = self._table(name, entry, path, layout)
        model = NOISE_MODELS.get(entry.type)
        noise = None if model is None else model.model_validate(entry.noise)
        table, said, midnight = mended(table, noise, layout)
        self.warnings += [f"sensor '{name}': {path.name} {what}" for what in said]
        self.past_midnight += [name] * midnight
        if table.has(GEODETIC_COLUMNS):
            series, rejections = self._geodetic(name, table, noise, layout)
            return series, rejections + table.cut(name)
        columns: dict[str, Any] = {"t": table.columns["t"]}
        for spec in layout:
            values = values_of(spec, table, noise)
            if values is not None:
                columns[spec.series] = values
        constants: dict[str, Any] = {}
        if entry.type == "reference":
            constants["vertical_usable"] = entry.vertical_usable
        series, rejections = tidy(
            SERIES_TYPES[entry.type],
            name,
            columns,
            refused=not_whole(layout, columns),
            max_speed_m_s=getattr(noise, "max_speed_m_s", np.inf),
            components={spec.series: spec.columns for spec in layout},
            **constants,
        )
        return series, rejections + table.cut(name)

    def _geodetic(self, name: str, table: Table, noise: Any, layout: tuple[Field, ...]) -> Cleaned:
        _, sigma, v_n = (values_of(spec, table, noise) for spec in layout)
        assert sigma is not None
        fixes, has_heights = geodetic_fixes(table.columns, sigma, v_n)
        if not has_heights:
            fixes = without_heights(fixes, noise, self.origin)
            self.warnings.append(
                f"sensor '{name}': the fixes of {table.path.name} have {NO_HEIGHTS}"
            )
        if self.origin is None:
            self.origin = fixes.first_usable()
            if self.origin is not None:
                self.warnings.append(
                    f"{self.description} states no origin: the first fix of '{name}' is taken, and"
                    " whatever is given as north, east and down is taken to count from there"
                )
        # without any usable fix every origin does: the reasons come out all the same
        return fixes.series(name, self.origin or Origin(0.0, 0.0))

    def _table(self, name: str, entry: SensorEntry, path: Path, layout: tuple[Field, ...]) -> Table:
        required = ["t", *(c for spec in layout if spec.required for c in spec.columns)]
        optional = [c for spec in layout if not spec.required for c in spec.columns]
        if entry.through_water:
            required, optional = ["t", "vx"], ["vy", "vz", *optional]
        words = {c: spec.words for spec in layout if spec.words for c in spec.columns}
        instead = (NED_COLUMNS, GEODETIC_COLUMNS) if entry.type == "gnss" else None
        optional += [HEIGHT_COLUMN] if entry.type == "gnss" else []
        table = read_table(
            path,
            required,
            optional,
            words=words,
            instead=instead,
            renamed=entry.columns,
            scale=entry.factors,
        )
        if layout is LAYOUTS["landmarks"] and not table.columns.keys() & {"range_m", "bearing_deg"}:
            raise DataError("column 'range_m' or 'bearing_deg' is needed, or both", path, 1)
        if table.cut_line is not None:
            where = f"sensor '{name}': {path.name}:{table.cut_line}"
            cut = ", and the archive is cut off there" * table.archive_cut
            self.warnings.append(f"{where}: the last line is damaged: left out{cut}")
        self.unread.setdefault(path, {})[name] = table.unknown
        return of_a_log(table) if entry.through_water else table

    def unknown_columns(self) -> Iterator[str]:
        """What is said of columns that no sensor takes."""
        for path, by_sensor in self.unread.items():
            lists = list(by_sensor.values())
            unknown = [c for c in lists[0] if all(c in others for others in lists[1:])]
            if unknown:
                names = ", ".join(f"'{name}'" for name in by_sensor)
                sensors = f"sensor{'s' * (len(lists) > 1)} {names}"
                yield f"{sensors}: {path.name} has unknown columns: {', '.join(unknown)}"

    def _clouds(self, name: str, path: Path, stamp_s: float) -> Cleaned:
        stamps, names, cut_stamp = read_named_files(path)
        stamps = stamp_s * stamps
        missing = np.zeros(len(names), dtype=bool)
        files: list[Path] = []
        for k, file_name in enumerate(names):
            try:
                files.append(file_inside(self.folder, file_name))
            except MissingFileError:
                missing[k] = True
                files.append(Path())
        columns = {"t": stamps}
        refused = {"missing file": missing}
        kept, rejections = screen(CloudSeries, name, columns, refused=refused)
        rejections += truncation(name, len(stamps), cut_stamp)
        if not len(kept):
            return None, rejections
        picked = tuple(files[k] for k in kept)
        self.sources += picked
        return CloudSeries(t=stamps[kept], row=kept, clouds=picked), rejections

    def _landmark_map(self, path: Path) -> LandmarkMap:
        table = read_table(path, ("id", "n", "e", "sigma"), ("d",))
        c = table.columns
        ids, sigma = c["id"], c["sigma"]
        p_n = np.column_stack([c["n"], c["e"], c.get("d", np.zeros(len(ids)))])
        finite = np.all(np.isfinite(np.column_stack([ids, p_n, sigma])), axis=1)
        usable = finite & (sigma > 0) & (ids == np.floor(ids)) & (np.abs(ids) < 2**53)
        whole = LandmarkMap(ids[usable].astype(np.int64), p_n[usable], sigma[usable])
        dropped = np.sum(~usable) + (table.cut_stamp is not None)
        if dropped:
            self.warnings.append(f"{path.name}: {dropped} unusable landmarks are left out")
        if len(np.unique(whole.id)) < len(whole.id):
            raise DataError("a landmark's id is given twice", path)
        return whole
