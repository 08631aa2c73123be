"""Roll and pitch of an AHRS against those of the IMU: a sign that is reversed.

Gravity and gyro level the vehicle by themselves; waves show in both.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gtsam_nav.audit import fixes
from gtsam_nav.audit.agreement import Agreement, agreement
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.inertial import z_is_up
from gtsam_nav.audit.lagged_products import Signal
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.levelling import MAX_GAP_S, tilt_by
from gtsam_nav.series import AttitudeSeries

SIDES = {"roll": "to port", "pitch": "bow down"}


@dataclass(frozen=True)
class TiltPair:
    """How an AHRS's roll or pitch goes with that of an IMU."""

    attitude: str
    imu: str
    axis: str
    agreement: Agreement


def tilt_pairs(mission: Mission) -> tuple[TiltPair, ...]:
    """Roll and pitch of the first AHRS with those of the first IMU, if they have much in common.

    An IMU whose z is up, or that is too slow to follow waves, is no witness.
    """
    sensor, imu = mission.first("attitude"), mission.first("imu")
    if sensor is None or imu is None or len(imu.series) < 2 or z_is_up(imu):
        return ()
    t = imu.series.t
    if float(np.median(np.diff(t))) > MAX_GAP_S:
        return ()
    series = sensor.series
    assert isinstance(series, AttitudeSeries)
    found = []
    for axis, by_imu in zip(SIDES, tilt_by(imu, t).T, strict=True):
        seen = agreement(Signal(series.t, getattr(series, axis)), Signal(t, by_imu))
        if seen is not None:
            found.append(TiltPair(sensor.name, imu.name, axis, seen))
    return tuple(found)


def tilt_findings(pairs: tuple[TiltPair, ...]) -> Iterator[Finding]:
    """Judge the signs: where both are reversed it may as well be the IMU that is turned about."""
    opposed = [p for p in pairs if p.agreement.gain < 0]
    both = len(opposed) == len(SIDES)
    for pair in opposed:
        message = f"leans {SIDES[pair.axis]} where {pair.imu} leans the other way: reversed"
        if both:
            message += f", unless {pair.imu} is mounted the other way round (rpy_deg: [0, 0, 180])"
        fix = fixes.scale(f"{pair.axis}_deg", -1)
        yield Finding(f"{pair.axis} sign", pair.attitude, "warning", message, fix)
