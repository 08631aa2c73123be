"""A card for a file that says what its sensors measured, but not how they are mounted."""

from __future__ import annotations

from collections.abc import Mapping
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
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.repeats import without_repeats
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.readers._figures import Figures
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

    def figures(self, types: Mapping[str, str]) -> Figures:
        """The noise figures that it states of sensors of these types."""
        return {
            name: entry.noise
            for name, entry in self.sensors.items()
            if entry.type == types.get(name)
        }

    @model_validator(mode="before")
    @classmethod
    def _types_default_to_names(cls, given: Any) -> Any:
        return with_default_types(given)


def read_file_card(path: Path) -> FileCard:
    """The section ``mission`` of a file.

    Raises
    ------
    DataError
        Where the card is damaged.
    """
    return read_yaml(path, FileCard, MISSION_SECTION)


def with_card(mission: Mission, card: FileCard, path: Path) -> Mission:
    """A mission by what a card, of this path, says of its sensors.

    Raises
    ------
    DataError
        Where the card names a sensor that the mission does not have.
    """
    for name, entry in card.sensors.items():
        sensor = mission.sensors.get(name)
        if sensor is None:
            choices = ", ".join(sorted(mission.sensors))
            raise DataError(f"no sensor '{name}'; the choices are: {choices}", path)
        if entry.type != sensor.type:
            raise DataError(f"sensor '{name}' is of type {sensor.type}, not {entry.type}", path)
        repeats: list[Rejection] = []
        if entry.drop_repeats:
            series, repeats = without_repeats(name, sensor.series)
            sensor = replace(sensor, series=series)
        mission = replace(
            mission.with_sensor(_mounted(sensor, entry)),
            rejections=(*mission.rejections, *repeats),
        )
    if card.constraints is not None:
        mission = replace(mission, constraints=card.constraints.to_constraints())
    return _on_other_clocks(replace(mission, sources=(*mission.sources, path)), card)


def _mounted(sensor: Sensor, entry: SensorCard) -> Sensor:
    stated = entry.model_fields_set
    known = "time_offset" in stated
    described = replace(
        sensor,
        noise={**sensor.noise, **entry.noise},
        time_offset_sigma_s=entry.time_offset_sigma_s if known else sensor.time_offset_sigma_s,
    )
    if not stated & {"xyz_m", "rpy_deg"}:
        return described
    # of a scanner's points the reader knew no better than that they are the body's
    return in_body_axes(replace(described, xyz_b=entry.xyz_b, R_bs=entry.R_bs))


def _on_other_clocks(mission: Mission, card: FileCard) -> Mission:
    """The mission with the offsets that a card states, and the zero that comes of them."""
    offsets = dict.fromkeys([*mission.sensors, *(r.sensor for r in mission.rejections)], 0.0)
    offsets |= {name: entry.time_offset_s for name, entry in card.sensors.items()}
    if not any(offsets.values()):
        return mission
    moved = on_mission_time(replace(mission, warnings=()), offsets)
    new = (warning for warning in moved.warnings if warning not in mission.warnings)
    return replace(moved, warnings=(*mission.warnings, *new))
