"""Stamps that count milliseconds, or what is smaller still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.audit.timing import stamp_findings
from gtsam_nav.errors import DataError
from gtsam_nav.methods import estimate
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.stamp_units import smaller_units
from gtsam_nav.series import DepthSeries, GnssSeries, HeadingSeries


def of(t: np.ndarray, kind: str) -> Sensor:
    if kind == "gnss":
        flat = np.zeros((len(t), 3))
        return Sensor(kind, kind, GnssSeries(t=t, p_n=flat, sigma=flat + 1.0))
    if kind == "depth":
        return Sensor(kind, kind, DepthSeries(t=t, depth_m=0 * t, sigma=0 * t + 0.1))
    return Sensor(kind, kind, HeadingSeries(t=t, heading=0 * t, sigma=0 * t + 0.1))


def outing(depth_t: np.ndarray, fixes_s: float = 300.0) -> Mission:
    listed = (
        of(np.arange(0.0, 300.0, 0.1), "heading"),
        of(depth_t, "depth"),
        of(np.linspace(0.0, fixes_s, 60), "gnss"),
    )
    return Mission("outing", {s.name: s for s in listed})


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_stamps_in_a_smaller_unit_are_told(unit: str, factor: float) -> None:
    mission = outing(np.arange(0.0, 290.0, 0.2) * factor)
    assert smaller_units(mission) == {"depth": unit}
    (finding,) = stamp_findings(mission)
    assert (finding.check, finding.sensor) == ("stamp unit", "depth")
    assert finding.fix == f"scale: {{t: {1 / factor:.7g}}}"
    assert f"{factor:g} times the others'" in finding.message


def test_a_method_refuses_them() -> None:
    with pytest.raises(DataError, match=r"sensor 'depth'.*scale: \{t: 0.001\}"):
        estimate(outing(np.arange(0.0, 290.0, 0.2) * 1e3), "dr")


@pytest.mark.parametrize("fixes_s", [0.3, 3.0, 300.0])
def test_sensors_that_speak_for_a_while_only_are_not(fixes_s: float) -> None:
    mission = outing(np.arange(0.0, 0.3, 0.01), fixes_s)
    assert smaller_units(mission) == {}
    assert smaller_units(replace(mission, sensors={})) == {}
