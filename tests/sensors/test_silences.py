"""Spells without a stamp."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.sensors.silences import (
    is_heard,
    longest_step_s,
    said_of_silences,
    silences,
    silent_spells,
    since_heard,
    speaks_at,
)
from gtsam_nav.series import DepthSeries


def gauge(*t: float) -> Sensor:
    series = DepthSeries(t=np.array(t), depth_m=np.zeros(len(t)), sigma=np.ones(len(t)))
    return Sensor("gauge", "depth", series)


def beside(sensor: Sensor, from_s: float, to_s: float) -> Mission:
    """A mission that another sensor makes so long."""
    other = Sensor("other", "depth", gauge(from_s, to_s).series)
    return Mission("m", {sensor.name: sensor, "other": other})


def test_a_silence_may_begin_and_end_with_the_span() -> None:
    t = np.array([0.5, 0.6, 0.7, 3.0, 3.1])
    found = silent_spells(t, 0.0, 4.0, 0.2)
    np.testing.assert_array_equal(found, [[0.0, 0.5], [0.7, 3.0], [3.1, 4.0]])
    assert len(silent_spells(t, 0.5, 0.7, 0.2)) == 0
    np.testing.assert_array_equal(silent_spells(np.empty(0), 1.0, 2.0, 0.2), [[1.0, 2.0]])


def test_a_sensor_speaks_within_a_usual_step_of_its_samples() -> None:
    sensor = gauge(*np.arange(2.0, 6.0, 0.5), *np.arange(20.0, 30.0, 0.5))
    mission = beside(sensor, 0.0, 40.0)
    np.testing.assert_array_equal(silences(sensor, mission), [[5.5, 20.0], [29.5, 40.0]])
    t = np.array([0.0, 2.0, 4.2, 5.9, 6.1, 12.0, 19.4, 19.6, 29.9, 30.1, 40.0])
    speaks = [True, True, True, True, False, False, False, True, True, False, False]
    np.testing.assert_array_equal(speaks_at(sensor, mission, t), speaks)


@pytest.mark.parametrize("t", [(3.0,), (0.0, 100.0)], ids=len)
def test_a_log_of_one_sample_or_of_both_ends_holds_for_good(t: tuple[float, ...]) -> None:
    sensor = gauge(*t)
    mission = beside(sensor, 0.0, 100.0)
    assert np.all(speaks_at(sensor, mission, np.linspace(0.0, 100.0, 7)))
    assert not list(said_of_silences(sensor, mission, ""))


def test_the_longest_of_several_silences_is_named() -> None:
    sensor = gauge(*np.arange(0.0, 5.0, 0.1), *np.arange(8.0, 10.0, 0.1), 20.0)
    (said,) = said_of_silences(sensor, beside(sensor, 0.0, 20.0), "so what")
    assert said == "'gauge' is silent 2 times, the longest from 9.9 s to 20.0 s: so what"
    once = gauge(0.0, 0.5, 1.0)
    (said,) = said_of_silences(once, beside(once, 0.0, 9.0), "so what")
    assert said == "'gauge' is silent from 1.0 s to 9.0 s: so what"


def test_a_time_is_heard_between_near_stamps_and_near_their_ends() -> None:
    stamps = np.array([1.0, 1.5, 2.0, 5.0, 5.5])
    t = np.array([0.2, 0.6, 1.2, 2.0, 2.1, 4.9, 5.0, 5.2, 6.0, 6.2])
    heard = is_heard(stamps, t, 0.5)
    np.testing.assert_array_equal(
        heard, [False, True, True, True, *2 * [False], *3 * [True], False]
    )
    np.testing.assert_array_equal(is_heard(stamps[:1], t[:3], 0.5), [False, True, True])


def test_what_is_no_silence_yet_goes_with_the_usual_step() -> None:
    assert longest_step_s(np.arange(0.0, 9.0, 0.1)) == 1.0
    assert longest_step_s(np.arange(0.0, 90.0, 10.0)) == 50.0
    assert longest_step_s(np.zeros(1)) == 1.0
    assert longest_step_s(np.arange(0.0, 9.0, 0.01), 0.5) == 0.5


@pytest.mark.parametrize(("size", "period_s"), [(5, 2.0), (2, 1.2), (20, 10.0)])
def test_a_sensor_whose_samples_come_in_bursts_is_not_silent_between_them(
    size: int, period_s: float
) -> None:
    bursts = period_s * np.arange(50.0)[:, None] + 0.01 * np.arange(size)
    sensor = gauge(*bursts.ravel())
    assert not len(silences(sensor, beside(sensor, 0.0, 50.0 * period_s)))


def test_what_is_silent_for_most_of_a_mission_is_silent() -> None:
    sensor = gauge(*np.arange(0.0, 5.0, 0.1), *np.arange(500.0, 505.0, 0.1))
    found = silences(sensor, beside(sensor, 0.0, 505.0))
    np.testing.assert_allclose(found, [[4.9, 500.0]])


def test_the_first_and_last_sample_reach_a_few_seconds() -> None:
    sensor = gauge(*np.arange(2.9, 6.0, 0.1), *np.arange(8.0, 11.0, 0.1))
    mission = beside(sensor, 0.0, 12.5)
    np.testing.assert_allclose(silences(sensor, mission), [[5.9, 8.0]])
    assert not list(said_of_silences(sensor, mission, "for two seconds"))


def test_sums_begin_anew_whenever_something_is_heard() -> None:
    sums, heard = np.arange(6.0), np.array([False, False, True, False, False, True])
    np.testing.assert_array_equal(since_heard(sums, heard), [0.0, 1.0, 0.0, 1.0, 2.0, 0.0])
