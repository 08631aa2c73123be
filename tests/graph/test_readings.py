"""Readings' factors, made together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gtsam
import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.frames import rotation_from_rpy
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import L, X
from gtsam_nav.graph.measurements.sightings import Seen, SightingFactors
from gtsam_nav.graph.readings import Reading, StateAt, as_given, made
from gtsam_nav.graph.robust import GatedRobustness
from gtsam_nav.mission import Sensor
from gtsam_nav.sensors.landmarks import Sighting


def test_each_kind_is_made_once_and_all_keep_their_order() -> None:
    calls: list[list[int]] = []

    def tens(rows: Sequence[int], state_at: StateAt) -> list[Any]:
        calls.append(list(rows))
        return [10 * row + state_at(0) for row in rows]

    given = as_given("abc")
    readings = [
        Reading(float(i), "sensor", i, maker, row, GatedRobustness(), "outlier")
        for i, (maker, row) in enumerate([(tens, 2), (given, 0), (tens, 1), (given, 2)])
    ]
    assert made(readings, lambda _: 5) == [25, "a", 15, "c"]
    assert calls == [[2, 1]]
    assert made([], lambda _: 5) == []


@pytest.mark.parametrize("elevation", [None, 0.1])
@pytest.mark.parametrize("planar", [False, True])
def test_sightings_made_together_are_those_made_alone(
    elevation: float | None, planar: bool
) -> None:
    """Level ones among others; ranges or bearings that lack; a landmark in the sensor itself."""
    rng = np.random.default_rng(3)
    series = gn.simulate("ranger", seed=0).sensors["landmarks"].series
    sensor = Sensor("landmarks", "landmarks", series, rng.normal(size=3), np.eye(3))
    values = gtsam.Values()
    seen = []
    for k, (range_m, bearing) in enumerate([(5.0, 3.0), (None, 0.4), (7.0, None), (1.0, -3.1)]):
        R_nb, p_n = rotation_from_rpy([0.1, -0.05, 2.0 * k]), rng.normal(size=3)
        landmark_n = p_n + (R_nb @ sensor.xyz_b if k == 3 else 5.0 * rng.normal(size=3))
        values.insert(X(k), factors.nav_state(R_nb, p_n, np.zeros(3)))
        values.insert(L(k), factors.nav_state(np.eye(3), landmark_n, np.zeros(3)))
        sighting = Sighting(range_m, bearing, elevation, 0.2, 0.05)
        level = elevation is None and k % 2 == 0
        seen.append(Seen(k, int(L(k)), sighting, sensor, level, planar, excess=1.0 + k))
    together = SightingFactors(seen)(range(4), values.atNavState)
    for own, factor in zip(seen, together, strict=True):
        (alone,) = SightingFactors([own])([0], values.atNavState)
        assert factor.equals(alone, 1e-9)
        assert np.all(np.isfinite(factor.whitenedError(values)))
