"""Turns told by one source after the other."""

from __future__ import annotations

import numpy as np

from gtsam_nav.preprocess.turn_sources import TurnSource, by_rate, spliced

T = np.arange(0.0, 20.0, 0.1)
TURNED = np.where(T > 10.0, 0.3 * (T - 10.0), 0.0)


def source(told: slice | np.ndarray, offset: float = 0.0) -> TurnSource:
    return TurnSource(T[told], TURNED[told] + offset, 0.5)


def test_a_source_that_tells_everything_stays_as_it_is() -> None:
    first = source(slice(None))
    assert spliced(first, source(slice(None), 9.0)) is first


def test_another_source_tells_when_within_a_silence_the_vehicle_turned() -> None:
    """It also tells the turn before the first stamp and after the last one."""
    gaps = (T > 3.0) & (T < 7.0) | (T > 9.0) & (T < 14.0) | (T > 18.0)
    found = spliced(source(gaps, 5.0), source(~gaps))
    np.testing.assert_allclose(np.interp(T, found.t, found.turned), TURNED, atol=1e-12)


def test_the_next_source_tells_what_is_silent_to_both() -> None:
    some, others = T < 5.0, (T < 9.0) | (T > 15.0)
    found = spliced(source(some), source(others), source(slice(None), 1.0))
    np.testing.assert_allclose(np.interp(T, found.t, found.turned), TURNED, atol=1e-12)


def test_what_no_source_tells_is_linear_and_nothing_beyond_the_ends() -> None:
    found = spliced(source((T > 5.0) & (T < 9.0) | (T > 15.0) & (T < 18.0)), source(T < 7.0))
    turned = np.interp([12.0, 19.9], found.t, found.turned)
    between = np.interp(12.0, T[[89, 151]], TURNED[[89, 151]])
    np.testing.assert_allclose(turned, [between, TURNED[179]], atol=1e-9)


def test_a_rate_is_held_to_a_near_end_and_no_further() -> None:
    near = by_rate(T, np.full(len(T), 0.1), (-0.2, 20.2), 0.5)
    np.testing.assert_allclose([near.t[0], near.t[-1], near.turned[-1]], [-0.2, 20.2, 2.04])
    far = by_rate(T, np.full(len(T), 0.1), (-2.0, 90.0), 0.5)
    np.testing.assert_allclose([far.t[0], far.t[-1], far.turned[-1]], [0.0, 19.9, 1.99])
