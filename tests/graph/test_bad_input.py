"""What no estimator can make sense of: said clearly, before the solve where it can be."""

from __future__ import annotations

from dataclasses import replace

import gtsam
import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.config import Config
from gtsam_nav.errors import DataError, EstimationError
from gtsam_nav.graph import factors
from gtsam_nav.graph.backend import Backend
from gtsam_nav.graph.factors import B, L, M, X
from gtsam_nav.graph.indeterminacy import check_anchored, states_named
from gtsam_nav.graph.keyframes import keyframe_times
from gtsam_nav.graph.least_squares import solve_batch
from gtsam_nav.graph.measurements import build_problem
from gtsam_nav.graph.problem import Problem
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.alignment import align
from gtsam_nav.preprocess.motion import vehicle_motion
from gtsam_nav.series import DvlSeries, GnssSeries
from gtsam_nav.solution import Solution


@pytest.fixture(scope="module")
def mission() -> Mission:
    return gn.simulate("marina", seed=5, duration_s=100.0).without("sonar", "landmarks")


def estimated(mission: Mission, *faults: str) -> Solution:
    return gn.estimate(mission, "graph", faults=faults)


def make_problem(mission: Mission) -> Problem:
    start = align(mission)
    motion = vehicle_motion(mission, start, Config().motion)
    t = keyframe_times(*mission.span_s, np.empty(0), 5.0)
    return build_problem(mission, start, motion, t, Config())


# ---------------------------------------------------------------------- sensors against each other


@pytest.mark.slow
def test_fixes_that_are_all_outliers_do_not_pass_for_a_position(mission: Mission) -> None:
    solution = estimated(mission, "gnss:outliers=1.0,size=20:100")
    clean = estimated(mission)
    assert solution.gnss_used <= 3
    assert not solution.georeferenced
    (said,) = [warning for warning in solution.warnings if "fixes agree with each other" in warning]
    assert said.endswith("so where they put the vehicle is arbitrary")
    shape, clean_shape = (gn.evaluate(s).ate.se2 for s in (solution, clean))
    assert shape is not None
    assert clean_shape is not None
    assert shape.mean < clean_shape.mean + 0.5
    rejected = [r for r in solution.rejections if r.sensor == "gnss"]
    assert len(rejected) == len(mission.sensors["gnss"].series) - solution.gnss_used
    judged = [r for r in rejected if r.reason != "first fix off the next"]
    assert len(judged) > 0.8 * len(rejected)
    assert all(r.normalised_residual is not None and r.normalised_residual > 3 for r in judged)


def test_two_receivers_that_contradict_each_other_are_named(mission: Mission) -> None:
    gnss = mission.sensors["gnss"]
    assert isinstance(gnss.series, GnssSeries)
    away = replace(gnss.series, t=gnss.series.t + 0.3, p_n=gnss.series.p_n + np.array([50.0, 0, 0]))
    solution = estimated(mission.with_sensor(replace(gnss, name="stern gnss", series=away)))
    loser = [w for w in solution.warnings if "contradict each other" in w]
    assert len(loser) == 1
    assert "gnss'" in loser[0]
    # one of the two is believed, and not the mean of both
    track = solution.trajectory
    truth = mission.sensors["reference"].series
    north = np.interp(track.t, truth.t, truth.p_n[:, 0])  # type: ignore[attr-defined]
    off = float(np.median(track.p_n[:, 0] - north))
    assert min(abs(off), abs(off - 50.0)) < 1.5


def test_a_log_and_fixes_that_contradict_each_other_are_named(mission: Mission) -> None:
    """A DVL at half speed: whichever is believed, the other is said to be at odds."""
    dvl = mission.sensors["dvl"]
    assert isinstance(dvl.series, DvlSeries)
    slow = replace(dvl, series=replace(dvl.series, v_d=0.5 * dvl.series.v_d))
    solution = estimated(mission.with_sensor(slow))
    assert any("contradict each other" in warning for warning in solution.warnings)


def test_outliers_that_nothing_holds_back_are_named_first(mission: Mission) -> None:
    """Least squares on them bends all others: what bends comes first, and the way out."""
    bare = [f"graph.robust.gnss.{key}" for key in ("kernel=none", "gate_probability=null")]
    fault = "gnss:outliers=0.3,size=20:100"
    solution = gn.estimate(mission, "graph", gn.load_config(None, bare), faults=(fault,))
    (warning,) = [w for w in solution.warnings if "contradict each other" in w]
    assert warning.startswith("'gnss' (half of its residuals are above ")
    assert "'velocity' (" in warning
    assert "a gate keeps outliers of 'gnss' from pulling the others" in warning
    assert not any("seems to be" in w for w in solution.warnings)


def test_agreement_brings_no_warning(mission: Mission) -> None:
    solution = estimated(mission)
    assert solution.georeferenced
    assert not any("contradict" in warning for warning in solution.warnings)
    weights = solution.robust_weights
    assert {"velocity", "heading", "depth", "gnss"} <= set(weights)
    assert weights["velocity"].kernel == "huber"
    for own in weights.values():
        assert len(own.t) == len(own.residual) == len(own.weight)
        assert np.mean(own.weight < 0.5) < 0.1


# ----------------------------------------------------------------------------------- noise figures


@pytest.mark.parametrize("name", ["gnss", "depth", "heading", "dvl"])
def test_a_sigma_of_zero_is_named_with_its_sensor(mission: Mission, name: str) -> None:
    sensor = mission.sensors[name]
    sigma = sensor.series.sigma.copy()  # type: ignore[attr-defined]
    sigma[7] = 0.0
    spoilt = replace(sensor, series=replace(sensor.series, sigma=sigma))
    t = sensor.series.t[7]
    with pytest.raises(DataError, match=f"sensor '{name}': sigma is 0 at {t:.1f} s.*kernel"):
        estimated(mission.with_sensor(spoilt))


# ------------------------------------------------------------------------------- what is not tied


def test_a_graph_that_nothing_anchors_is_found_before_the_solve(mission: Mission) -> None:
    problem = make_problem(mission.without("gnss"))
    check_anchored(problem)
    problem.factors[0] = [entry for entry in problem.factors[0] if entry.sensor != "start"]
    end = problem.t[-1]
    with pytest.raises(EstimationError, match=rf"the vehicle is.*from 0\.\d s to {end:.1f} s"):
        check_anchored(problem)


def test_a_part_that_is_cut_off_is_named_by_its_times(mission: Mission) -> None:
    problem = make_problem(mission.without("gnss", "imu", "heading"))
    cut = 9
    problem.factors[cut] = [e for e in problem.factors[cut] if len(e.gaussian.keys()) == 1]
    with pytest.raises(EstimationError, match=f"from {problem.t[cut]:.1f} s"):
        check_anchored(problem)


def test_an_indeterminate_keyframe_is_named_with_its_time_and_sensors(mission: Mission) -> None:
    """Neither its motion nor a fix: depth and attitude alone are left."""
    problem = make_problem(mission.without("gnss", "imu", "heading"))
    for k in (6, 7):
        problem.factors[k] = [e for e in problem.factors[k] if e.sensor != "velocity"]
    backend = Backend(problem)
    for k in range(10):
        backend.add_keyframe(k)
    what = rf"pose and velocity of keyframe 6 at {problem.t[6]:.1f} s is not determined.*depth"
    with pytest.raises(EstimationError, match=what) as raised, states_named(problem):
        backend.update()
    assert "attitude" in str(raised.value)


@pytest.mark.parametrize(
    ("key", "name"),
    [
        (B(3), r"IMU bias of keyframe 3 at \d+\.\d s"),
        (M(2), r"compass bias of keyframe 2 at"),
        (L(4), r"place of landmark 4"),
    ],
)
def test_each_kind_of_state_has_a_name(mission: Mission, key: int, name: str) -> None:
    problem = make_problem(mission)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(factors.depth(key, 2.0, np.zeros(3), 0.1))
    values.insert(key, gtsam.NavState())
    with pytest.raises(EstimationError, match=name), states_named(problem):
        gtsam.GaussNewtonOptimizer(graph, values).optimize()


def test_other_errors_pass_as_they_are(mission: Mission) -> None:
    problem = make_problem(mission)
    with pytest.raises(EstimationError, match="diverged"), states_named(problem):
        raise EstimationError("the batch solve diverged")
    with pytest.raises(RuntimeError, match="something else"), states_named(problem):
        raise RuntimeError("something else")


def test_a_failed_batch_is_named_too(mission: Mission, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = make_problem(mission)

    def fail(*_args: object) -> None:
        raise RuntimeError(
            f"\nIndeterminate linear system detected while working near variable\n{X(5)} (Symbol:"
        )

    for method in ("GaussNewton", "LevenbergMarquardt"):
        monkeypatch.setattr(gtsam, f"{method}Optimizer", fail)
    with pytest.raises(EstimationError, match="keyframe 5 at"), states_named(problem):
        solve_batch(gtsam.NonlinearFactorGraph(), gtsam.Values())


def test_a_sonar_whose_place_drifts_out_of_its_sight_is_not_registered_jointly() -> None:
    """The map of all echoes would span kilometres, for nothing measures the velocity."""
    whole = gn.simulate("marina", seed=7, duration_s=60.0)
    others = [name for name in whole.sensors if name not in ("imu", "sonar")]
    solution = gn.estimate(whole.without(*others), "graph")
    (said,) = [w for w in solution.warnings if "not registered jointly" in w]
    assert "nothing measures the velocity" in said
    assert np.all(np.isfinite(solution.trajectory.p_n))
