"""What the water's motion adds to dead reckoning, on a spell without bottom lock."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.ekf.constant_velocity import Filtered
from gtsam_nav.ekf.water_lock import with_water_motion
from gtsam_nav.frames import Array
from gtsam_nav.mission import InitialState, Mission, Sensor
from gtsam_nav.series import DvlSeries

CURRENT_M_S = 0.1
FIRST_S, LAST_S = 20.0, 39.0
T = np.arange(0.0, 60.0)


def mission() -> Mission:
    bottom = (T < FIRST_S) | (T > LAST_S)
    n = len(T)
    series = DvlSeries(
        t=T,
        v_d=np.zeros((n, 3)),
        sigma=np.full(n, 0.02),
        valid=np.ones(n, bool),
        bottom_lock=bottom,
    )
    noise = {"water_sigma_m_s": CURRENT_M_S}
    dvl = Sensor("dvl", "dvl", series, noise=noise)
    return Mission("spell", {"dvl": dvl}, initial=InitialState(p_n=np.zeros(3)))


def added(since_s: Array, limit_s: float = 10.0) -> Array:
    n, none = len(T), np.zeros(0)
    filtered = Filtered(T, np.zeros((n, 8)), np.zeros((n, 8, 8)), none, np.zeros((0, 4)), none > 0)
    return with_water_motion(filtered, since_s, mission(), limit_s).P


def test_a_current_carries_the_track_along_for_the_whole_spell() -> None:
    P = added(np.zeros(len(T)))
    carried_s = np.clip(T, FIRST_S, LAST_S) - FIRST_S
    for axis in (0, 1):
        np.testing.assert_allclose(np.sqrt(P[:, axis, axis]), CURRENT_M_S * carried_s)
        inside = (FIRST_S <= T) & (T <= LAST_S)
        np.testing.assert_allclose(np.sqrt(P[:, 4 + axis, 4 + axis]), CURRENT_M_S * inside)
    assert np.count_nonzero(P[:, [2, 3, 6, 7]]) == 0


def test_what_was_before_a_restart_does_not_count() -> None:
    P = added(np.where(T > 30.0, 30.0, 0.0))
    sigma = np.sqrt(P[:, 0, 0])
    assert sigma[30] == pytest.approx(CURRENT_M_S * 10.0)
    assert sigma[31] == pytest.approx(CURRENT_M_S * 1.0)
    assert sigma[-1] == pytest.approx(CURRENT_M_S * (LAST_S - 30.0))


def test_a_spell_that_is_bridged_is_none() -> None:
    assert np.count_nonzero(added(np.zeros(len(T)), limit_s=30.0)) == 0
