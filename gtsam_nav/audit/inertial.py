"""Units, signs and mounting of an IMU, and the rest at the start."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtsam_nav.audit.findings import Finding
from gtsam_nav.frames import Array
from gtsam_nav.mission import Sensor
from gtsam_nav.series import HeadingSeries, ImuSeries

GRAVITY_M_S2 = 9.81
ACCEL_UNITS = (("g", 1.0), ("m/s^2", GRAVITY_M_S2), ("cm/s^2", 981.0), ("mg", 1000.0))
"""What the length of the specific force reads at rest in the units that logs come in."""

FASTEST_TURN_RAD_S = 6.0
"""No vehicle this package is for turns faster."""


def inertial_findings(imu: Sensor, heading: Sensor | None) -> Iterator[Finding]:
    """Check units and signs of an IMU.

    Parameters
    ----------
    imu : Sensor
        Of type imu.
    heading : Sensor, optional
        Its turns say in which unit and sign the gyroscope reads.
    """
    series = imu.series
    assert isinstance(series, ImuSeries)
    yield _accelerometer_unit(imu.name, series.accel_i)
    yield _gravity_direction(imu.name, series.accel_i @ imu.R_bs.T)
    yaw_rate = series.gyro_i @ imu.R_bs[2]
    turns = None if heading is None else _turn_ratio(series.t, yaw_rate, heading)
    yield _gyro_range(imu.name, series.gyro_i) if turns is None else _gyro_turns(imu.name, turns)


def _accelerometer_unit(name: str, accel_i: Array) -> Finding:
    length = float(np.median(np.linalg.norm(accel_i, axis=1)))
    unit, nominal = min(ACCEL_UNITS, key=lambda choice: abs(np.log(max(length, 1e-9) / choice[1])))
    read = f"median specific force {length:.4g}"
    if abs(length / nominal - 1.0) > 0.1:
        return Finding("accelerometer unit", name, "warning", f"{read} is gravity in no known unit")
    if unit != "m/s^2":
        return Finding("accelerometer unit", name, "warning", f"{read}: in {unit}, not in m/s^2")
    return Finding("accelerometer unit", name, "ok", f"{read} m/s^2")


def _gravity_direction(name: str, accel_b: Array) -> Finding:
    mean_b = np.median(accel_b, axis=0)
    share = mean_b / max(float(np.linalg.norm(mean_b)), 1e-9)
    axis = "xyz"[int(np.argmax(np.abs(share)))]
    read = f"median in body axes ({mean_b[0]:.2f}, {mean_b[1]:.2f}, {mean_b[2]:.2f})"
    if share[2] < -0.9:
        return Finding("gravity sign", name, "ok", f"{read}: z is down")
    if share[2] > 0.9:
        return Finding(
            "gravity sign", name, "warning", f"{read}: z is up; turn the mounting by rpy_deg 180"
        )
    return Finding(
        "gravity sign",
        name,
        "warning",
        f"{read}: gravity lies mostly along {axis}; at rest body z must read about -9.8",
    )


def _turn_ratio(t: Array, yaw_rate: Array, heading: Sensor) -> tuple[float, float] | None:
    """Turn seen by the compass over turn seen by the gyroscope, and their correlation."""
    series = heading.series
    assert isinstance(series, HeadingSeries)
    grid = np.arange(max(t[0], series.t[0]), min(t[-1], series.t[-1]), 2.0)
    if len(grid) < 20:
        return None
    steps = np.diff(t, prepend=t[0])
    turned = np.diff(np.interp(grid, t, np.cumsum(yaw_rate * steps)))
    compass = np.diff(np.interp(grid, series.t, np.unwrap(series.heading)))
    if np.std(compass) < np.radians(0.5) or np.std(turned) == 0.0:
        return None
    correlation = float(np.corrcoef(turned, compass)[0, 1])
    return float(np.std(compass) / np.std(turned)), correlation


def _gyro_turns(name: str, turns: tuple[float, float]) -> Finding:
    ratio, correlation = turns
    read = f"compass turns {ratio:.3g} times what the gyro's z integrates to"
    if abs(correlation) < 0.7:
        message = f"gyro and compass turns do not go together (correlation {correlation:.2f})"
        return Finding("gyro unit", name, "warning", message)
    if correlation < 0:
        message = f"{read}, in the other direction: the sign of body z is wrong"
        return Finding("gyro unit", name, "warning", message)
    if abs(ratio * 180.0 / np.pi - 1.0) < 0.3:
        return Finding("gyro unit", name, "warning", f"{read}: in deg/s, not in rad/s")
    if abs(ratio - 1.0) > 0.3:
        return Finding("gyro unit", name, "warning", f"{read}; about 1 is expected")
    return Finding("gyro unit", name, "ok", f"{read}, correlation {correlation:.2f}")


def _gyro_range(name: str, gyro_i: Array) -> Finding:
    fastest = float(np.percentile(np.abs(gyro_i), 99))
    if fastest > FASTEST_TURN_RAD_S:
        message = f"99 % of the rates are below {fastest:.3g}: probably in deg/s, not in rad/s"
        return Finding("gyro unit", name, "warning", message)
    return Finding("gyro unit", name, "ok", f"99 % of the rates are below {fastest:.3g} rad/s")
