"""The model of ``mission.yaml``, and the only way from a name in it to a file."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import (
    BeforeValidator,
    Field,
    FiniteFloat,
    ValidationInfo,
    field_validator,
    model_validator,
)

from gtsam_nav.cards import (
    Described,
    MotionConstraints,
    SensorCard,
    Vector,
    with_default_types,
)
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Origin, ned_from_geodetic
from gtsam_nav.mission import InitialState
from gtsam_nav.readers.layout import GEODETIC_COLUMNS, HEIGHT_COLUMN, LAYOUTS
from gtsam_nav.series import SERIES_TYPES

MISSION_FILE = "mission.yaml"
LANDMARK_MAP = "landmark_map"
EDGES = "edges"
CLOCK_AND_PLACE = ("time_offset", "xyz_m", "rpy_deg")
MEANINGLESS: Mapping[str, tuple[str, ...]] = {
    LANDMARK_MAP: (*CLOCK_AND_PLACE, "time_offset_s", "columns", "scale"),
    EDGES: (*CLOCK_AND_PLACE, "columns"),
    "beams": ("columns",),
    "scans": ("columns",),
    "clouds": ("columns",),
}
"""Keys that nothing would be made of, by sensor type."""


def _posix_seconds(given: Any) -> Any:
    """A date and time as POSIX seconds; one without a zone is UTC."""
    if isinstance(given, str):
        given = datetime.fromisoformat(given)
    if isinstance(given, date) and not isinstance(given, datetime):
        given = datetime(given.year, given.month, given.day)
    if isinstance(given, datetime):
        aware = given if given.tzinfo is not None else given.replace(tzinfo=UTC)
        return aware.timestamp()
    return given


class GeodeticPosition(Described):
    """A position on WGS-84."""

    latitude_deg: float = Field(ge=-90, le=90)
    longitude_deg: float = Field(ge=-180, le=360)
    height_m: FiniteFloat = 0.0

    def to_origin(self) -> Origin:
        """The same as an origin."""
        return Origin(self.latitude_deg, self.longitude_deg, self.height_m)


class InitialEntry(Described):
    """Where the mission says that it starts.

    Attributes
    ----------
    position_ned_m : (float, float, float), optional
        In the local frame.
    position_geodetic : map, optional
        ``latitude_deg, longitude_deg, height_m`` instead; needs an origin.
    heading_deg : float, optional
        Clockwise from true north.
    sigma_position_m, sigma_heading_deg : float
        Standard deviations, the position's a component.
    """

    position_ned_m: Vector | None = None
    position_geodetic: GeodeticPosition | None = None
    heading_deg: FiniteFloat | None = None
    sigma_position_m: FiniteFloat = Field(default=InitialState.sigma_p, gt=0)
    sigma_heading_deg: FiniteFloat = Field(
        default=float(np.degrees(InitialState.sigma_heading)), gt=0
    )

    @model_validator(mode="after")
    def _one_position(self) -> InitialEntry:
        if self.position_ned_m is not None and self.position_geodetic is not None:
            raise ValueError("give position_ned_m or position_geodetic, not both")
        return self

    def to_state(self, origin: Origin | None, path: Path) -> InitialState:
        """The start state in the local frame."""
        p_n = None if self.position_ned_m is None else np.array(self.position_ned_m)
        if self.position_geodetic is not None:
            if origin is None:
                raise DataError("initial.position_geodetic needs an origin", path)
            place = self.position_geodetic
            p_n = ned_from_geodetic(place.latitude_deg, place.longitude_deg, place.height_m, origin)
        return InitialState(
            p_n=p_n,
            sigma_p=self.sigma_position_m,
            heading=None if self.heading_deg is None else float(np.radians(self.heading_deg)),
            sigma_heading=float(np.radians(self.sigma_heading_deg)),
        )


class SensorEntry(SensorCard):
    """A sensor of the mission: a card's keys, and its file.

    Attributes
    ----------
    file : str
        Inside the mission folder.
    simulated : bool
        Whether the samples were synthesised inside an otherwise recorded mission.
    vertical_usable : bool
        Of a reference: whether its d may be scored.
    columns : map of str to str
        What the file's header calls a column: ``{t: stamp_ns, gx: rate_x}``.
    scale : map of str to float
        What the numbers of a column are multiplied by: ``{t: 1.0e-9, gx: 0.0174533}``. Of beams,
        scans, clouds and edges, t alone.
    through_water : bool
        Of a dvl: whether its file is that of a log, which reads the water.
    scanner_axes : bool
        Of scans: whether the points are along the scanner's axes, so that its mounting places them.
    """

    file: str
    simulated: bool = False
    vertical_usable: bool = True
    columns: dict[str, str] = Field(default_factory=dict)
    scale: dict[str, FiniteFloat] = Field(default_factory=dict)
    through_water: bool = False
    scanner_axes: bool = False

    @field_validator("columns", "scale", mode="before")
    @classmethod
    def _is_a_map_of_columns(cls, given: Any, info: ValidationInfo) -> Any:
        if not isinstance(given, dict):
            example = "{t: stamp_ns}" if info.field_name == "columns" else "{t: 1.0e-9}"
            raise ValueError(f"is a map by the columns' names, as in {example}, not '{given}'")
        return given

    @model_validator(mode="after")
    def _keys_mean_something(self) -> SensorEntry:
        for key in MEANINGLESS.get(self.type, ()):
            if key in self.model_fields_set:
                raise ValueError(f"{key} means nothing for a sensor of type {self.type}")
        return self

    @model_validator(mode="after")
    def _columns_are_known(self) -> SensorEntry:
        layout = LAYOUTS.get(self.type, ())
        known = ["t", *(column for spec in layout for column in spec.columns)]
        known += (*GEODETIC_COLUMNS, HEIGHT_COLUMN) if self.type == "gnss" else ()
        unknown = [name for name in (*self.columns, *self.scale) if name not in known]
        if unknown:
            raise ValueError(
                f"a {self.type} has no column '{unknown[0]}'; the choices are: {', '.join(known)}"
            )
        return self

    @model_validator(mode="after")
    def _keys_are_of_their_type(self) -> SensorEntry:
        for key, kind in (("through_water", "dvl"), ("scanner_axes", "scans")):
            if getattr(self, key) and self.type != kind:
                raise ValueError(f"{key} is of {kind}, and this is a sensor of type {self.type}")
        return self

    @classmethod
    def types(cls) -> tuple[str, ...]:
        """Sensor types that may be named."""
        return (*SERIES_TYPES, LANDMARK_MAP, EDGES)

    @property
    def factors(self) -> dict[str, float]:
        """What the numbers of each column are multiplied by, the units of an IMU included."""
        found = dict(self.scale)
        for axis in "xyz" if self.type == "imu" else "":
            for column, factor in ((f"g{axis}", self.gyro_factor), (f"a{axis}", self.accel_factor)):
                found[column] = found.get(column, 1.0) * factor
        return found


class MissionFile(Described):
    """``mission.yaml``. ``start_utc`` is an ISO 8601 time or POSIX seconds of stamp zero."""

    name: str = ""
    origin: GeodeticPosition | None = None
    start_utc: Annotated[FiniteFloat, BeforeValidator(_posix_seconds)] | None = None
    initial: InitialEntry = InitialEntry()
    constraints: MotionConstraints = MotionConstraints()
    sensors: dict[str, SensorEntry] = Field(min_length=1)

    @model_validator(mode="before")
    @classmethod
    def _types_default_to_names(cls, given: Any) -> Any:
        return with_default_types(given)


class MissingFileError(DataError):
    """A file that the mission names is not there."""


def file_inside(folder: Path, name: str) -> Path:
    """The regular file of that name in the folder.

    Raises
    ------
    DataError
        Where the name leads out of the folder, through a link too, or (`MissingFileError`) to no
        file.
    """
    try:
        path = (folder / name).resolve()
        inside = path.is_relative_to(folder.resolve())
        is_file = path.is_file()
    except (OSError, ValueError, RuntimeError) as error:
        raise DataError(f"'{name[:80]}' is no name of a file: {error}", folder) from error
    if not inside:
        raise DataError(f"'{name}' leads out of the mission folder", folder)
    if not is_file:
        raise MissingFileError(f"file '{name}' is missing", folder)
    return path
