"""The filter: the readable version against the textbook, the compiled one against the readable."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from gtsam_nav.ekf.constant_velocity import (
    YAW,
    Filtered,
    Measurements,
    Restarts,
    Start,
    doubt,
    predict,
    run,
    run_readable,
    update,
)
from gtsam_nav.frames import Array, wrap_angle

ACCEL_VARIANCE = np.array([0.05, 0.05, 0.02, 0.1]) ** 2
OPEN_GATE = np.full(5, np.inf)
KINDS = {"velocity": (4, 3), "odometry": (4, 4), "heading": (3, 1), "depth": (2, 1)}
"""First entry and size of each kind of measurement."""

seeds = given(st.integers(0, 2**32 - 1))


def state(rng: np.random.Generator) -> tuple[Array, Array]:
    x = rng.normal(size=8) * [50, 50, 5, 0, 1, 0.5, 0.2, 0.3]
    x[YAW] = rng.uniform(-np.pi, np.pi)
    root = rng.normal(size=(8, 8)) * [2, 2, 1, 0.1, 0.3, 0.3, 0.1, 0.1]
    return x, root.T @ root


def start(rng: np.random.Generator, t: float = 0.0) -> Start:
    return Start(t, *state(rng))


def measurements(t: Array, kinds: list[str], value: Array, variance: Array) -> Measurements:
    first, size = np.array([KINDS[kind] for kind in kinds], dtype=np.int64).reshape(-1, 2).T
    beyond = np.arange(4) >= size[:, None]
    return Measurements(
        t=t,
        first=np.ascontiguousarray(first),
        size=np.ascontiguousarray(size),
        value=np.where(beyond, 0.0, value),
        variance=np.where(beyond, 0.0, variance),
        sensor=np.array([list(KINDS).index(kind) for kind in kinds], dtype=np.int64),
        row=np.arange(len(t)),
        names=tuple(KINDS),
    )


def mixture(rng: np.random.Generator, m: int = 60) -> Measurements:
    """Measurements of every kind, some far off, some of the same time."""
    t = np.sort(np.round(rng.uniform(0, 20, m), 1))
    kinds = rng.choice(list(KINDS), m).tolist()
    value = rng.normal(size=(m, 4)) * rng.choice([0.3, 3.0], (m, 1), p=[0.9, 0.1])
    turned = np.array(kinds) == "heading"
    value[turned, 0] = rng.choice([-3.0, 3.1], turned.sum()) + 0.1 * rng.normal(size=turned.sum())
    return measurements(t, kinds, value, rng.uniform(0.01, 0.1, (m, 4)))


def assert_same(a: Filtered, b: Filtered) -> None:
    np.testing.assert_array_equal(a.t, b.t)
    np.testing.assert_array_equal(a.used, b.used)
    difference = a.x - b.x
    difference[:, YAW] = wrap_angle(difference[:, YAW])
    np.testing.assert_allclose(difference, 0.0, atol=1e-9)
    np.testing.assert_allclose(a.P, b.P, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(a.nis, b.nis, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(a.whitened, b.whitened, rtol=1e-8, atol=1e-8)


@settings(max_examples=30)
@seeds
def test_the_compiled_filter_is_the_readable_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    z, begin = mixture(rng), start(rng)
    gate = np.append(0.0, chi2.ppf(0.99, [1, 2, 3, 4]))
    t = np.arange(0.0, 25.0, 0.7)
    compiled, readable = (filt(z, begin, t, gate, ACCEL_VARIANCE) for filt in (run, run_readable))
    assert_same(compiled, readable)
    assert 0 < compiled.used.sum() < len(z)


@settings(max_examples=20)
@seeds
def test_restarts_are_the_same_in_both(seed: int) -> None:
    rng = np.random.default_rng(seed)
    z, begin, t = mixture(rng), start(rng), np.arange(0.0, 25.0, 0.7)
    restarts = Restarts(rng.random(len(t)) < 0.3, np.array([0, 1, YAW]))
    compiled, readable = (
        filt(z, begin, t, OPEN_GATE, ACCEL_VARIANCE, restarts) for filt in (run, run_readable)
    )
    assert_same(compiled, readable)


def test_a_run_of_failures_proves_the_state_wrong() -> None:
    """A heading that is known too well, and a compass that says otherwise."""
    t = np.arange(0.0, 20.0, 0.1)
    z = measurements(t, ["heading"] * len(t), np.full((len(t), 4), 2.0), np.full((len(t), 4), 1e-4))
    begin = Start(0.0, np.zeros(8), 1e-6 * np.eye(8))
    gate = np.append(0.0, chi2.ppf(0.999, [1, 2, 3, 4]))
    grid = np.arange(0.0, 20.0, 0.5)
    compiled = run(z, begin, grid, gate, ACCEL_VARIANCE)
    assert_same(compiled, run_readable(z, begin, grid, gate, ACCEL_VARIANCE))
    assert 5 <= np.sum(~compiled.used) <= 30
    assert compiled.x[-1, YAW] == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("filt", [run, run_readable])
def test_a_wrong_velocity_has_led_astray_for_as_long_as_nothing_fitted(filt: object) -> None:
    """A vehicle that sets off unseen: the place is doubted with the speed, and found again."""
    assert callable(filt)
    t = np.concatenate([np.arange(0.0, 5.0, 0.2), np.arange(9.0, 20.0, 0.2)])
    speed = np.clip(0.3 * (t - 5.0), 0.0, 1.5)
    value = np.column_stack([speed, np.zeros((len(t), 3))])
    z = measurements(t, ["velocity"] * len(t), value, np.full((len(t), 4), 1e-4))
    begin = Start(0.0, np.zeros(8), 1e-6 * np.eye(8))
    gate = np.append(0.0, chi2.ppf(0.9999, [1, 2, 3, 4]))
    found = filt(z, begin, np.array([15.0]), gate, ACCEL_VARIANCE)
    assert np.sum(~found.used) >= 10
    truth = 0.5 * 0.3 * 5.0**2 + 1.5 * 5.0
    error, sigma = found.x[0, 0] - truth, np.sqrt(found.P[0, 0, 0])
    assert abs(error) < 1.5
    assert abs(error) < 2.0 * sigma


@seeds
def test_doubt_widens_what_is_off_and_where_it_has_led(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, P = state(rng)
    entries, value, elapsed_s = np.array([4, 5, 6]), rng.normal(size=3), rng.uniform(0, 10)
    widened = doubt(x, P, entries, value, elapsed_s) - P
    off = value - x[entries]
    np.testing.assert_allclose(np.diag(widened)[4:7], off**2, rtol=1e-6, atol=1e-9)
    # the second moment of the way at that speed over a time that is anything up to all of it
    way2 = (off[0] ** 2 + off[1] ** 2) * elapsed_s**2 / 3
    assert np.trace(widened[:2, :2]) == pytest.approx(way2, rel=1e-6, abs=1e-6)
    assert np.all(np.linalg.eigvalsh(widened) > -1e-6)


def test_a_restart_is_a_start_whose_position_is_known() -> None:
    rng = np.random.default_rng(3)
    z, t = mixture(rng), np.array([8.05, 11.0, 15.0])
    restarts = Restarts(np.array([True, False, False]), np.array([0, 1]))
    found = run(z, start(rng), t, OPEN_GATE, ACCEL_VARIANCE, restarts)
    P = found.P[0].copy()
    assert np.all(np.diag(P)[:2] > 0)
    P[:2], P[:, :2] = 0.0, 0.0
    later = z.t > t[0]
    rest = Measurements(
        *(getattr(z, name)[later] for name in ("t", "first", "size", "value", "variance")),
        z.sensor[later],
        z.row[later],
        z.names,
    )
    again = run(rest, Start(t[0], found.x[0], P), t[1:], OPEN_GATE, ACCEL_VARIANCE)
    np.testing.assert_allclose(found.x[1:], again.x, atol=1e-12)
    np.testing.assert_allclose(found.P[1:], again.P, atol=1e-12)


@pytest.mark.parametrize("filt", [run, run_readable])
def test_the_start_is_left_as_it_was(filt: object) -> None:
    rng = np.random.default_rng(0)
    begin = start(rng)
    x, P = begin.x.copy(), begin.P.copy()
    assert callable(filt)
    filt(mixture(rng), begin, np.arange(20.0), OPEN_GATE, ACCEL_VARIANCE)
    np.testing.assert_array_equal(begin.x, x)
    np.testing.assert_array_equal(begin.P, P)


def test_without_measurements_it_only_predicts() -> None:
    rng = np.random.default_rng(0)
    begin, nothing = start(rng), measurements(np.empty(0), [], np.empty((0, 4)), np.empty((0, 4)))
    t = np.array([0.0, 1.0, 3.0])
    found = run(nothing, begin, t, OPEN_GATE, ACCEL_VARIANCE)
    x, P = begin.x, begin.P
    for k, dt in enumerate([0.0, 1.0, 2.0]):
        x, P = predict(x, P, dt, ACCEL_VARIANCE)
        np.testing.assert_allclose(found.x[k], x, atol=1e-12)
        np.testing.assert_allclose(found.P[k], P, atol=1e-9)


def test_a_measurement_follows_the_state_recorded_at_its_time() -> None:
    begin = Start(0.0, np.zeros(8), np.eye(8))
    z = measurements(np.array([1.0]), ["depth"], np.full((1, 4), 9.0), np.full((1, 4), 0.01))
    found = run(z, begin, np.array([1.0, 1.001]), OPEN_GATE, ACCEL_VARIANCE)
    assert found.x[0, 2] == 0.0
    assert found.x[1, 2] > 8.0


@pytest.mark.parametrize("filt", [run, run_readable])
def test_what_the_gate_stops_leaves_no_trace(filt: object) -> None:
    assert callable(filt)
    begin = start(np.random.default_rng(1))
    far = np.full((1, 4), begin.x[2] + 1e3)
    z = measurements(np.array([1.0]), ["depth"], far, np.full((1, 4), 0.01))
    gated = filt(z, begin, np.array([1.0, 2.0]), np.full(5, 30.0), ACCEL_VARIANCE)
    assert not gated.used[0]
    assert gated.nis[0] > 30.0
    x, P = begin.x, begin.P
    for k in range(2):
        x, P = predict(x, P, 1.0, ACCEL_VARIANCE)
        np.testing.assert_allclose(gated.x[k], x, atol=1e-12)
        np.testing.assert_allclose(gated.P[k], P, atol=1e-9)


@seeds
def test_the_prediction_is_linearised_rightly(seed: int) -> None:
    """Columns of F from central differences; the covariance is F P F' and the noise."""
    rng = np.random.default_rng(seed)
    x, P = state(rng)
    dt, none = rng.uniform(0.01, 2.0), np.zeros(4)
    columns = []
    for step in 1e-6 * np.eye(8):
        ahead, behind = (predict(x + sign * step, P, dt, none)[0] for sign in (1, -1))
        difference = ahead - behind
        difference[YAW] = wrap_angle(difference[YAW])
        columns.append(difference / 2e-6)
    F = np.array(columns).T
    np.testing.assert_allclose(predict(x, P, dt, none)[1], F @ P @ F.T, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_noise_does_not_care_how_time_is_cut(yaw: float) -> None:
    x = np.array([0, 0, 0, yaw, 0, 0, 0, 0])
    _, once = predict(x, np.zeros((8, 8)), 3.0, ACCEL_VARIANCE)
    P = np.zeros((8, 8))
    for dt in (0.5, 1.5, 1.0):
        _, P = predict(x, P, dt, ACCEL_VARIANCE)
    np.testing.assert_allclose(P, once, atol=1e-15)
    np.testing.assert_allclose(np.diag(once)[4:], 3.0 * ACCEL_VARIANCE)
    np.testing.assert_allclose(np.diag(once)[:4], 9.0 * ACCEL_VARIANCE)


@seeds
def test_an_update_adds_information(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, P = state(rng)
    P += 1e-3 * np.eye(8)
    entries, value, variance = np.array([4, 5, 6]), rng.normal(size=3), rng.uniform(0.01, 1, 3)
    x_new, P_new, whitened = update(x, P, entries, value, variance)
    H = np.eye(8)[entries]
    information = np.linalg.inv(P) + H.T @ np.diag(1 / variance) @ H
    np.testing.assert_allclose(P_new @ information, np.eye(8), atol=1e-6)
    move, left = x_new - x, value - x_new[entries]
    move[YAW] = wrap_angle(move[YAW])
    pull = P_new @ H.T @ ((value - x[entries]) / variance)
    np.testing.assert_allclose(move, pull, rtol=1e-6, atol=1e-8)
    # what the prior and the measurement cost together at the optimum
    assert whitened @ whitened == pytest.approx(
        move @ np.linalg.solve(P, move) + left @ (left / variance), rel=1e-6
    )


def test_headings_are_compared_the_short_way_round() -> None:
    x = np.zeros(8)
    x[YAW] = 3.1
    x_new, _, whitened = update(x, np.eye(8), np.array([YAW]), np.array([-3.1]), np.array([1.0]))
    gap = 2 * np.pi - 6.2
    assert whitened @ whitened == pytest.approx(gap**2 / 2)
    assert wrap_angle(x_new[YAW] - 3.1) == pytest.approx(gap / 2)
    assert -np.pi <= x_new[YAW] < np.pi


def test_innovations_of_a_matched_system_are_chi_square() -> None:
    """A vehicle that moves as the model says: normalised innovations have their dof as mean.

    Velocity, heading and depth form a linear system (position hangs on it), so the bounds of the
    chi-square distribution are exact. Bar-Shalom, Li and Kirubarajan (2001), section 5.4.
    """
    rng = np.random.default_rng(7)
    n, dt = 4000, 0.1
    sigma = {"velocity": 0.05, "heading": 0.02, "depth": 0.1}
    kinds = [("velocity", "heading", "heading", "depth")[k % 4] for k in range(n)]
    P = np.diag([1.0, 1.0, 0.5, 0.1, 0.3, 0.3, 0.1, 0.05]) ** 2
    truth = rng.multivariate_normal(np.zeros(8), P)
    value, true_states = np.zeros((n, 4)), np.zeros((n, 8))
    for k, kind in enumerate(kinds):
        moved, Q = predict(truth, np.zeros((8, 8)), dt, ACCEL_VARIANCE)
        truth = rng.multivariate_normal(moved, Q, method="cholesky")
        first, size = KINDS[kind]
        noise = sigma[kind] * rng.normal(size=size)
        value[k, :size], true_states[k] = truth[first : first + size] + noise, truth
    variance = np.tile([[sigma[kind] ** 2] for kind in kinds], 4)
    t = dt * np.arange(1, n + 1)
    z = measurements(t, kinds, value, variance)
    found = run(z, Start(0.0, np.zeros(8), P), t, OPEN_GATE, ACCEL_VARIANCE)
    for kind in sigma:
        own = np.array(kinds) == kind
        dof = own.sum() * KINDS[kind][1]
        low, high = chi2.ppf([0.005, 0.995], dof)
        assert low < found.nis[own].sum() < high, kind
        # and successive ones have nothing in common
        whitened = found.whitened[own]
        np.testing.assert_allclose(np.sum(whitened**2, axis=1), found.nis[own])
        shared = np.sum(whitened[1:] * whitened[:-1]) / np.sum(whitened**2)
        assert abs(shared) < 2.6 / np.sqrt(dof), kind
    error = found.x - true_states
    error[:, YAW] = wrap_angle(error[:, YAW])
    observed = [2, 3, 4, 5, 6, 7]
    cov = found.P[:, observed][:, :, observed]
    nees = np.einsum(
        "ni,ni->n", error[:, observed], np.linalg.solve(cov, error[:, observed, None])[..., 0]
    )
    assert np.mean(nees) == pytest.approx(6.0, rel=0.1)
