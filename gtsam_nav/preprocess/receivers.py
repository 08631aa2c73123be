"""Which of several GNSS receivers is asked where one is enough: for the start, or the course."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.alignment import PUNCTUAL_S
from gtsam_nav.preprocess.first_fixes import located
from gtsam_nav.series import GnssSeries


def with_best_receiver_first(mission: Mission) -> Mission:
    """The mission with its receivers in the order of their sigmas; what begins late comes last."""
    receivers = mission.of_type("gnss")
    if len(receivers) < 2:
        return mission
    begin_s = min(float(receiver.series.t[0]) for receiver in receivers)

    def rank(receiver: Sensor) -> tuple[bool, float]:
        series = receiver.series
        assert isinstance(series, GnssSeries)
        known = located(series)
        if not np.any(known):
            return True, np.inf
        late = float(series.t[known][0]) > begin_s + PUNCTUAL_S
        return late, float(np.median(series.sigma[known, :2]))

    ranked = sorted(receivers, key=rank)
    if ranked == receivers:
        return mission
    moved = {receiver.name: receiver for receiver in ranked}
    others = {name: s for name, s in mission.sensors.items() if name not in moved}
    return replace(mission, sensors={**others, **moved})
