"""Accelerometers whose samples are in another unit than m/s^2."""

from __future__ import annotations

import numpy as np

from gtsam_nav.card_lines import scale
from gtsam_nav.errors import DataError
from gtsam_nav.frames import STANDARD_GRAVITY_M_S2, Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import ImuSeries

UNITS = {
    "g": 1.0,
    "m/s^2": STANDARD_GRAVITY_M_S2,
    "cm/s^2": 100.0 * STANDARD_GRAVITY_M_S2,
    "mg": 1000.0,
}
"""What the length of the specific force reads at rest in the units that logs come in."""
WITHIN = 0.1
"""The median over an outing is gravity's within this share: nothing falls, or climbs, for long."""


def median_force(accel_i: Array) -> float:
    """Median length of the specific force (n, 3), in its own unit."""
    return float(np.median(np.linalg.norm(accel_i, axis=1)))


def unit_of(force: float) -> str | None:
    """In which of `UNITS` a median specific force is gravity's; None in none of them."""
    unit = min(UNITS, key=lambda u: abs(force / UNITS[u] - 1.0))
    return unit if abs(force / UNITS[unit] - 1.0) <= WITHIN else None


def card_line(unit: str) -> str:
    """What an IMU's card says of samples in another unit than m/s^2."""
    return (
        "accel_unit: g" if unit == "g" else scale("ax ay az", STANDARD_GRAVITY_M_S2 / UNITS[unit])
    )


def check_accelerometer_unit(mission: Mission, imu: Sensor) -> None:
    """Refuse to integrate specific forces that are gravity's in another unit than m/s^2.

    Raises
    ------
    DataError
        Naming the sensor, and the line of its card that mends it.
    """
    assert isinstance(imu.series, ImuSeries)
    if not len(imu.series):
        return
    force = median_force(imu.series.accel_i)
    unit = unit_of(force)
    if unit in (None, "m/s^2"):
        return
    taken_out = " (where gravity was taken out of it, it cannot be used)" if unit == "g" else ""
    raise DataError(
        f"mission '{mission.name}', sensor '{imu.name}': its median specific force, {force:.4g}, "
        f"is gravity in {unit}, not in m/s^2{taken_out}; in the mission's card, under sensors: "
        f"{imu.name}: {card_line(unit)}"
    )
