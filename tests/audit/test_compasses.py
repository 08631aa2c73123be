"""Two compasses beside each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gtsam_nav.audit.compasses import compass_findings
from gtsam_nav.frames import wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import HeadingSeries

T = np.arange(0.0, 200.0, 0.1)
HEADING = 0.05 * T


def severities(offset_deg: float, *, late_s: float = 0.0, **noise: Any) -> list[str]:
    rng = np.random.default_rng(6)

    def compass(name: str, turned_deg: float, later_s: float, figures: dict[str, Any]) -> Sensor:
        read = wrap_angle(HEADING + np.radians(turned_deg) + rng.normal(0.0, 0.02, len(T)))
        series = HeadingSeries(t=T + later_s, heading=read, sigma=np.full(len(T), 0.02))
        return Sensor(name, "heading", series, noise=figures)

    sensors = (compass("a", 0.0, 0.0, {}), compass("b", offset_deg, late_s, noise))
    mission = Mission("two", {s.name: s for s in sensors})
    return [f.severity for f in compass_findings(mission, ())]


@pytest.mark.parametrize("offset_deg", [0.0, 6.0, -6.0, 360.0])
def test_those_that_agree_but_for_iron_are_in_order(offset_deg: float) -> None:
    assert severities(offset_deg) == ["ok"]


@pytest.mark.parametrize("offset_deg", [40.0, -90.0, 180.0])
def test_those_that_point_apart_are_warned_of(offset_deg: float) -> None:
    assert severities(offset_deg) == ["warning"]


def test_what_the_cards_say_is_taken_into_account() -> None:
    assert severities(-40.0, declination_deg=40.0) == ["ok"]
    assert severities(40.0, bias_sigma_deg=20.0) == ["ok"]


def test_without_a_common_time_nothing_is_said() -> None:
    assert severities(40.0, late_s=1e4) == []
