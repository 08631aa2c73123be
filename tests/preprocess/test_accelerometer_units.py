"""Specific forces that come in g, or what is smaller still."""

from __future__ import annotations

from dataclasses import replace

import pytest

import gtsam_nav as gn
from gtsam_nav.audit.inertial import inertial_findings
from gtsam_nav.errors import DataError
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.accelerometer_units import check_accelerometer_units
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
def test_a_method_refuses_them_and_names_the_cards_line(
    laps: Mission, size_m_s2: float, unit: str, line: str
) -> None:
    mission = in_units_of(laps, size_m_s2)
    (imu,) = mission.of_type("imu")
    for method in ("graph", "ins-ekf"):
        with pytest.raises(DataError) as refusal:
            gn.estimate(mission, method)
        assert f"sensor '{imu.name}'" in str(refusal.value)
        assert f"it is in {unit}, not in m/s^2; in the card: {line}, or" in str(refusal.value)
    finding = next(f for f in inertial_findings(imu, None) if f.check == "accelerometer unit")
    assert (finding.severity, finding.fix) == ("warning", line)


@pytest.mark.parametrize("size_m_s2", [1.0, 1.05, 3.0])
def test_what_is_no_other_unit_is_not_refused(laps: Mission, size_m_s2: float) -> None:
    check_accelerometer_units(in_units_of(laps, size_m_s2))


def test_without_an_accelerometer_nothing_is(laps: Mission) -> None:
    check_accelerometer_units(laps.without(*(imu.name for imu in laps.of_type("imu"))))
