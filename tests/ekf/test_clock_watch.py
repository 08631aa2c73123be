"""Fixes under late stamps, told by the inertial filter's innovations."""

from __future__ import annotations

from dataclasses import replace

import pytest

import gtsam_nav as gn
from gtsam_nav.mission import Mission


@pytest.fixture(scope="module")
def laps() -> Mission:
    return gn.simulate("laps", seed=1, duration_s=90.0)


def said(mission: Mission) -> list[str]:
    warnings = gn.estimate(mission, "ins-ekf").warnings
    return [warning for warning in warnings if "seems to be" in warning]


@pytest.mark.parametrize("compass", [True, False])
def test_good_stamps_are_not_doubted(laps: Mission, compass: bool) -> None:
    assert said(laps if compass else laps.without("heading")) == []


@pytest.mark.parametrize("compass", [True, False])
def test_fixes_two_seconds_late_are_named(laps: Mission, compass: bool) -> None:
    gnss = laps.sensors["gnss"]
    late = laps.with_sensor(replace(gnss, series=gnss.series.shift(2.0)))
    (warning,) = said(late if compass else late.without("heading"))
    assert "'gnss' seems to be" in warning
    assert " s late (sigma" in warning


@pytest.mark.slow
def test_late_fixes_beside_a_dvl_are_named_with_their_offset() -> None:
    mission = gn.simulate("marina", seed=2, duration_s=300.0)
    gnss = mission.sensors["gnss"]
    (warning,) = said(mission.with_sensor(replace(gnss, series=gnss.series.shift(1.0))))
    offset_s, sigma_s = float(warning.split()[4]), float(warning.split()[8])
    assert offset_s == pytest.approx(1.0, abs=3 * sigma_s)
