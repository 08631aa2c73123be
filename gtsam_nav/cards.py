"""Data-set cards: how the instruments of a known data set are mounted and how noisy they are.

A card is YAML in ``datasets/``: inside the installed package, or beside it in a checkout.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    Field,
    FiniteFloat,
    ValidationError,
    model_validator,
)

from gtsam_nav.errors import DataError
from gtsam_nav.frames import STANDARD_GRAVITY_M_S2, Array, rotation_from_rpy
from gtsam_nav.mission import Constraints
from gtsam_nav.preprocess.repeats import MEASURED
from gtsam_nav.sensors.noise import NOISE_MODELS, figure_names
from gtsam_nav.series import SERIES_TYPES
from gtsam_nav.settings import Settings, first_fault, in_words
from gtsam_nav.yaml_files import YamlError, read_yaml_file

MISSION_SECTION = "mission"
"""What a file of settings may hold beside them: the card of a mission that has none inside."""

PACKAGE = Path(__file__).parent
CARD_FOLDERS = (PACKAGE / "datasets", PACKAGE.parent / "datasets")

Vector = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
Model = TypeVar("Model", bound=BaseModel)

FARTHEST_MOUNTING_M = 1000.0
"""No vehicle is longer: what is farther off is in other units, or a place in the world."""


def near_the_body(xyz_m: Vector) -> Vector:
    """The position again, in m; a ValueError where no vehicle reaches so far."""
    farthest = max(xyz_m, key=abs)
    if abs(farthest) > FARTHEST_MOUNTING_M:
        raise ValueError(
            f"{farthest:g} m is no place on a vehicle; the limit is {FARTHEST_MOUNTING_M:g} m"
        )
    return xyz_m


class Described(Settings):
    """Settings of a data file: an unknown key is answered with the choices."""

    @model_validator(mode="before")
    @classmethod
    def _keys_are_known(cls, given: Any) -> Any:
        if isinstance(given, dict):
            unknown = [key for key in given if key not in cls.model_fields]
            if unknown:
                choices = ", ".join(cls.model_fields)
                raise ValueError(f"unknown key '{unknown[0]}'; the choices are: {choices}")
        return given


class TimeOffset(Described):
    """What is added to stamps, its standard deviation, and whether to estimate it."""

    value_s: FiniteFloat = 0.0
    sigma_s: FiniteFloat = Field(default=0.5, gt=0)
    estimate: bool = False


class SensorCard(Described):
    """Mounting, clock and noise of one instrument.

    Attributes
    ----------
    type : str
        Sensor type; a sensor's name where it is left out.
    xyz_m : (float, float, float)
        Position in the body frame.
    rpy_deg : (float, float, float)
        ``R_bs = Rz(yaw) Ry(pitch) Rx(roll)``.
    time_offset_s : float
        Added to the file's stamps.
    time_offset : map, optional
        The same as ``value_s`` of a clock that is known no better than ``sigma_s``; with
        ``estimate: true`` the graph finds what it is off by.
    noise : map
        Figures of the type's noise model.
    gyro_unit, accel_unit : {"rad/s", "deg/s"}, {"m/s^2", "g"}
        Of an IMU, what its samples come in.
    drop_repeats : bool
        Whether a sample that equals the one before is that one again, under a new stamp.
    """

    type: str
    xyz_m: Annotated[Vector, AfterValidator(near_the_body)] = (0.0, 0.0, 0.0)
    rpy_deg: Vector = (0.0, 0.0, 0.0)
    time_offset_s: FiniteFloat = 0.0
    time_offset: TimeOffset | None = None
    noise: dict[str, Any] = Field(default_factory=dict)
    gyro_unit: Literal["rad/s", "deg/s"] = "rad/s"
    accel_unit: Literal["m/s^2", "g"] = "m/s^2"
    drop_repeats: bool = False

    @model_validator(mode="before")
    @classmethod
    def _one_time_offset(cls, given: Any) -> Any:
        if not isinstance(given, dict) or not isinstance(given.get("time_offset"), dict):
            return given
        if "time_offset_s" in given:
            raise ValueError("give time_offset_s or time_offset, not both")
        return {**given, "time_offset_s": given["time_offset"].get("value_s", 0.0)}

    @model_validator(mode="after")
    def _type_and_noise_are_known(self) -> SensorCard:
        if self.type not in self.types():
            choices = ", ".join(self.types())
            raise ValueError(f"unknown sensor type '{self.type}'; the choices are: {choices}")
        model = NOISE_MODELS.get(self.type)
        if model is None:
            if self.noise:
                raise ValueError(f"a sensor of type {self.type} takes no noise figures")
            return self
        try:
            model.model_validate(self.noise)
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(["noise", *(str(part) for part in first["loc"])])
            what = in_words(first)
            if first["type"] == "extra_forbidden":
                what = f"unknown; the choices are: {', '.join(figure_names(self.type))}"
            raise ValueError(f"{key}: {what}") from error
        return self

    @model_validator(mode="after")
    def _units_are_of_an_imu(self) -> SensorCard:
        stated = [key for key in ("gyro_unit", "accel_unit") if key in self.model_fields_set]
        if stated and self.type != "imu":
            raise ValueError(f"{stated[0]} is of an imu; a {self.type} has columns to scale")
        return self

    @model_validator(mode="after")
    def _repeats_are_of_measurements(self) -> SensorCard:
        kinds = [series.TYPE for series in MEASURED]
        if self.drop_repeats and self.type not in kinds:
            raise ValueError(
                f"drop_repeats is of: {', '.join(kinds)}; samples of {self.type} may well be equal"
            )
        return self

    @classmethod
    def types(cls) -> tuple[str, ...]:
        """Sensor types that may be named."""
        return tuple(SERIES_TYPES)

    @property
    def gyro_factor(self) -> float:
        """What turns the file's rates into rad/s."""
        return float(np.radians(1.0)) if self.gyro_unit == "deg/s" else 1.0

    @property
    def accel_factor(self) -> float:
        """What turns the file's specific forces into m/s^2."""
        return STANDARD_GRAVITY_M_S2 if self.accel_unit == "g" else 1.0

    @property
    def time_offset_sigma_s(self) -> float:
        """What the stamps may still be off by; zero where the clock is trusted."""
        offset = self.time_offset
        return offset.sigma_s if offset is not None and offset.estimate else 0.0

    @property
    def xyz_b(self) -> Array:
        """Position in the body frame, shape (3,), m."""
        return np.array(self.xyz_m)

    @property
    def R_bs(self) -> Array:  # noqa: N802
        """Rotation from sensor to body axes, shape (3, 3)."""
        return rotation_from_rpy(np.radians(self.rpy_deg))


class CardOrigin(Described):
    """Where a data set's local frame begins: at its first valid fix, whose own height counts
    where none is stated."""

    policy: Literal["first_fix"] = "first_fix"
    height_m: FiniteFloat | None = None


class CardFile(Described):
    """One file of a data set, by the end of its name."""

    suffix: str
    holds: str
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = None


class MotionConstraints(Described):
    """How the vehicle can move: the fields of `gtsam_nav.mission.Constraints`."""

    nonholonomic: bool = False
    zero_velocity: bool = False
    constant_depth: bool = False

    def to_constraints(self) -> Constraints:
        """The same as the mission holds them."""
        return Constraints(self.nonholonomic, self.zero_velocity, self.constant_depth)


class Card(Described):
    """What is known about a data set beside its files."""

    name: str
    description: str
    source: str
    licence: str
    files: tuple[CardFile, ...]
    origin: CardOrigin = CardOrigin()
    constraints: MotionConstraints = MotionConstraints()
    sensors: dict[str, SensorCard]

    @model_validator(mode="before")
    @classmethod
    def _types_default_to_names(cls, given: Any) -> Any:
        return with_default_types(given)


def with_default_types(given: Any) -> Any:
    """A map with ``sensors``, each of which has a type: its name unless it states another."""
    if not isinstance(given, dict) or not isinstance(given.get("sensors"), dict):
        return given
    sensors = {
        name: {"type": name, **entry} if isinstance(entry, dict) else entry
        for name, entry in given["sensors"].items()
    }
    return {**given, "sensors": sensors}


def load_card(name: str) -> Card:
    """The card of a data set.

    Raises
    ------
    DataError
        Where there is no such card, or it is damaged.
    """
    for folder in CARD_FOLDERS:
        path = folder / f"{name}.yaml"
        if path.is_file():
            return read_yaml(path, Card)
    known = sorted({path.stem for folder in CARD_FOLDERS for path in folder.glob("*.yaml")})
    raise DataError(f"no data-set card '{name}'; the cards are: {', '.join(known) or 'none'}")


def read_yaml(path: Path, model: type[Model], section: str | None = None) -> Model:
    """Read and validate a YAML file, or one section of it.

    Raises
    ------
    DataError
        Names the file, the key and the choices.
    """
    try:
        tree = read_yaml_file(path)
    except YamlError as error:
        raise DataError(str(error), path, error.line) from error
    if section is not None:
        tree = tree.get(section) if isinstance(tree, dict) else None
    if not isinstance(tree, dict):
        where = "must" if section is None else f"the section '{section}' must"
        raise DataError(f"{where} be a map with the keys {', '.join(model.model_fields)}", path)
    try:
        return model.model_validate(tree)
    except ValidationError as error:
        raise DataError(first_fault(error), path) from error


def with_mission(path: Path | None) -> Path | None:
    """The path again where it is a YAML file with a section ``mission``, a mission's card."""
    try:
        tree = None if path is None else read_yaml_file(path)
    except YamlError:
        return None
    return path if isinstance(tree, dict) and MISSION_SECTION in tree else None
