"""Headings in radians, told by others' turns, by the course over ground, or by themselves."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.audit import audit
from gtsam_nav.audit.findings import Finding
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import DvlSeries, GnssSeries, HeadingSeries

T = np.arange(0.0, 400.0, 0.2)
CIRCLES = 0.05 * T + 0.5 * np.sin(T / 9.0)
FIX = "scale: {heading_deg: 57.29578}"


def compass(heading: Array, *, radians: bool = False, declination_deg: float = 0.0) -> Sensor:
    noisy = heading + np.random.default_rng(1).normal(0.0, 0.01, len(T))
    read = np.radians(wrap_angle(noisy)) if radians else noisy
    series = HeadingSeries(t=T, heading=read, sigma=np.full(len(T), 0.01))
    noise = {"declination_deg": declination_deg} if declination_deg else {}
    return Sensor("heading", "heading", series, noise=noise)


def dvl() -> Sensor:
    n = len(T)
    v_d = np.tile([1.5, 0.0, 0.0], (n, 1)) + np.random.default_rng(2).normal(0.0, 0.02, (n, 3))
    good = np.ones(n, dtype=bool)
    series = DvlSeries(t=T, v_d=v_d, sigma=np.full(n, 0.02), valid=good, bottom_lock=good)
    return Sensor("dvl", "dvl", series)


def gnss(heading: Array) -> Sensor:
    steps = 1.5 * 0.2 * np.column_stack([np.cos(heading), np.sin(heading), 0 * T])
    p_n = np.cumsum(steps, axis=0)[::5]
    p_n = p_n + np.random.default_rng(3).normal(0.0, 0.1, p_n.shape)
    return Sensor("gnss", "gnss", GnssSeries(t=T[::5], p_n=p_n, sigma=np.full(p_n.shape, 0.1)))


def of_compass(*sensors: Sensor) -> list[Finding]:
    found = audit(Mission("circles", {s.name: s for s in sensors})).findings
    return [f for f in found if f.sensor == "heading" and f.severity == "warning"]


@pytest.mark.parametrize("moved", [True, False])
def test_the_course_over_ground_tells_radians(moved: bool) -> None:
    sensors = [compass(CIRCLES, radians=True), gnss(CIRCLES), *([dvl()] if moved else [])]
    (finding,) = of_compass(*sensors)
    assert (finding.check, finding.fix) == ("heading unit", FIX)
    assert "course over ground" in finding.message


def test_a_stated_declination_stays_one() -> None:
    magnetic = compass(CIRCLES - np.radians(20.0), radians=True, declination_deg=20.0)
    assert [f.check for f in of_compass(magnetic, gnss(CIRCLES), dvl())] == ["heading unit"]


def test_alone_it_is_told_by_how_it_wraps() -> None:
    (finding,) = of_compass(compass(CIRCLES, radians=True), dvl())
    assert (finding.check, finding.fix) == ("heading unit", FIX)
    assert "wrap by 6.28" in finding.message


@pytest.mark.parametrize("heading", [0.05 * np.sin(T), 0.1 * np.sign(np.sin(T / 20.0)) * 0.3])
def test_a_way_north_is_in_degrees(heading: Array) -> None:
    assert of_compass(compass(heading), gnss(heading), dvl()) == []
    assert of_compass(compass(heading), dvl()) == []
