"""Units, signs and mounting of an IMU, and the rest at the start."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtsam_nav.audit import fixes
from gtsam_nav.audit.findings import Finding
from gtsam_nav.frames import Array
from gtsam_nav.mission import Sensor
from gtsam_nav.preprocess.accelerometer_units import card_line, median_force, unit_of
from gtsam_nav.series import ImuSeries

UPRIGHT = 0.9
"""Share of gravity that lies along an axis that counts as vertical."""

FASTEST_TURN_RAD_S = 6.0
"""No vehicle this package is for turns faster."""


def inertial_findings(imu: Sensor, opposed: bool | None) -> Iterator[Finding]:
    """Check units and signs of an IMU.

    Parameters
    ----------
    imu : Sensor
        Of type imu.
    opposed : bool or None
        Whether its gyro turns the other way than other sensors say; None where nothing else turns,
        and then its unit is judged by what vehicles do.
    """
    series = imu.series
    assert isinstance(series, ImuSeries)
    yield _accelerometer_unit(imu.name, series.accel_i)
    yield _gravity_direction(imu, series.accel_i @ imu.R_bs.T, opposed)
    if opposed is None:
        yield _gyro_range(imu.name, series.gyro_i)


def z_is_up(imu: Sensor) -> bool:
    """Whether gravity pulls along the body's -z."""
    series = imu.series
    assert isinstance(series, ImuSeries)
    return bool(_down_share(series.accel_i @ imu.R_bs.T)[2] > UPRIGHT)


def _accelerometer_unit(name: str, accel_i: Array) -> Finding:
    force = median_force(accel_i)
    unit, read = unit_of(force), f"median specific force {force:.4g}"
    if unit is None:
        return Finding("accelerometer unit", name, "warning", f"{read} is gravity in no known unit")
    if unit == "m/s^2":
        return Finding("accelerometer unit", name, "ok", f"{read} m/s^2")
    message = f"{read}: in {unit}, not in m/s^2"
    return Finding("accelerometer unit", name, "warning", message, card_line(unit))


def _down_share(accel_b: Array) -> Array:
    """Direction of the median specific force, (3,), of unit length."""
    mean_b = np.median(accel_b, axis=0)
    return np.asarray(mean_b / max(float(np.linalg.norm(mean_b)), 1e-9))


def _levelling(share: Array) -> Array:
    """The shortest turn that brings gravity where it belongs, of the body, (3, 3)."""
    from scipy.spatial.transform import Rotation

    across = np.cross(share, [0.0, 0.0, -1.0])
    angle = np.arccos(np.clip(-share[2], -1.0, 1.0))
    return np.asarray(Rotation.from_rotvec(angle * across / np.linalg.norm(across)).as_matrix())


def _gravity_direction(imu: Sensor, accel_b: Array, opposed: bool | None) -> Finding:
    mean_b, share = np.median(accel_b, axis=0), _down_share(accel_b)
    axis = "xyz"[int(np.argmax(np.abs(share)))]
    read = f"median in body axes ({mean_b[0]:.2f}, {mean_b[1]:.2f}, {mean_b[2]:.2f})"

    def warning(message: str, fix: str) -> Finding:
        return Finding("gravity sign", imu.name, "warning", f"{read}: {message}", fix)

    if share[2] < -UPRIGHT:
        return Finding("gravity sign", imu.name, "ok", f"{read}: z is down")
    length = np.maximum(np.linalg.norm(accel_b, axis=1), 1e-9)
    if np.linalg.norm(np.mean(accel_b / length[:, None], axis=0)) < UPRIGHT:
        return Finding("gravity sign", imu.name, "ok", f"{read}: the body turns over, undecided")
    if share[2] < UPRIGHT:
        return warning(
            f"gravity lies mostly along {axis}; at rest body z must read about -9.8",
            fixes.mounting(_levelling(share) @ imu.R_bs),
        )
    turned = fixes.mounting(np.diag([1.0, -1.0, -1.0]) @ imu.R_bs)
    negated = fixes.scale("ax ay az", -1)
    if opposed is None:
        return warning("z is up, or gravity is counted as a force", f"{turned}, or {negated}")
    if opposed:
        return warning("z is up (FLU axes), and the gyro turns the other way too", turned)
    return warning("gravity is counted as a force: the gyro's z is down", negated)


def _gyro_range(name: str, gyro_i: Array) -> Finding:
    fastest = float(np.percentile(np.abs(gyro_i), 99))
    if fastest > FASTEST_TURN_RAD_S:
        message = f"99 % of the rates are below {fastest:.3g}: probably in deg/s, not in rad/s"
        return Finding("gyro unit", name, "warning", message, "gyro_unit: deg/s")
    return Finding("gyro unit", name, "ok", f"99 % of the rates are below {fastest:.3g} rad/s")
