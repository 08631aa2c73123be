"""Injected closures: as many as asked for, the same each time, and kept out of the solution."""

from __future__ import annotations

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.graph.false_loops import LoopFault
from gtsam_nav.graph.scan_matching import ScanMatch, between, compounded
from gtsam_nav.graph.settings import LoopSettings
from gtsam_nav.mission import Mission
from gtsam_nav.registration.prior import PRIOR_CAP
from gtsam_nav.registration.result import PlanarMatch
from gtsam_nav.simulation.faults import FalseLoops
from gtsam_nav.solution import Solution

SETTINGS = LoopSettings(min_separation_s=20.0)
COV = np.diag([0.01, 0.01, 1e-4])


def circling(n: int) -> Array:
    """Scans every five seconds on a circle of 30 m."""
    angle = 0.1 * np.arange(n)
    return np.column_stack([30 * np.sin(angle), -30 * np.cos(angle), angle])


def true_loop(b: int) -> ScanMatch:
    return ScanMatch(0, b, PlanarMatch(np.zeros(3), COV, 0.7, 8), "", is_loop=True)


def drawn(fault: FalseLoops, n: int = 100, seed: int = 0) -> list[ScanMatch]:
    """Closures drawn while each second scan brings a true one."""
    source = LoopFault(
        fault, 5.0 * np.arange(n), circling(n), SETTINGS, np.random.default_rng(seed)
    )
    true, false = [], []
    for s in range(n):
        if s >= 10 and s % 2:
            true.append(true_loop(s))
        false += source.drawn(s, true, ends=s == n - 1)
    return false


@pytest.mark.parametrize(("share", "group"), [(0.5, 1), (0.2, 1), (0.5, 10), (0.2, 10), (0.0, 1)])
def test_the_share_is_of_all_closures(share: float, group: int) -> None:
    false = drawn(FalseLoops(share, group))
    assert len(false) == round(45 * share / (1 - share))
    for m in false:
        assert m.accepted
        assert m.is_injected
        assert m.is_loop
        assert m.recorded_reason == "injected"
        assert 5.0 * (m.b - m.a) >= SETTINGS.min_separation_s
        np.testing.assert_array_equal(m.match.cov, COV)


def test_each_is_a_place_that_a_registration_might_have_found() -> None:
    poses = circling(100)
    for m in drawn(FalseLoops(0.5)):
        turn = wrap_angle(m.match.q[2] - poses[m.b, 2] + poses[m.a, 2])
        noise = 6 * np.sqrt(COV[2, 2])
        assert abs(turn) <= PRIOR_CAP[2] + noise
        assert np.hypot(*m.match.q[:2]) <= SETTINGS.radius_m + 1.0


def test_a_group_agrees_with_the_motion_along_both_passages() -> None:
    poses = circling(100)
    group = drawn(FalseLoops(0.5, 10))[:10]
    first = group[0]
    for m in group[1:]:
        assert (first.a - m.a, first.b - m.b) == (first.b - m.b,) * 2
        to_first, _, _ = between(poses[m.a], poses[first.a])
        from_first, _, _ = between(poses[first.b], poses[m.b])
        expected = compounded(compounded(to_first, first.match.q), from_first)
        off = m.match.q - expected
        off[2] = wrap_angle(off[2])
        # two draws of noise, the first's turn at an arm of metres
        assert np.all(np.abs(off) < [3.0, 3.0, 0.1])


def test_the_same_seed_draws_the_same() -> None:
    def values(seed: int) -> Array:
        return np.array([[m.a, m.b, *m.match.q] for m in drawn(FalseLoops(0.5, 3), seed=seed)])

    np.testing.assert_array_equal(values(1), values(1))
    assert not np.array_equal(values(1), values(2))


SOON = ("graph.loops.min_separation_s=20", "graph.loops.radius_m=30")


@pytest.fixture(scope="module")
def mission() -> Mission:
    return gn.simulate("marina", seed=3, duration_s=90.0)


def estimated(mission: Mission, *overrides: str, faults: tuple[str, ...] = ()) -> Solution:
    return gn.estimate(mission, "graph", gn.load_config(None, [*SOON, *overrides]), faults=faults)


@pytest.mark.slow
@pytest.mark.parametrize("arbiter", ["consistency", "gnc"])
def test_they_are_on_the_record_and_out_of_the_solution(mission: Mission, arbiter: str) -> None:
    """The pose graph before the refinement, which starts from it and uses no closure."""
    alone = "graph.refinement.max_iterations=0"
    judge = {
        "consistency": (),
        "gnc": ("graph.loops.consistency_probability=null", "graph.loops.arbiter=gnc"),
    }[arbiter]
    clean = estimated(mission, alone, *judge)
    faulty = estimated(mission, alone, *judge, faults=("loops:false=0.5",))
    injected = [loop for loop in faulty.loops if loop.reason.startswith("injected")]
    accepted = [loop for loop in clean.loops if loop.verdict == "accepted"]
    assert len(injected) >= len(accepted) >= 1
    assert {loop.verdict for loop in injected} == {"rejected"}
    recorded = [r for r in faulty.rejections if r.reason.startswith("injected")]
    assert len(recorded) == len(injected)
    assert all(r.sensor == "loops" for r in recorded)
    residuals = [r.normalised_residual for r in recorded]
    assert min(r for r in residuals if r is not None) > 3.0
    assert clean.reference is not None
    off = faulty.trajectory.p_n - clean.trajectory.p_n
    assert np.max(np.abs(off)) < 0.2


@pytest.mark.slow
def test_without_any_defence_they_bend_it(mission: Mission) -> None:
    bare = (
        "graph.refinement.max_iterations=0",
        "graph.loops.consistency_probability=null",
        "graph.robust.loops.kernel=none",
        "graph.robust.landmarks.kernel=none",
    )
    clean = estimated(mission, *bare)
    faulty = estimated(mission, *bare, faults=("loops:false=0.5",))
    errors = [gn.evaluate(s).ate.se2 for s in (clean, faulty)]
    assert errors[0] is not None
    assert errors[1] is not None
    assert errors[1].mean > 5 * errors[0].mean


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["loops:false=0.5", "loops:false=0.2,group=10"])
@pytest.mark.parametrize("refined", [False, True], ids=["pose graph", "refined"])
def test_ten_minutes_in_the_marina_stay_as_accurate(fault: str, refined: bool) -> None:
    whole = gn.simulate("marina", seed=1)
    overrides = ["gnss.use=window", "gnss.window_s=[0,120]"]
    overrides += [] if refined else ["graph.refinement.max_iterations=0"]
    config = gn.load_config(None, overrides)
    solutions = [gn.estimate(whole, "graph", config, faults=f) for f in ((), (fault,))]
    clean, faulty = (gn.evaluate(s).ate.se2 for s in solutions)
    assert clean is not None
    assert faulty is not None
    assert faulty.mean <= 1.3 * clean.mean
    injected = [loop for loop in solutions[1].loops if loop.reason.startswith("injected")]
    assert len(injected) >= 4


def test_a_mission_without_loops_says_so(mission: Mission) -> None:
    solution = gn.estimate(mission.without("sonar"), "graph", faults=("loops:false=0.5",))
    assert any("no loop closures" in warning for warning in solution.warnings)
