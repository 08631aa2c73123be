"""Velocities that a gate refused, and what is no more than a manoeuvre."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import Array
from gtsam_nav.preprocess.manoeuvres import in_manoeuvres

T = np.arange(0.0, 60.0, 0.2)
SIGMA = np.full(len(T), 0.02)


def speeding_up() -> Array:
    """From rest to 2.5 m/s in 3 s, after 20 s."""
    return np.clip((T - 20.0) / 3.0, 0.0, 1.0) * 2.5


def test_a_vehicle_that_speeds_up_is_believed() -> None:
    refused = T > 20.5
    np.testing.assert_array_equal(in_manoeuvres(T, speeding_up(), SIGMA, refused), refused)


def test_a_spike_meanwhile_is_not() -> None:
    v, refused = speeding_up(), T > 20.5
    v[150] += 1.5
    believed = in_manoeuvres(T, v, SIGMA, refused)
    assert not believed[150]
    assert np.sum(refused) - np.sum(believed) == 3  # nor what it is joined to


@pytest.mark.parametrize("jump_m_s", [1.0, -2.0])
def test_a_false_echo_begins_with_a_jump(jump_m_s: float) -> None:
    false = (T > 20.5) & (T < 30.0)
    assert not in_manoeuvres(T, np.where(false, jump_m_s, 0.0), SIGMA, false).any()


def test_a_spike_is_short() -> None:
    refused = (T > 20.5) & (T < 21.0)
    assert not in_manoeuvres(T, np.where(refused, 0.3, 0.0), SIGMA, refused).any()


@pytest.mark.parametrize("n", [0, 1, 2])
def test_few_readings(n: int) -> None:
    assert len(in_manoeuvres(T[:n], T[:n], SIGMA[:n], np.ones(n, dtype=bool))) == n
