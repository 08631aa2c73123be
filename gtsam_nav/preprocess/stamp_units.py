"""Sensors whose stamps count something smaller than seconds."""

from __future__ import annotations

import numpy as np

from gtsam_nav.card_lines import scale
from gtsam_nav.errors import DataError
from gtsam_nav.mission import Mission, Sensor

UNITS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""What else stamps are counted in, s."""
WITHIN = 2.0
"""Sensors of one outing speak for about as long, within this factor ..."""
FASTEST_S = 1e-3
"""... and none more often than this, once its stamps are in seconds."""


def smaller_units(mission: Mission) -> dict[str, str]:
    """Whose stamps are in another unit, and in which of `UNITS`.

    A sensor is told by its span, a power of thousand longer than that of most others, and by
    intervals that suit the unit.
    """
    spans_s = {
        name: float(s.series.t[-1] - s.series.t[0])
        for name, s in mission.sensors.items()
        if s.type != "reference" and len(np.unique(s.series.t)) > 1
    }
    found = {}
    for name, span_s in spans_s.items():
        others_s = [other_s for other, other_s in spans_s.items() if other != name]
        if others_s and (unit := _unit(mission.sensors[name], span_s, float(np.median(others_s)))):
            found[name] = unit
    return found


def _unit(sensor: Sensor, span_s: float, usual_s: float) -> str | None:
    interval_s = float(np.median(np.diff(np.unique(sensor.series.t))))
    for unit, seconds in UNITS.items():
        if (
            usual_s / WITHIN < span_s * seconds < usual_s * WITHIN
            and interval_s * seconds >= FASTEST_S
        ):
            return unit
    return None


def in_other_unit(sensor: Sensor, unit: str) -> str:
    """What is wrong with its stamps."""
    span_s = float(sensor.series.t[-1] - sensor.series.t[0])
    return (
        f"its samples span {span_s:.0f} s, {1 / UNITS[unit]:g} times the others' time: "
        f"its stamps are in {unit}, not in s"
    )


def check_stamp_units(mission: Mission) -> None:
    """Refuse a mission that would last a thousand times as long as it did.

    Raises
    ------
    DataError
        Naming the sensor, and the line of its card that mends it.
    """
    for name, unit in smaller_units(mission).items():
        raise DataError(
            f"mission '{mission.name}', sensor '{name}': "
            f"{in_other_unit(mission.sensors[name], unit)}; "
            f"in the mission's card, under sensors: {name}: {scale('t', UNITS[unit])}, "
            "or leave the sensor out"
        )
