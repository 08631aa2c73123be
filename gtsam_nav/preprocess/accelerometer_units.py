"""Accelerometers whose samples are in another unit than m/s^2."""

from __future__ import annotations

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.series import ImuSeries

GRAVITY_M_S2 = 9.80665
UNITS = {"g": 1.0, "m/s^2": GRAVITY_M_S2, "cm/s^2": 980.665, "mg": 1000.0}
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
    if unit == "g":
        return "accel_unit: g"
    factor = GRAVITY_M_S2 / UNITS[unit]
    return f"scale: {{{', '.join(f'{axis}: {factor:.7g}' for axis in ('ax', 'ay', 'az'))}}}"


def check_accelerometer_units(mission: Mission) -> None:
    """Refuse specific forces that are gravity's in another unit: whatever uses them goes astray.

    Raises
    ------
    DataError
        Naming the sensor, and the line of its card that mends it.
    """
    for imu in mission.of_type("imu"):
        assert isinstance(imu.series, ImuSeries)
        if not len(imu.series):
            continue
        force = median_force(imu.series.accel_i)
        unit = unit_of(force)
        if unit not in (None, "m/s^2"):
            raise DataError(
                f"mission '{mission.name}', sensor '{imu.name}': its median specific force is "
                f"{force:.4g}: it is in {unit}, not in m/s^2; in the card: {card_line(unit)}, or "
                f"leave the sensor out"
            )
