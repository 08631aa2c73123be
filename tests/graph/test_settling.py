"""Rejection and re-admission of readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gtsam_nav as gn
from gtsam_nav.frames import Array
from gtsam_nav.graph.settling import _by_all_others
from gtsam_nav.mission import Mission
from gtsam_nav.series import BoolArray, GnssSeries
from gtsam_nav.solution import Solution


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0))
def test_a_reading_is_judged_by_all_others(seed: int, weight: float) -> None:
    """Against a linear problem that is solved once with the reading's weight, once without it."""
    rng = np.random.default_rng(seed)
    others, own = rng.normal(size=(9, 4)), rng.normal(size=(3, 4))
    z_others, z = rng.normal(size=9), 3 * rng.normal(size=3)
    information = others.T @ others
    with_it = information + weight * own.T @ own
    x = np.linalg.solve(with_it, others.T @ z_others + weight * own.T @ z)
    got = _by_all_others(own @ x - z, own @ np.linalg.solve(with_it, own.T), weight)
    x_without = np.linalg.solve(information, others.T @ z_others)
    innovation = own @ x_without - z
    S = np.eye(3) + own @ np.linalg.solve(information, own.T)
    wanted = float(innovation @ np.linalg.solve(S, innovation))
    assert got <= wanted * (1 + 1e-6)
    share = np.linalg.eigvalsh(own @ np.linalg.solve(with_it, own.T))
    if np.all(1.0 - weight * share > 1e-2):
        assert got == pytest.approx(wanted, rel=1e-5)


def displaced(mission: Mission, hit: BoolArray, seed: int) -> Mission:
    """Some fixes moved by 20 to 100 m, those that follow each other by the same."""
    gnss = mission.sensors["gnss"]
    assert isinstance(gnss.series, GnssSeries)
    rng = np.random.default_rng(seed)
    p_n = gnss.series.p_n.copy()
    jump = np.zeros(2)
    for k in np.flatnonzero(hit).tolist():
        if k == 0 or not hit[k - 1]:
            bearing, length_m = rng.uniform(0, 2 * np.pi), rng.uniform(20, 100)
            jump = length_m * np.array([np.cos(bearing), np.sin(bearing)])
        p_n[k, :2] += jump
    return mission.with_sensor(replace(gnss, series=replace(gnss.series, p_n=p_n)))


UNGATED = ("graph.robust.gnss.gate_probability=null", "graph.robust.gnss.kernel=huber")


def position_outliers(solution: Solution) -> list[int]:
    return sorted(r.index for r in solution.rejections if r.reason == "position outlier")


def rms_m(solution: Solution, positions: str = "trajectory") -> float:
    trajectory = getattr(solution, positions)
    assert solution.reference is not None
    truth = solution.reference.series
    p_n: Array = truth.p_n  # type: ignore[attr-defined]
    there = np.stack([np.interp(trajectory.t, truth.t, axis) for axis in p_n.T[:2]], axis=1)
    return float(np.sqrt(np.mean(np.sum((trajectory.p_n[:, :2] - there) ** 2, axis=1))))


@pytest.fixture(scope="module")
def laps() -> Mission:
    return gn.simulate("laps", seed=3).crop(0.0, 90.0)


@pytest.fixture(scope="module")
def marina() -> Mission:
    mission = gn.simulate("marina", seed=5, duration_s=120.0)
    return mission.without("sonar", "landmarks", "odometry")


@pytest.mark.parametrize("scenario", ["laps", "marina"])
def test_outliers_in_bursts_are_found_and_nothing_else(
    scenario: str, request: pytest.FixtureRequest
) -> None:
    """The first fixes among them; the marina's fixes share an error besides."""
    mission: Mission = request.getfixturevalue(scenario)
    clean = gn.estimate(mission, "graph")
    n = len(mission.sensors["gnss"].series)
    hit = np.zeros(n, dtype=bool)
    hit[:2] = hit[20] = hit[40:45] = hit[70:74] = True
    solution = gn.estimate(displaced(mission, hit, seed=1), "graph")
    found = set(position_outliers(solution))
    assert set(np.flatnonzero(hit)) <= found
    assert len(found) <= np.sum(hit) + 2
    assert rms_m(solution) <= 1.2 * rms_m(clean)
    assert rms_m(solution, "online") <= 2.5 * rms_m(clean, "online")
    assert solution.gnss_used == n - len(found)
    residuals = [r.normalised_residual for r in solution.rejections if r.index in found]
    assert min(r for r in residuals if r is not None) > 3.0


def test_without_rejection_they_stay_under_a_kernel(laps: Mission) -> None:
    hit = np.arange(90) % 5 == 2
    faulty = displaced(laps, hit, seed=2)
    with_it = gn.estimate(faulty, "graph")
    without = gn.estimate(faulty, "graph", gn.load_config(None, UNGATED))
    assert position_outliers(without) == []
    assert rms_m(without) > rms_m(with_it)


def test_a_velocity_can_be_an_outlier_where_its_position_is_none(laps: Mission) -> None:
    gnss = laps.sensors["gnss"]
    assert isinstance(gnss.series, GnssSeries)
    assert gnss.series.v_n is not None
    v_n = gnss.series.v_n.copy()
    v_n[50] += [5.0, 0.0, 0.0]
    faulty = laps.with_sensor(replace(gnss, series=replace(gnss.series, v_n=v_n)))
    solution = gn.estimate(faulty, "graph")
    reasons = {r.reason for r in solution.rejections if r.index == 50}
    assert reasons == {"velocity outlier"}
