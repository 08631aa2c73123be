"""Random processes have the spread and the memory that they are asked for."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.simulation.processes import bursts, correlation_time_s, gauss_markov, random_walk


def test_gauss_markov_spread_and_correlation_time() -> None:
    samples = gauss_markov(np.random.default_rng(0), 50_000, 0.5, 2.0, 10.0, 2)
    assert samples.std() == pytest.approx(2.0, rel=0.05)
    assert correlation_time_s(samples[:, 0], 0.5) == pytest.approx(10.0, rel=0.2)


def test_gauss_markov_starts_at_its_stationary_spread() -> None:
    rng = np.random.default_rng(0)
    first = [gauss_markov(rng, 2, 1.0, 3.0, 1000.0, 1)[0, 0] for _ in range(2000)]
    assert np.std(first) == pytest.approx(3.0, rel=0.08)


def test_random_walk_spreads_with_the_root_of_time() -> None:
    walks = random_walk(np.random.default_rng(0), 401, 0.01, 0.5, 3000)
    assert np.all(walks[0] == 0)
    assert walks[400].std() == pytest.approx(0.5 * np.sqrt(4.0), rel=0.05)


def test_bursts_come_as_often_and_last_as_long_as_asked() -> None:
    t = np.arange(0.0, 36_000.0, 0.2)
    inside, mark = bursts(np.random.default_rng(0), t, per_min=1.0, mean_s=3.0)
    assert inside.mean() == pytest.approx(3.0 / 60, rel=0.2)
    assert np.all(mark[~inside] == 0)
    assert np.all(mark[inside] > 0)
