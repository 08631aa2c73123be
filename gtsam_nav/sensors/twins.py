"""Several sensors of a type of which one is taken."""

from __future__ import annotations

from gtsam_nav.mission import Sensor


def said_of_twin(sensor: Sensor, choice: str) -> str:
    """A warning of a sensor that gives way to another of its type, by what is chosen."""
    return f"'{sensor.name}' is left out: of several sensors of type {sensor.type} {choice}"
