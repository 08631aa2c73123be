"""Inertial factors of ours against a bare loop: the same samples, the same preintegration.

Ours interpolates the readings to the keyframes, takes the lever arm off, follows gravity and adds
the biases' walk; the loop gets what that made, and does nothing but integrate and make the factor.
Times are the processor's.
"""

from __future__ import annotations

import statistics
import time
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

import gtsam_nav as gn
from gtsam_nav.config import Config
from gtsam_nav.graph.measurements import imu
from gtsam_nav.graph.outset import mission_keyframes, start_and_motion
from gtsam_nav.graph.preintegration import InertialStep, Readings
from gtsam_nav.graph.problem import Problem
from gtsam_nav.preprocess.motion import measures_velocity

KINDS = ("standard", "combined")


def measure(repeats: int) -> dict[str, Any]:
    """Microseconds a sample by kind of preintegration, on the marina's ten minutes at 100 Hz."""
    mission = gn.simulate("marina", seed=0).without("sonar")
    rows, ratios = {}, {}
    for kind in KINDS:
        config = gn.load_config(None, [f"graph.imu_preintegration={kind}"])
        runs = [_once(mission, config, kind) for _ in range(repeats)]
        ours, bare = (1e6 * statistics.median(run[n] for run in runs) for n in (0, 1))
        rows[kind] = {"samples": runs[0][2], "ours_us": ours, "bare_us": bare}
        for name in ("ours_us", "bare_us"):
            rows[kind][name] /= runs[0][2]
        ratios[f"{kind}_over_bare"] = ours / bare
    return {"kinds": rows, "ratios": ratios}


def _once(mission: gn.Mission, config: Config, kind: str) -> tuple[float, float, int]:
    """Seconds of ours, those of the loop, and the samples."""
    start, motion = start_and_motion(mission, config)
    t = mission_keyframes(mission, np.empty(0), np.empty(0), config)
    problem = Problem(
        t=t,
        alignment=start,
        motion=motion,
        uses_imu=True,
        has_compass=True,
        measures_velocity=measures_velocity(mission),
        origin=mission.origin,
    )
    begin = time.process_time()
    imu.add(problem, mission, config)
    steps = [step for step in problem.steps if isinstance(step, InertialStep)]
    made = [step.factor for step in steps]
    built = time.process_time()
    assert len(made) == len(steps) > 0
    readings = [step.readings() for step in steps]
    bare = _standard if kind == "standard" else _combined
    looped = time.process_time()
    bare(problem, steps, readings)
    end = time.process_time()
    return built - begin, end - looped, sum(len(r.dt) for r in readings)


def _standard(problem: Problem, steps: list[Any], readings: list[Readings]) -> Any:
    graph = gtsam.NonlinearFactorGraph()
    for k, (step, own) in enumerate(zip(steps, readings, strict=True), start=1):
        pim = gtsam.PreintegratedImuMeasurements(step.parameters, problem.bias)
        for f, omega, dt in zip(*own, strict=True):
            pim.integrateMeasurement(f, omega, dt)
        graph.push_back(gtsam.ImuFactor2(X(k - 1), X(k), B(k - 1), pim))
    return graph


def _combined(problem: Problem, steps: list[Any], readings: list[Readings]) -> Any:
    graph = gtsam.NonlinearFactorGraph()
    for k, (step, own) in enumerate(zip(steps, readings, strict=True), start=1):
        pim = gtsam.PreintegratedCombinedMeasurements(step.walking, problem.bias)
        for f, omega, dt in zip(*own, strict=True):
            pim.integrateMeasurement(f, omega, dt)
        keys = (X(k - 1), V(k - 1), X(k), V(k), B(k - 1), B(k))
        graph.push_back(gtsam.CombinedImuFactor(*keys, pim))
    return graph
