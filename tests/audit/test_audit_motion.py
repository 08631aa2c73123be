"""How long the vehicle lies still at first, by what measures its speed."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.audit.motion import initial_rest_s
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import DvlSeries


def dvl(
    rate_hz: float, sigma: float, moves_s: tuple[float, float], jitter_s: float = 0.0
) -> Mission:
    t = np.arange(0.0, 60.0, 1.0 / rate_hz)
    t += np.random.default_rng(2).uniform(0.0, jitter_s, len(t))
    moving = (t >= moves_s[0]) & (t < moves_s[1])
    v_d = np.outer(moving, [0.3, 0.0, 0.0])
    v_d += np.random.default_rng(1).normal(0.0, sigma, v_d.shape)
    good = np.ones(len(t), dtype=bool)
    series = DvlSeries(t=t, v_d=v_d, sigma=np.full(len(t), sigma), valid=good, bottom_lock=good)
    return Mission("rest", {"dvl": Sensor("dvl", "dvl", series)})


def test_a_short_way_ends_the_rest_of_a_precise_dvl() -> None:
    assert initial_rest_s(dvl(8.0, 0.001, (17.0, 20.0))) == pytest.approx(17.0, abs=1.0)


def test_noise_is_no_motion() -> None:
    assert initial_rest_s(dvl(5.0, 0.04, (40.0, 60.0))) == pytest.approx(40.0, abs=10.0)
    assert initial_rest_s(dvl(1.5, 0.02, (60.0, 60.0))) == pytest.approx(60.0, abs=1.0)


@pytest.mark.parametrize(("rate_hz", "jitter_s"), [(1.0, 0.3), (0.5, 0.0)])
def test_slow_stamps_leave_a_precise_sensor_at_rest(rate_hz: float, jitter_s: float) -> None:
    mission = dvl(rate_hz, 0.001, (40.0, 60.0), jitter_s)
    assert initial_rest_s(mission) == pytest.approx(40.0, abs=6.0)
