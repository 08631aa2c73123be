"""Which receiver comes first."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.first_fixes import USELESS_SIGMA_M
from gtsam_nav.preprocess.receivers import with_best_receiver_first
from gtsam_nav.series import DepthSeries, GnssSeries


def fixes(sigma_m: float, first_s: float = 0.0) -> GnssSeries:
    t = np.arange(first_s, 60.0)
    return GnssSeries(t=t, p_n=np.zeros((len(t), 3)), sigma=np.full((len(t), 3), sigma_m))


def aboard(**receivers: GnssSeries) -> Mission:
    sensors = {name: Sensor(name, "gnss", series) for name, series in receivers.items()}
    t = np.arange(60.0)
    depth = Sensor("depth", "depth", DepthSeries(t=t, depth_m=0 * t, sigma=0 * t + 1))
    return Mission("two receivers", {**sensors, "depth": depth})


@pytest.mark.parametrize(
    ("second", "order"),
    [
        (fixes(0.02), ["b", "a"]),
        (fixes(3.0), ["a", "b"]),
        (fixes(1.2), ["a", "b"]),
        (fixes(0.02, first_s=20.0), ["a", "b"]),
        (fixes(USELESS_SIGMA_M), ["a", "b"]),
    ],
    ids=["better", "worse", "as good", "better, but late", "velocities alone"],
)
def test_the_best_comes_first_unless_it_begins_late(second: GnssSeries, order: list[str]) -> None:
    mission = with_best_receiver_first(aboard(a=fixes(1.2), b=second))
    assert [sensor.name for sensor in mission.of_type("gnss")] == order
    assert mission.sensors.keys() == {"a", "b", "depth"}
