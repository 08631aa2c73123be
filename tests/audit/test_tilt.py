"""Roll and pitch of an AHRS whose sign is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.audit.tilt import tilt_findings, tilt_pairs
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import AttitudeSeries, ImuSeries

G_M_S2 = 9.81


def swaying(roll_sign: float = 1.0, pitch_sign: float = 1.0) -> Mission:
    """A vehicle that rolls and pitches in waves of two lengths."""
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 200.0, 0.05)
    roll = 0.04 * np.sin(0.9 * t) + 0.02 * np.sin(0.33 * t)
    pitch = 0.03 * np.sin(1.1 * t + 1.0) + 0.02 * np.sin(0.27 * t)
    gyro = np.column_stack([np.gradient(roll, t), np.gradient(pitch, t), np.zeros(len(t))])
    accel = G_M_S2 * np.column_stack(
        [np.sin(pitch), -np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch)]
    )
    imu = ImuSeries(
        t=t,
        gyro_i=gyro + rng.normal(0.0, 2e-3, gyro.shape),
        accel_i=accel + rng.normal(0.0, 0.05, accel.shape),
    )
    every = slice(None, None, 2)
    attitude = AttitudeSeries(
        t=t[every],
        roll=roll_sign * roll[every] + rng.normal(0.0, 3e-3, len(t[every])),
        pitch=pitch_sign * pitch[every] + rng.normal(0.0, 3e-3, len(t[every])),
        sigma=np.full(len(t[every]), 3e-3),
    )
    sensors = (Sensor("imu", "imu", imu), Sensor("ahrs", "attitude", attitude))
    return Mission("swaying", {s.name: s for s in sensors})


@pytest.mark.parametrize("roll_sign", [1.0, -1.0])
@pytest.mark.parametrize("pitch_sign", [1.0, -1.0])
def test_the_axis_that_is_reversed_is_named(roll_sign: float, pitch_sign: float) -> None:
    findings = list(tilt_findings(tilt_pairs(swaying(roll_sign, pitch_sign))))
    signs = {"roll": roll_sign, "pitch": pitch_sign}
    expected = [axis for axis, sign in signs.items() if sign < 0]
    assert [f.check for f in findings] == [f"{axis} sign" for axis in expected]
    assert [f.fix for f in findings] == [f"scale: {{{axis}_deg: -1}}" for axis in expected]
    assert all(("rpy_deg" in f.message) == (len(expected) == 2) for f in findings)


def test_an_imu_whose_z_is_up_is_no_witness() -> None:
    mission = swaying(-1.0)
    imu = mission.sensors["imu"]
    turned = mission.with_sensor(replace(imu, R_bs=np.diag([1.0, -1.0, -1.0])))
    assert tilt_pairs(turned) == ()
    assert tilt_pairs(mission.without("imu")) == tilt_pairs(mission.without("ahrs")) == ()
