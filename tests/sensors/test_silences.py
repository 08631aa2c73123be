"""Spells without a stamp."""

from __future__ import annotations

import numpy as np

from gtsam_nav.sensors.silences import is_heard, longest_step_s, silent_spells


def test_a_silence_may_begin_and_end_with_the_span() -> None:
    t = np.array([0.5, 0.6, 0.7, 3.0, 3.1])
    found = silent_spells(t, 0.0, 4.0, 0.2)
    np.testing.assert_array_equal(found, [[0.0, 0.5], [0.7, 3.0], [3.1, 4.0]])
    assert len(silent_spells(t, 0.5, 0.7, 0.2)) == 0
    np.testing.assert_array_equal(silent_spells(np.empty(0), 1.0, 2.0, 0.2), [[1.0, 2.0]])


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
    assert longest_step_s(np.arange(0.0, 90.0, 10.0)) == 30.0
    assert longest_step_s(np.zeros(1)) == 1.0
