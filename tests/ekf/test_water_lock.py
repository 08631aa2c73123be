"""What the water's motion adds to dead reckoning, on a spell without bottom lock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.ekf.constant_velocity import Filtered
from gtsam_nav.ekf.water_lock import with_water_motion
from gtsam_nav.frames import Array
from gtsam_nav.mission import InitialState, Mission, Sensor
from gtsam_nav.series import BoolArray, DvlSeries

CURRENT_M_S = 0.1
FIRST_S, LAST_S = 20.0, 39.0
T = np.arange(0.0, 60.0)


IN_SPELL = (FIRST_S <= T) & (LAST_S >= T)


def mission(*others: BoolArray) -> Mission:
    """With one DVL that is without bottom lock for a spell, and others that have it at times."""
    locks = enumerate([~IN_SPELL, *others])
    sensors = {f"dvl{k}": dvl(f"dvl{k}", bottom) for k, bottom in locks}
    return Mission("spell", sensors, initial=InitialState(p_n=np.zeros(3)))


def dvl(name: str, bottom: BoolArray) -> Sensor:
    n = len(T)
    series = DvlSeries(
        t=T,
        v_d=np.zeros((n, 3)),
        sigma=np.full(n, 0.02),
        valid=np.ones(n, bool),
        bottom_lock=bottom,
    )
    return Sensor(name, "dvl", series, noise={"water_sigma_m_s": CURRENT_M_S})


def added(since_s: Array, limit_s: float = 10.0, of: Mission | None = None) -> Array:
    n, none = len(T), np.zeros(0)
    filtered = Filtered(T, np.zeros((n, 8)), np.zeros((n, 8, 8)), none, np.zeros((0, 4)), none > 0)
    return with_water_motion(filtered, since_s, of or mission(), limit_s).P


def test_a_current_carries_the_track_along_for_the_whole_spell() -> None:
    P = added(np.zeros(len(T)))
    carried_s = np.clip(T, FIRST_S, LAST_S) - FIRST_S
    for axis in (0, 1):
        np.testing.assert_allclose(np.sqrt(P[:, axis, axis]), CURRENT_M_S * carried_s)
        np.testing.assert_allclose(np.sqrt(P[:, 4 + axis, 4 + axis]), CURRENT_M_S * IN_SPELL)
    assert np.count_nonzero(P[:, [2, 3, 6, 7]]) == 0


def test_what_was_before_a_restart_does_not_count() -> None:
    P = added(np.where(T > 30.0, 30.0, 0.0))
    sigma = np.sqrt(P[:, 0, 0])
    assert sigma[30] == pytest.approx(CURRENT_M_S * 10.0)
    assert sigma[31] == pytest.approx(CURRENT_M_S * 1.0)
    assert sigma[-1] == pytest.approx(CURRENT_M_S * (LAST_S - 30.0))


def test_a_spell_that_is_bridged_is_none() -> None:
    assert np.count_nonzero(added(np.zeros(len(T)), limit_s=30.0)) == 0


def test_a_current_is_one_however_many_track_it() -> None:
    since_s = np.zeros(len(T))
    alone = added(since_s)
    np.testing.assert_allclose(added(since_s, of=mission(~IN_SPELL)), alone)


def test_where_any_has_bottom_lock_no_current_carries() -> None:
    since_s = np.zeros(len(T))
    always = mission(np.ones(len(T), bool))
    assert np.count_nonzero(added(since_s, of=always)) == 0
    later = mission(T <= 25.0)
    carried_m = np.sqrt(added(since_s, of=later)[-1, 0, 0])
    assert carried_m == pytest.approx(CURRENT_M_S * (LAST_S - 26.0))


def test_a_current_is_as_strong_as_the_most_that_is_stated() -> None:
    both = mission(~IN_SPELL)
    other = replace(both.sensors["dvl1"], noise={"water_sigma_m_s": 3 * CURRENT_M_S})
    P = added(np.zeros(len(T)), of=both.with_sensor(other))
    assert np.sqrt(P[-1, 0, 0]) == pytest.approx(3 * CURRENT_M_S * (LAST_S - FIRST_S))
