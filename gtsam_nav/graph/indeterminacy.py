"""States that the measurements do not determine: found before the solve, or named after it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.errors import EstimationError
from gtsam_nav.frames import Array
from gtsam_nav.graph import factors
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.keys import index_of, letter_of
from gtsam_nav.graph.problem import RECEIVER_STRIDE, Problem
from gtsam_nav.graph.readings import made
from gtsam_nav.graph.sensor_posterior import tangent_width
from gtsam_nav.series import IntArray

LEAST_INFORMATION = 1e-9
"""On a whole trajectory's place or turn, 1/m^2 or 1/rad^2: a prior of a kilometre has more."""
_INDETERMINATE = re.compile(r"Indeterminate linear system.*?variable\s+(\d+)", re.DOTALL)
_STATES = {
    "x": "pose and velocity",
    "b": "IMU bias",
    "m": "compass bias",
    "g": "shared GNSS error",
}


def check_anchored(problem: Problem) -> None:
    """Raise an EstimationError where some keyframes hang together, but on nothing else.

    All states of a connected part of the graph are moved together north, east, down and turned in
    yaw; where no residual changes, only differences were measured. The solvers would not notice:
    they return a place all the same.
    """
    graph, values = _first_linearisation(problem)
    keys = sorted(values.keys())
    i, j, s = graph.linearize(values).sparseJacobian_()
    widths = [tangent_width(key) for key in keys]
    first = np.concatenate([[0], np.cumsum(widths)])
    part = _connected(graph, keys)
    for label in range(int(part.max()) + 1):
        members = [n for n in np.flatnonzero(part == label).tolist() if letter_of(keys[n]) in "xl"]
        keyframes = [index_of(keys[n]) for n in members if letter_of(keys[n]) == "x"]
        if not keyframes:
            continue
        gauge = np.zeros((int(first[-1]), 4))
        rows = first[members][:, None] + np.arange(9)
        gauge[rows] = _rigid_motion([values.atNavState(keys[n]) for n in members])
        inside = j <= first[-1]  # the last column is the residual
        moved = np.zeros((int(i.max()), 4))
        columns = j[inside].astype(np.int64) - 1
        np.add.at(moved, i[inside].astype(np.int64) - 1, s[inside, None] * gauge[columns])
        if float(np.linalg.eigvalsh(moved.T @ moved)[0]) < LEAST_INFORMATION:
            begin, end = problem.t[min(keyframes)], problem.t[max(keyframes)]
            raise EstimationError(
                f"nothing tells where the vehicle is, or which way it points, from {begin:.1f} s to"
                f" {end:.1f} s: only its motion was measured there; give an initial position and"
                " heading, GNSS, or surveyed landmarks"
            )


def _first_linearisation(problem: Problem) -> tuple[Any, Any]:
    """All factors at the first values of all states.

    Inertial readings, not integrated yet, tell only of differences: they are mere links here.
    """
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    nothing = factors.precisions(np.zeros(9))
    for k in range(len(problem.t)):
        factors.insert(values, X(k), problem.initial_state(k))
        for key, first in problem.variables[k]:
            factors.insert(values, key, first(values.atNavState))
        for entry in problem.factors[k]:
            graph.add(entry.gaussian)
        if problem.steps[k] is not None:
            link = gtsam.BetweenFactorNavState(X(k - 1), X(k), gtsam.NavState(), nothing)
            graph.add(link)
    for factor in made(problem.all_readings, values.atNavState):
        graph.add(factor)
    return graph, values


def _connected(graph: Any, keys: list[int]) -> IntArray:
    """Which part of the graph each variable belongs to, shape (n,)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    place = {key: n for n, key in enumerate(keys)}
    links = [
        (place[a], place[b])
        for a, *others in (graph.at(n).keys() for n in range(graph.size()))
        for b in others
    ]
    a, b = np.array(links, dtype=np.int64).reshape(-1, 2).T
    _, part = connected_components(coo_array((np.ones(len(a)), (a, b)), shape=(len(keys),) * 2))
    return np.asarray(part, dtype=np.int64)


def _rigid_motion(states: list[Any]) -> Array:
    """Tangents of m states, (m, 9, 4), as all move north, east and down, and turn about their
    middle."""
    R_nb = np.array([state.attitude().matrix() for state in states])
    p_n = np.array([state.position() for state in states])
    v_n = np.array([state.velocity() for state in states])
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # down x
    motion = np.zeros((len(states), 9, 4))
    motion[:, 3:6, :3] = np.swapaxes(R_nb, 1, 2)
    motion[:, :3, 3] = R_nb[:, 2]
    motion[:, 3:6, 3] = np.einsum("kji,kj->ki", R_nb, (p_n - p_n.mean(axis=0)) @ turned.T)
    motion[:, 6:, 3] = np.einsum("kji,kj->ki", R_nb, v_n @ turned.T)
    return motion


@contextmanager
def states_named(problem: Problem) -> Iterator[None]:
    """Turn GTSAM's indeterminate system into an error that names the state and its sensors."""
    try:
        yield
    except (RuntimeError, EstimationError) as error:
        found = _INDETERMINATE.search(f"{error} {error.__cause__}")
        if found is None:
            raise
        key = int(found.group(1))
        sensors = _sensors_of(problem, key)
        touching = ", ".join(sensors) if sensors else "none is there"
        raise EstimationError(
            f"the {_state(problem, key)} is not determined by the sensors that should have"
            f" constrained it: {touching}"
        ) from error


def _state(problem: Problem, key: int) -> str:
    kind, index = letter_of(key), index_of(key)
    if kind == "l":
        names = [str(name) for name, own in problem.landmarks.items() if own == key]
        brought = [k for k, new in enumerate(problem.variables) if any(v == key for v, _ in new)]
        t = problem.t[brought[0]] if brought else problem.t[0]
        return f"place of landmark {names[0] if names else index}, first seen at {t:.1f} s,"
    if kind == "s":
        names = [name for name, own in problem.range_scales.items() if own == key]
        return f"range scale of '{names[0] if names else index}'"
    k = index % RECEIVER_STRIDE
    if kind == "m" and k == len(problem.t):
        return "constant compass bias"
    what = _STATES.get(kind, f"state '{kind}'")
    return f"{what} of keyframe {k} at {problem.t[min(k, len(problem.t) - 1)]:.1f} s"


def _sensors_of(problem: Problem, key: int) -> list[str]:
    """Sensors with a factor on a state, or a reading at its keyframe, in order of the graph."""
    sensors = [e.sensor for e in problem.entries if key in e.gaussian.keys()]  # noqa: SIM118
    if letter_of(key) == "x":
        sensors += [reading.sensor for reading in problem.readings[index_of(key)]]
    return list(dict.fromkeys(sensors))
