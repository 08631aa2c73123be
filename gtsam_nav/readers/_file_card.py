"""A card for a file that says what its sensors measured, but not how they are mounted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
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
from gtsam_nav.readers._mounting import ORIENTING_TYPES, in_body_axes
from gtsam_nav.series import ScanSeries


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
    series = sensor.series.shift(entry.time_offset_s)
    stated, xyz_b, R_bs = entry.model_fields_set, sensor.xyz_b, sensor.R_bs
    if stated & {"xyz_m", "rpy_deg"}:
        xyz_b, R_bs = entry.xyz_b, entry.R_bs
        if isinstance(series, ScanSeries):
            # points are in the body's axes, where the reader knew no better than the scanner's
            here = xyz_b[: series.points_b.shape[1]]
            turn = R_bs[: len(here), : len(here)]
            series = replace(series, points_b=here + series.points_b @ turn.T)
        series = in_body_axes(series, R_bs)
        R_bs = np.eye(3) if sensor.type in ORIENTING_TYPES else R_bs
    known = "time_offset" in stated
    return replace(
        sensor,
        series=series,
        xyz_b=xyz_b,
        R_bs=R_bs,
        noise={**sensor.noise, **entry.noise},
        time_offset_sigma_s=entry.time_offset_sigma_s if known else sensor.time_offset_sigma_s,
    )
