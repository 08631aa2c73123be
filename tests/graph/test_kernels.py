"""Kernels by name: each is GTSAM's, with the weight that its paper gives it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import get_args

import gtsam
import numpy as np
import pytest
from pydantic import ValidationError
from scipy.integrate import quad
from scipy.stats import norm

import gtsam_nav as gn
from gtsam_nav.graph import factors
from gtsam_nav.graph.doubts import contradictions
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.robust import CUTTING, THRESHOLDS, KernelName, Robustness
from gtsam_nav.graph.weights import Weighed, weightless
from gtsam_nav.mission import Mission
from gtsam_nav.series import HeadingSeries

# weight of a residual e in units of the threshold
PAPERS: dict[KernelName, Callable[[float], float]] = {
    "none": lambda _: 1.0,
    "huber": lambda e: 1.0 if e <= 1 else 1 / e,
    "cauchy": lambda e: 1 / (1 + e**2),
    "geman_mcclure": lambda e: 1 / (1 + e**2) ** 2,
    # Agarwal et al. 2013
    "dcs": lambda e: min(1.0, 2 / (1 + e**2)) ** 2,
    "tukey": lambda e: (1 - e**2) ** 2 if e < 1 else 0.0,
    "tls": lambda e: 1.0 if e <= 1 else 0.0,
}
KERNELS = get_args(KernelName)
REDESCENDING = ("cauchy", "geman_mcclure", "dcs", "tukey", "tls")


@pytest.mark.parametrize("kernel", KERNELS)
def test_a_kernel_weighs_as_its_paper_says(kernel: KernelName) -> None:
    for threshold in (None, 0.7, 3.0):
        robustness = Robustness(kernel=kernel, threshold=threshold)
        for e in np.linspace(0.0, 12.0, 49):
            wanted = PAPERS[kernel](e / robustness.scale)
            assert factors.weight(robustness, float(e)) == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize("kernel", [k for k in KERNELS if k != "none"])
def test_default_thresholds_are_95_percent_efficient(kernel: KernelName) -> None:
    scale = THRESHOLDS[kernel]

    def expected(f: Callable[[float], float]) -> float:
        inside, outside = (0.0, scale), (scale, 12.0)
        parts = [quad(lambda e: f(e) * norm.pdf(e), *span)[0] for span in (inside, outside)]
        return 2 * float(sum(parts))

    def psi(e: float) -> float:
        return e * PAPERS[kernel](e / scale)

    # by Stein's lemma the first is the mean of psi'
    efficiency = expected(lambda e: e * psi(e)) ** 2 / expected(lambda e: psi(e) ** 2)
    assert efficiency == pytest.approx(0.95, abs=1e-3)


@pytest.mark.parametrize("kernel", KERNELS)
def test_a_solve_finds_the_minimum_under_its_kernel(kernel: KernelName) -> None:
    """Five depths, one wrong: the weighted mean, whose weights are those of its residuals."""
    depths, sigma = np.array([2.0, 2.1, 1.95, 2.05, 4.0]), 0.2
    robustness = Robustness(kernel=kernel)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    pins = factors.precisions([1e4] * 5 + [0.0] + [1e4] * 3)
    graph.add(gtsam.PriorFactorNavState(X(0), gtsam.NavState(), pins))
    for depth_m in depths:
        factor = factors.depth(X(0), depth_m, np.zeros(3), sigma)
        graph.add(factors.robust(factor, robustness))
    values.insert(X(0), factors.nav_state(np.eye(3), np.array([0.0, 0.0, 2.0]), np.zeros(3)))
    solved = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    found = float(solved.atNavState(X(0)).position()[2])
    weights = [factors.weight(robustness, abs(d - found) / sigma) for d in depths]
    assert found == pytest.approx(np.average(depths, weights=weights), abs=1e-3)
    if kernel in REDESCENDING:
        assert found == pytest.approx(depths[:-1].mean(), abs=0.05)


def test_a_section_keeps_its_defaults_beside_what_is_set() -> None:
    robust = gn.load_config(None, ["graph.robust.landmarks.kernel=tukey"]).graph.robust
    assert robust.landmarks.gate_probability == 0.999
    assert robust.landmarks.scale == THRESHOLDS["tukey"]
    assert robust.loops.scale == 1.5


def test_unknown_kernels_and_thresholds_are_refused() -> None:
    for bad in ({"kernel": "welsch"}, {"threshold": 0.0}, {"gate_probability": 0.9}):
        with pytest.raises(ValidationError):
            Robustness.model_validate(bad)


# ------------------------------------------------------------------------ starting far from the end


@pytest.fixture(scope="module")
def disturbed() -> Mission:
    """A compass that is off by many of its sigmas, which the graph's own states make good."""
    mission = gn.simulate("marina", seed=1, duration_s=100.0).without("sonar", "landmarks")
    heading = mission.sensors["heading"]
    assert isinstance(heading.series, HeadingSeries)
    turned = replace(heading.series, heading=heading.series.heading + np.radians(8.0))
    return mission.with_sensor(replace(heading, series=turned))


@pytest.mark.parametrize("kernel", CUTTING)
def test_a_kernel_that_cuts_does_not_begin_with_it(disturbed: Mission, kernel: KernelName) -> None:
    config = gn.load_config(None, [f"graph.robust.heading.kernel={kernel}"])
    weights = gn.estimate(disturbed, "graph", config).robust_weights["heading"]
    assert weights.kernel == kernel
    assert np.mean(weights.weight > 0.5) > 0.8


@pytest.mark.parametrize("sensor", ["heading", "depth", "gnss", "velocity"])
def test_what_a_kernel_leaves_no_weight_is_a_rejection(disturbed: Mission, sensor: str) -> None:
    settings = [f"graph.robust.{sensor}.{key}" for key in ("kernel=tls", "threshold=1.5")]
    if sensor == "gnss":
        settings.append("graph.robust.gnss.gate_probability=null")
    solution = gn.estimate(disturbed, "graph", gn.load_config(None, settings))
    cut = solution.robust_weights[sensor].weight == 0.0
    said = [r for r in solution.rejections if r.reason == "no weight under its kernel (tls)"]
    assert {r.sensor for r in said} == {sensor}
    assert len(said) == np.sum(cut) > 0
    wanted = solution.robust_weights[sensor].residual[cut]
    np.testing.assert_allclose(sorted(r.normalised_residual or 0.0 for r in said), sorted(wanted))


def test_a_hundredth_of_its_weight_is_none() -> None:
    def row(weight: float) -> Weighed:
        return Weighed("gnss", "", 3, "geman_mcclure", True, True, 1.0, 20.0, weight)

    (said,) = weightless([row(0.5), row(0.011), row(0.009)])
    assert said.reason == "no weight under its kernel (geman_mcclure)"


def test_what_contradicts_is_named_with_what_it_measures() -> None:
    def rows(kind: str) -> list[Weighed]:
        return [Weighed("gnss", kind, k, "none", True, True, 1.0, 9.0, 0.1) for k in range(20)]

    (said,) = contradictions([*rows("position outlier"), *rows("velocity outlier")])
    assert "'gnss' position (half of" in said
    assert "'gnss' velocity (half of" in said


def test_only_kernels_that_cut_are_put_off() -> None:
    robust = gn.load_config(
        None, ["graph.robust.depth.kernel=tls", "graph.robust.gnss.kernel=tukey"]
    ).graph.robust
    first = robust.at_first
    assert (first.depth.kernel, first.gnss.kernel) == ("cauchy", "cauchy")
    assert first.gnss.gate_probability == robust.gnss.gate_probability
    unchanged = {"depth": robust.depth, "gnss": robust.gnss}
    assert first.model_copy(update=unchanged) == robust
