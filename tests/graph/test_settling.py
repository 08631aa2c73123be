"""Rejection and re-admission of readings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gtsam_nav as gn
from gtsam_nav.frames import Array
from gtsam_nav.graph import settling
from gtsam_nav.graph.settling import _by_all_others
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.gnss_policy import split_fixes
from gtsam_nav.series import BoolArray, GnssSeries
from gtsam_nav.simulation import inject
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
    reasons = "position outlier", "first fix off the next"
    return sorted(r.index for r in solution.rejections if r.reason in reasons)


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


@pytest.mark.slow
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


def test_only_outliers_call_for_the_robust_start(
    laps: Mission, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[int] = []
    plain = settling._Batch.robust_start

    def counted(batch: settling._Batch, estimate: settling._Estimate) -> Any:
        started.append(1)
        return plain(batch, estimate)

    monkeypatch.setattr(settling._Batch, "robust_start", counted)
    gn.estimate(laps, "graph")
    assert not started
    gn.estimate(displaced(laps, np.arange(90) % 5 == 2, seed=2), "graph")
    assert started


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.3, 0.5])
def test_as_many_outliers_as_good_fixes_do_not_break_the_motion(
    marina: Mission, share: float
) -> None:
    """One fix in five seconds: no two good ones follow each other for long."""
    sparse = ("gnss.use=every_k", "gnss.every_k=5")
    config = gn.load_config(None, sparse)
    fault = f"gnss:outliers={share},size=20:100"
    clean, faulty = (gn.estimate(marina, "graph", config, faults=f) for f in ((), (fault,)))
    n = clean.gnss_used + len(position_outliers(clean))
    assert len(position_outliers(faulty)) == pytest.approx(share * n, abs=2)
    assert rms_m(faulty) <= 1.5 * rms_m(clean)
    believing = gn.load_config(None, [*sparse, "graph.robust.gnss.gate_probability=null"])
    assert rms_m(gn.estimate(marina, "graph", believing, faults=(fault,))) > 5 * rms_m(clean)


def test_any_sensor_can_have_a_gate(marina: Mission) -> None:
    """Spikes of a depth sensor and of a compass, at keyframes that no neighbour shares."""
    depth, heading = marina.sensors["depth"], marina.sensors["heading"]
    spoilt_depth = depth.series.depth_m.copy()  # type: ignore[attr-defined]
    spoilt_depth[np.abs(depth.series.t - 60.0) < 1.0] += 5.0
    wild = heading.series.heading.copy()  # type: ignore[attr-defined]
    off_s = heading.series.t - 80.0
    # no step: these are taken off before; a keyframe's heading is the mean of 5 s of readings
    wild += np.where(np.abs(off_s) < 2.5, 1.2 * np.cos(np.pi * off_s / 5.0), 0.0)
    faulty = marina.with_sensor(
        replace(depth, series=replace(depth.series, depth_m=spoilt_depth))
    ).with_sensor(replace(heading, series=replace(heading.series, heading=wild)))
    gates = [
        f"graph.robust.{kind}.{key}"
        for kind in ("depth", "heading")
        for key in ("gate_probability=0.9999", "kernel=none")
    ]
    solution = gn.estimate(faulty, "graph", gn.load_config(None, gates))
    found = {r.sensor: r for r in solution.rejections if r.reason == f"{r.sensor} outlier"}
    assert {"depth", "heading"} <= set(found)
    assert found["depth"].t == pytest.approx(60.0, abs=3.0)
    assert found["heading"].t == pytest.approx(80.0, abs=6.0)
    assert found["depth"].normalised_residual is not None
    assert found["depth"].normalised_residual > 10
    down = solution.trajectory.p_n[:, 2]
    assert np.max(np.abs(np.diff(down))) < 0.5


@pytest.mark.slow
@pytest.mark.realdata
def test_st_pere_keeps_its_accuracy_among_outliers(stpere_folder: Path) -> None:
    """One fix in 30 s, without the sonar: the outliers are found, which least squares suffer."""
    mission = gn.open_mission(stpere_folder).crop(0.0, 1500.0)
    overrides = ["gnss.use=every_k", "gnss.every_k=30", "sonar.use=false"]
    config = gn.load_config(None, overrides)
    least_squares = gn.load_config(None, [*overrides, "graph.robust.gnss.gate_probability=null"])
    fault = "gnss:outliers=0.5,size=20:100"
    blind, _, _ = split_fixes(mission, config.gnss)
    before, after = (m.sensors["gnss"].series for m in (blind, inject(blind, [fault])))
    assert isinstance(before, GnssSeries)
    assert isinstance(after, GnssSeries)
    hit = before.row[np.any(before.p_n != after.p_n, axis=1)].tolist()

    def run(settings: gn.Config, *faults: str) -> tuple[float, set[int]]:
        solution = gn.estimate(mission, "graph", settings, faults=faults)
        errors = gn.evaluate(solution, window_s=(0.0, 1500.0)).ate.none
        assert errors is not None
        return errors.mean, set(position_outliers(solution))

    clean_m, _ = run(config)
    error_m, found = run(config, fault)
    assert set(hit) <= found
    assert len(found) <= len(hit) + 3
    # half of the fixes tell less than all of them, whoever leaves the others out
    assert error_m < 1.0
    assert run(least_squares, fault)[0] > 5 * clean_m


def test_readings_that_refuse_each_other_in_turn_all_stay_out(
    laps: Mission, monkeypatch: pytest.MonkeyPatch
) -> None:
    rounds = []

    def quarrel(batch: Any, _: Any, weight: Array, *_doubted: Any) -> Array:
        a, b = np.flatnonzero(batch.gated)[:2]
        squared = np.zeros(len(weight))
        squared[a], squared[b] = 1e9 * (weight[b] > 0), 1e9 * (weight[a] > 0)
        rounds.append(squared)
        return squared

    monkeypatch.setattr(settling._Batch, "judged", quarrel)
    monkeypatch.setattr(settling._Batch, "explained", lambda *_: True)
    solution = gn.estimate(laps, "graph")
    assert len([r for r in solution.rejections if r.sensor == "gnss"]) == 2
    assert len(rounds) <= 4
