"""The card of a bag: which topics are which sensors, and how these are mounted."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, FiniteFloat, model_validator

from gtsam_nav.cards import (
    MISSION_SECTION,
    Described,
    MotionConstraints,
    SensorCard,
    with_default_types,
)
from gtsam_nav.readers._mission_yaml import GeodeticPosition, InitialEntry

SEA_WATER_KG_M3 = 1025.0
STANDARD_ATMOSPHERE_PA = 101325.0


class BagSensor(SensorCard):
    """A topic as a sensor.

    Attributes
    ----------
    topic : str
        May be left out where only one topic can be this sensor.
    stamp : {"header", "log"}, optional
        Whose time counts; where it is left out the bag's clocks are compared.
    clockwise : bool
        Of a scanning sonar: whether its angle grows clockwise about its own z axis (down).
    surface_pressure_pa, water_density_kg_m3 : float
        Turn a pressure into a depth.
    scale, offset_m : float
        Turn a bare number into a depth: ``scale * number + offset_m``.
    """

    topic: str = ""
    stamp: Literal["header", "log"] | None = None
    clockwise: bool = True
    surface_pressure_pa: FiniteFloat = Field(default=STANDARD_ATMOSPHERE_PA, gt=0)
    water_density_kg_m3: FiniteFloat = Field(default=SEA_WATER_KG_M3, gt=0)
    scale: FiniteFloat = 1.0
    offset_m: FiniteFloat = 0.0

    @property
    def is_mounted(self) -> bool:
        """Whether the card says where the sensor sits."""
        return bool(self.model_fields_set & {"xyz_m", "rpy_deg"})


class BagCard(Described):
    """The section ``mission`` of a file given by ``-c``.

    Attributes
    ----------
    name : str
        The bag's where it is left out.
    body_frame : str
        Frame of the body in ``tf_static``; ``base_link`` or the tree's root where left out.
    origin : map, optional
        Of the local frame; the first fix where it is left out.
    initial, constraints : map, optional
        As in ``mission.yaml``.
    sensors : map of BagSensor
    """

    name: str = ""
    body_frame: str = ""
    origin: GeodeticPosition | None = None
    initial: InitialEntry = InitialEntry()
    constraints: MotionConstraints = MotionConstraints()
    sensors: dict[str, BagSensor] = Field(min_length=1)

    @model_validator(mode="before")
    @classmethod
    def _types_default_to_names(cls, given: Any) -> Any:
        return with_default_types(given)

    def to_tree(self) -> dict[str, Any]:
        """What the card states, as plain values under ``mission``."""
        tree = self.model_dump(mode="json", exclude_unset=True)
        for name, entry in tree["sensors"].items():
            kind = {} if entry["type"] == name else {"type": entry["type"]}
            first = {key: entry[key] for key in ("topic", "stamp") if key in entry}
            tree["sensors"][name] = {**kind, **first, **entry}
            if not kind:
                del tree["sensors"][name]["type"]
        return {MISSION_SECTION: tree}
