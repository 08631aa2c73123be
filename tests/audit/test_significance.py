"""Explanations that data tell apart, and those that they do not."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.audit.significance import (
    FALSE_ALARM,
    best,
    decided,
    limit,
    losses,
    prefers,
    quantile,
    tied,
)

RNG = np.random.default_rng(4)


@pytest.fixture(autouse=True)
def same_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever tests ran before."""
    monkeypatch.setitem(globals(), "RNG", np.random.default_rng(4))


def test_quantiles_leave_the_stated_share_outside() -> None:
    from scipy.stats import norm, t

    assert quantile(10**6) == pytest.approx(norm.isf(FALSE_ALARM / 2), rel=1e-3)
    assert 2 * t.sf(quantile(7, questions=5), 7) == pytest.approx(FALSE_ALARM / 5)
    assert quantile(0) == np.inf


def test_equally_good_explanations_are_rarely_told_apart() -> None:
    told = sum(prefers(*RNG.normal(size=(2, 20))) for _ in range(2000))
    assert told <= 2


def test_a_better_explanation_is_preferred_and_never_the_worse() -> None:
    good, bad = RNG.normal(0.0, 0.1, 20), RNG.normal(1.0, 0.3, 20)
    assert prefers(bad, good)
    assert not prefers(good, bad)
    assert not prefers(bad[:1], good[:1])


def test_the_stated_explanation_stands_unless_another_is_clearly_better() -> None:
    errors = np.array([RNG.normal(0.5, 0.1, 30), RNG.normal(0.0, 0.1, 30), np.ones(30)])
    assert best(losses(errors)) == 1
    assert best(losses(errors[[1, 0, 2]])) == 0
    assert best(losses(errors[:, :2])) == 0


def test_explanations_that_say_the_same_are_tied() -> None:
    right = RNG.normal(0.0, 0.1, 30)
    loss = losses(np.array([right + 1.0, right, right, right - 1.0]))
    assert tied(loss, 1) == [1, 2]
    assert decided(loss) is None
    assert decided(loss[[0, 1, 3]]) == 1


def test_a_stated_spread_is_taken_for_known() -> None:
    assert limit(0.0, 3, 2.0) == pytest.approx(2.0 * quantile(10**6))
    assert limit(1.0, 3, 0.0) == pytest.approx(quantile(3))
