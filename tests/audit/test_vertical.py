"""Up and down by three sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.audit.vertical import reversed_heave, vertical_findings, vertical_pairs
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import DepthSeries, DvlSeries, ImuSeries

T = np.arange(0.0, 300.0, 0.05)
PERIODS_S, PHASES = (3.1, 4.4, 5.9), (0.0, 1.0, 2.5)
DEPTH = sum(0.05 * np.sin(2 * np.pi * T / p + a) for p, a in zip(PERIODS_S, PHASES, strict=True))
SPEED = np.gradient(DEPTH, T)


def mission(dvl: float = 1.0, depth: float = 1.0, accel: float = 1.0) -> Mission:
    """With signs of the three sensors' vertical axes."""
    rng = np.random.default_rng(3)
    force = np.gradient(SPEED, T) - 9.8
    t = T[::4]
    n = len(t)
    sensors = [
        Sensor(
            "imu",
            "imu",
            ImuSeries(
                t=T,
                gyro_i=np.zeros((len(T), 3)),
                accel_i=np.outer(accel * force, [0.0, 0.0, 1.0]) + rng.normal(0, 0.02, (len(T), 3)),
            ),
        ),
        Sensor(
            "dvl",
            "dvl",
            DvlSeries(
                t=t,
                v_d=np.outer(dvl * SPEED[::4], [0.0, 0.0, 1.0]) + rng.normal(0, 0.02, (n, 3)),
                sigma=np.full(n, 0.02),
                valid=np.ones(n, dtype=bool),
                bottom_lock=np.ones(n, dtype=bool),
            ),
        ),
        Sensor(
            "depth",
            "depth",
            DepthSeries(
                t=T[::8], depth_m=depth * DEPTH[::8] + rng.normal(0, 0.01, len(T[::8])),
                sigma=np.full(len(T[::8]), 0.01),
            ),
        ),
    ]  # fmt: skip
    return Mission("waves", {s.name: s for s in sensors})


def fixes(of: Mission, upside_down: bool = False) -> dict[str | None, str]:
    heave = reversed_heave(of, vertical_pairs(of), upside_down)
    return {f.sensor: f.fix for f in vertical_findings(of, heave)}


def test_three_that_agree() -> None:
    pairs = vertical_pairs(mission())
    assert {p.pair for p in pairs} == {("dvl", "imu"), ("depth", "imu"), ("depth", "dvl")}
    for pair in pairs:
        assert pair.agreement.gain == pytest.approx(1.0, abs=0.3)
        assert abs(pair.agreement.lag_s) < 0.1
    assert fixes(mission()) == {}


def test_the_one_that_contradicts_both_others_is_reversed() -> None:
    assert fixes(mission(dvl=-1.0)) == {"dvl": "scale: {vz: -1}"}
    assert fixes(mission(depth=-1.0)) == {"depth": "scale: {depth_m: -1}"}
    assert fixes(mission(accel=-1.0)) == {}


def test_an_accelerometer_that_is_upside_down_is_no_witness() -> None:
    assert fixes(mission(accel=-1.0).without("depth"), upside_down=True) == {}
    assert fixes(mission(dvl=-1.0, accel=-1.0), upside_down=True).keys() == {"dvl", "depth"}


def test_a_gauge_that_flies_counts_upward() -> None:
    calm = mission().sensors["depth"]
    dived = Mission("calm", {"depth": replace(calm, series=replace(calm.series, depth_m=T[::8]))})
    assert fixes(dived) == {}
    flying = replace(calm, series=replace(calm.series, depth_m=-T[::8]))
    assert fixes(Mission("calm", {"depth": flying})) == {"depth": "scale: {depth_m: -1}"}
