"""Our graph against the barest GTSAM script: same factors, same updates, same questions.

The script replays into a fresh iSAM2 what ours was given, keyframe by keyframe, and asks it what
ours asks: each keyframe's state and covariance. What ours takes beyond that is bookkeeping: every
factor and first value, which come ready to the replay, and the preintegration of inertial readings.
A script is complete (``graph_over_script``) once it makes these too: noise, kernel, a factor that
has them, from numbers that lie ready; and runs a bare loop over the readings, once.

The batch is compared with one Levenberg-Marquardt of the factors that the batch ends with. Ours
also makes its readings, solves, makes them anew at the solution and again until they no longer
move, and judges by all others those near their gates: ``batch_solve_over_raw`` is what its solves
alone take. Times are the processor's: all of it is one thread, and other programs do not count.
"""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import gtsam
import numpy as np

import gtsam_nav as gn
from gtsam_nav.config import Config
from gtsam_nav.graph import backend, settling
from gtsam_nav.graph.factors import X, insert
from gtsam_nav.graph.measurements import build_problem
from gtsam_nav.graph.online import run_online
from gtsam_nav.graph.outset import mission_keyframes, start_and_motion
from gtsam_nav.graph.preintegration import InertialStep, Readings
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.settling import settle
from gtsam_nav.mission import Mission
from gtsam_nav.solution import no_progress

VICTORIA_PARK = "victoria_park.txt"
VICTORIA_S = 500.0
"""A pose a second; all 6968 take minutes."""


RATIOS = (
    "bookkeeping_over_solve",
    "graph_over_script",
    "batch_over_raw",
    "batch_solve_over_raw",
)
NO_SCANS = np.empty(0, dtype=int)


class Recorder:
    """An iSAM2 that remembers what it was given."""

    def __init__(self, isam: Any) -> None:
        self._isam = isam
        self.updates: list[tuple[Any, Any]] = []
        self.options: list[dict[str, Any]] = []

    def update(self, graph: Any, values: Any, **options: Any) -> Any:
        self.updates.append((graph, values))
        self.options.append(options)
        return self._isam.update(graph, values, **options)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._isam, name)


def measure(repeats: int) -> dict[str, Any]:
    """The marina without its sonar, and the first poses of Victoria Park with its landmarks."""
    marina = gn.simulate("marina", seed=0).without("sonar")
    victoria = gn.open_mission(Path(gtsam.findExampleDataFile(VICTORIA_PARK)))
    missions = {"marina": marina, "victoria": victoria.crop(stop_s=VICTORIA_S)}
    rows = {name: _compare(mission, repeats) for name, mission in missions.items()}
    ratios = {f"{what}_{name}": row[what] for name, row in rows.items() for what in RATIOS}
    return {"missions": rows, "ratios": ratios}


def _compare(mission: Mission, repeats: int) -> dict[str, Any]:
    config = Config()
    recorder = _record(mission, config)
    n_keyframes = len(_problem(mission, config)[0].t)
    runs = [_once(mission, config, recorder) for _ in range(repeats)]
    medians = {name: statistics.median(run[name] for run in runs) for name in runs[0]}
    ours = medians["building_s"] + medians["isam2_s"]
    script = medians["script_s"] + medians["raw_preintegration_s"]
    return {
        **medians,
        "keyframes": n_keyframes,
        "bookkeeping_over_solve": (ours - medians["raw_isam2_s"]) / medians["raw_isam2_s"],
        "script_bookkeeping_over_solve": script / medians["raw_isam2_s"] - 1.0,
        "graph_over_script": ours / script,
        "batch_over_raw": medians["batch_s"] / medians["raw_batch_s"],
        "batch_solve_over_raw": medians["batch_solve_s"] / medians["raw_batch_s"],
    }


def _problem(mission: Mission, config: Config) -> tuple[Problem, float]:
    """The factors of a mission, and how long they took once its motion was known."""
    start, motion = start_and_motion(mission, config)
    t = mission_keyframes(mission, np.empty(0), np.empty(0), config)
    begin = time.process_time()
    problem = build_problem(mission, start, motion, t, config)
    return problem, time.process_time() - begin


def _record(mission: Mission, config: Config) -> Recorder:
    recorders = []
    plain = backend._isam2

    def recording(is_stiff: bool) -> Recorder:
        recorders.append(Recorder(plain(is_stiff)))
        return recorders[-1]

    backend._isam2 = recording
    try:
        run_online(_problem(mission, config)[0], None, NO_SCANS, config, no_progress)
    finally:
        backend._isam2 = plain
    return recorders[0]


def _once(mission: Mission, config: Config, recorder: Recorder) -> dict[str, float]:
    problem, building_s = _problem(mission, config)
    step = config.graph.keyframes_per_update
    recipes = [_Recipe.of(graph, values) for graph, values in recorder.updates]
    steps = [(own, own.readings()) for own in problem.steps if isinstance(own, InertialStep)]
    marks = [time.process_time()]
    online = run_online(problem, None, NO_SCANS, config, no_progress)
    marks.append(time.process_time())
    _replay(recorder.updates, recorder.options, problem, step)
    marks.append(time.process_time())
    _replay((recipe.made() for recipe in recipes), recorder.options, problem, step)
    marks.append(time.process_time())
    _preintegrate(steps)
    marks.append(time.process_time())
    graph, values = backend.graph_of(problem.entries), online.values
    marks.append(time.process_time())
    with _timed_solves() as solves:
        settled = settle(problem, problem.entries, values)
    marks.append(time.process_time())
    graph.push_back(settled.factors)
    gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    marks.append(time.process_time())
    spans = [b - a for a, b in itertools.pairwise(marks)]
    names = (
        "isam2_s",
        "raw_isam2_s",
        "script_s",
        "raw_preintegration_s",
        "collecting_s",
        "batch_s",
        "raw_batch_s",
    )
    timed = dict(zip(names, spans, strict=True))
    return {"building_s": building_s, **timed, "batch_solve_s": sum(solves)}


@contextmanager
def _timed_solves() -> Iterator[list[float]]:
    """Seconds of each solve of a batch."""
    plain, seconds = settling.solve_batch, []

    def timed(*given: Any, **options: Any) -> Any:
        begin = time.process_time()
        try:
            return plain(*given, **options)
        finally:
            seconds.append(time.process_time() - begin)

    settling.solve_batch = timed
    try:
        yield seconds
    finally:
        settling.solve_batch = plain


@dataclass(frozen=True)
class _Recipe:
    """What a bare script makes for one update: factors with their noises, and first values."""

    factors: list[tuple[Any, Callable[[], Any] | None]]
    states: list[tuple[int, Any]]

    @classmethod
    def of(cls, graph: Any, values: Any) -> _Recipe:
        """Of an update's factors and values."""
        factors = [graph.at(i) for i in range(graph.size())]
        states = []
        for key in values.keys():  # noqa: SIM118
            is_bias = chr(gtsam.Symbol(key).chr()) == "b"
            states.append((key, (values.atConstantBias if is_bias else values.atNavState)(key)))
        return cls([(factor, _noise_of(factor)) for factor in factors], states)

    def made(self) -> tuple[Any, Any]:
        """The update."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for factor, noise in self.factors:
            graph.add(factor if noise is None else factor.cloneWithNewNoiseModel(noise()))
        for key, state in self.states:
            insert(values, key, state)
        return graph, values


def _noise_of(factor: Any) -> Callable[[], Any] | None:
    """Makes a factor's noise; None where that follows from readings or the linearisation."""
    kinds = gtsam.noiseModel
    if isinstance(factor, (gtsam.ImuFactor2, gtsam.LinearContainerFactor)):
        return None
    noise = factor.noiseModel()
    inner = noise.noise() if isinstance(noise, kinds.Robust) else noise
    if isinstance(inner, kinds.Diagonal):
        make = partial(kinds.Diagonal.Precisions, np.array(inner.precisions()))
    else:
        make = partial(kinds.Gaussian.SqrtInformation, np.array(inner.R()), False)
    if inner is noise:
        return make
    kernel = noise.robust()
    return lambda: kinds.Robust.Create(kernel, make())


def _replay(
    updates: Iterable[tuple[Any, Any]],
    options: Iterable[dict[str, Any]],
    problem: Problem,
    step: int,
) -> None:
    isam = backend._isam2(problem.is_stiff)
    for k, ((graph, values), told) in enumerate(zip(updates, options, strict=True)):
        isam.update(graph, values, **told)
        for j in range(k * step, min((k + 1) * step, len(problem.t))):
            isam.calculateEstimateNavState(X(j))
            isam.marginalCovariance(X(j))


def _preintegrate(steps: Iterable[tuple[InertialStep, Readings]]) -> None:
    for step, own in steps:
        pim = gtsam.PreintegratedImuMeasurements(step.parameters, step.bias)
        for accel, gyro, dt in zip(own.accel, own.gyro, own.dt.tolist(), strict=True):
            pim.integrateMeasurement(accel, gyro, dt)
