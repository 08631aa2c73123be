"""A card for a file that says what its sensors measured, but not how they are mounted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import Field, model_validator

from gtsam_nav.cards import (
    MISSION_SECTION,
    Described,
    MotionConstraints,
    SensorCard,
    read_yaml,
    with_default_types,
)
from gtsam_nav.errors import DataError
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.readers._mounting import in_body_axes


class FileCard(Described):
    """The section ``mission`` of a file given by ``-c``, for a mission in a single file.

    Attributes
    ----------
    constraints : map, optional
        As in ``mission.yaml``.
    sensors : map of SensorCard
        By the names that `inspect` lists; what is left out stays as the reader has it.
    """

    constraints: MotionConstraints | None = None
    sensors: dict[str, SensorCard] = Field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _types_default_to_names(cls, given: Any) -> Any:
        return with_default_types(given)


def with_card(mission: Mission, path: Path) -> Mission:
    """A mission by what a card says of its sensors.

    Raises
    ------
    DataError
        Where the card is damaged, or names a sensor that the mission does not have.
    """
    card = read_yaml(path, FileCard, MISSION_SECTION)
    for name, entry in card.sensors.items():
        sensor = mission.sensors.get(name)
        if sensor is None:
            choices = ", ".join(sorted(mission.sensors))
            raise DataError(f"no sensor '{name}'; the choices are: {choices}", path)
        if entry.type != sensor.type:
            raise DataError(f"sensor '{name}' is of type {sensor.type}, not {entry.type}", path)
        mission = mission.with_sensor(_mounted(sensor, entry))
    if card.constraints is not None:
        mission = replace(mission, constraints=card.constraints.to_constraints())
    return replace(mission, sources=(*mission.sources, path))


def _mounted(sensor: Sensor, entry: SensorCard) -> Sensor:
    stated = entry.model_fields_set
    known = "time_offset" in stated
    clocked = replace(
        sensor,
        series=sensor.series.shift(entry.time_offset_s),
        noise={**sensor.noise, **entry.noise},
        time_offset_sigma_s=entry.time_offset_sigma_s if known else sensor.time_offset_sigma_s,
    )
    if not stated & {"xyz_m", "rpy_deg"}:
        return clocked
    # of a scanner's points the reader knew no better than that they are the body's
    return in_body_axes(replace(clocked, xyz_b=entry.xyz_b, R_bs=entry.R_bs))
