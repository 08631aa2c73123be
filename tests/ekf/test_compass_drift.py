"""What is stated of a compass's drift against many drawn ones."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.ekf.compass_drift import CompassDrift
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import HeadingSeries

STEP_S, RUNS = 0.5, 8000
T = STEP_S * (np.arange(120) + 0.5)
SPANS_S = np.array([[0.0, 14.0], [14.0, 14.0], [7.0, 28.0], [21.0, 35.0], [40.0, 60.0]])
ROUGH = CompassDrift(sigma=0.05, time_s=60.0)
SMOOTH = CompassDrift(sigma=0.05, time_s=20.0, smooth=True)


@pytest.fixture(scope="module", params=[ROUGH, SMOOTH], ids=["Gauss-Markov", "smooth"])
def drift(request: pytest.FixtureRequest) -> CompassDrift:
    found: CompassDrift = request.param
    return found


@pytest.fixture(scope="module")
def drawn(drift: CompassDrift) -> Array:
    """Many drifts over a minute, shape (runs, n)."""
    apart = np.abs(T[:, None] - T) / drift.time_s
    correlation = np.exp(-(apart**2 if drift.smooth else apart))
    root = np.linalg.cholesky(correlation + 1e-9 * np.eye(len(T)))
    return drift.sigma * np.random.default_rng(0).normal(size=(RUNS, len(T))) @ root.T


def means(drawn: Array) -> Array:
    """Over the spans, shape (runs, m)."""
    # a span without length is the time step on either side of it
    begin, end = SPANS_S.T + np.where(np.ptp(SPANS_S, axis=1) > 0.0, 0.0, [[-STEP_S], [STEP_S]])
    inside = (begin[:, None] < T) & (end[:, None] > T)
    return np.stack([drawn[:, k].mean(axis=1) for k in inside], axis=1)


def test_means_over_spans_are_spread_as_drawn(drift: CompassDrift, drawn: Array) -> None:
    stated, seen = drift.covariance(SPANS_S), np.cov(means(drawn).T)
    np.testing.assert_allclose(stated, seen, atol=0.05 * drift.sigma**2)
    np.testing.assert_allclose(np.diag(stated), np.diag(seen), rtol=0.06)


def test_what_one_mean_tells_of_others_leaves_the_rest_as_drawn(
    drift: CompassDrift, drawn: Array
) -> None:
    """Small differences of large variances keep their digits."""
    C, seen = drift.covariance(SPANS_S), means(drawn)
    kept = C[2:, :2] @ np.linalg.inv(C[:2, :2])
    left = seen[:, 2:] - seen[:, :2] @ kept.T
    stated = np.diag(C[2:, 2:] - kept @ C[:2, 2:])
    # where a span of time stands for a single one, a smooth drift feels it most
    np.testing.assert_allclose(stated, np.var(left, axis=0), rtol=0.1)


def test_changes_are_as_drawn(drift: CompassDrift, drawn: Array) -> None:
    begin, end = np.array([10, 30, 50]), np.array([20, 20, 90])
    seen = np.cov((drawn[:, end] - drawn[:, begin]).T)
    stated = drift.changes(T[begin], T[end])
    np.testing.assert_allclose(stated, seen, atol=0.05 * seen.max())


def test_spans_may_come_in_any_shape_and_be_without_length(drift: CompassDrift) -> None:
    many = np.tile(SPANS_S, (4, 1, 1)) + 1e4 * np.arange(4)[:, None, None]
    many[2, :, 1] = many[2, :, 0]
    found = drift.covariance(many)
    assert found.shape == (4, 5, 5)
    assert np.linalg.eigvalsh(found).min() > -1e-9 * drift.sigma**2
    np.testing.assert_allclose(found[3], found[0], rtol=1e-5)
    np.testing.assert_allclose(np.diag(found[2]), drift.sigma**2, rtol=1e-3)


@pytest.mark.parametrize("smooth", [False, True])
def test_the_card_says_whether_it_is_smooth(smooth: bool) -> None:
    noise = {"disturbance_sigma_deg": 3.0, "disturbance_time_s": 9.0, "disturbance_smooth": smooth}
    series = HeadingSeries(t=np.zeros(1), heading=np.zeros(1), sigma=np.ones(1))
    mission = Mission("compass", {"heading": Sensor("heading", "heading", series, noise=noise)})
    assert CompassDrift.of(mission) == CompassDrift(np.radians(3.0), 9.0, smooth)
    assert CompassDrift.of(mission.without("heading")) is None
