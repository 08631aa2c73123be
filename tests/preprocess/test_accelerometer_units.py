"""Specific forces that come in g, or what is smaller still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.audit.inertial import inertial_findings
from gtsam_nav.errors import DataError
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.accelerometer_units import unit_of
from gtsam_nav.series import ImuSeries


@pytest.fixture(scope="module")
def laps() -> Mission:
    return gn.simulate("laps", seed=0, duration_s=20.0)


def in_units_of(mission: Mission, size_m_s2: float) -> Mission:
    """The same mission, its accelerometers reading in a unit of that size."""
    for imu in mission.of_type("imu"):
        assert isinstance(imu.series, ImuSeries)
        series = replace(imu.series, accel_i=imu.series.accel_i / size_m_s2)
        mission = mission.with_sensor(replace(imu, series=series))
    return mission


@pytest.mark.parametrize(
    ("size_m_s2", "unit", "line"),
    [
        (9.80665, "g", "accel_unit: g"),
        (0.01, "cm/s^2", "scale: {ax: 0.01, ay: 0.01, az: 0.01}"),
        (9.80665e-3, "mg", "scale: {ax: 0.00980665, ay: 0.00980665, az: 0.00980665}"),
    ],
)
def test_methods_that_integrate_them_refuse_them_and_name_the_cards_line(
    laps: Mission, size_m_s2: float, unit: str, line: str
) -> None:
    mission = in_units_of(laps, size_m_s2)
    (imu,) = mission.of_type("imu")
    for method in ("graph", "ins-ekf"):
        with pytest.raises(DataError) as refusal:
            gn.estimate(mission, method)
        assert f"gravity in {unit}, not in m/s^2" in str(refusal.value)
        assert str(refusal.value).endswith(f"in the mission's card, under sensors: imu: {line}")
    finding = next(f for f in inertial_findings(imu, None) if f.check == "accelerometer unit")
    assert (finding.severity, finding.fix) == ("warning", line)


def test_who_takes_the_gyro_alone_does_not() -> None:
    marina = gn.simulate("marina", seed=0, duration_s=20.0).without("sonar")
    found = gn.estimate(in_units_of(marina, 9.80665), "dr").trajectory
    np.testing.assert_allclose(found.p_n, gn.estimate(marina, "dr").trajectory.p_n, atol=1e-9)


def test_an_idle_imu_may_be_in_any_unit(laps: Mission) -> None:
    (imu,) = laps.of_type("imu")
    (idle,) = in_units_of(laps, 9.80665).of_type("imu")
    beside = laps.with_sensor(replace(idle, name="second"))
    assert beside.first("imu") == imu
    for method in ("graph", "ins-ekf"):
        assert len(gn.estimate(beside, method).trajectory)


@pytest.mark.parametrize(
    ("force", "unit"),
    [
        (0.89, None),
        (0.91, "g"),
        (1.09, "g"),
        (1.11, None),
        (8.9, "m/s^2"),
        (5.0, None),
        (0.0, None),
    ],
)
def test_a_unit_is_told_within_a_tenth(force: float, unit: str | None) -> None:
    assert unit_of(force) == unit
