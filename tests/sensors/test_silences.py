"""Spells without a stamp."""

from __future__ import annotations

import numpy as np

from gtsam_nav.sensors.silences import silent_spells


def test_a_silence_may_begin_and_end_with_the_span() -> None:
    t = np.array([0.5, 0.6, 0.7, 3.0, 3.1])
    found = silent_spells(t, 0.0, 4.0, 0.2)
    np.testing.assert_array_equal(found, [[0.0, 0.5], [0.7, 3.0], [3.1, 4.0]])
    assert len(silent_spells(t, 0.5, 0.7, 0.2)) == 0
    np.testing.assert_array_equal(silent_spells(np.empty(0), 1.0, 2.0, 0.2), [[1.0, 2.0]])
