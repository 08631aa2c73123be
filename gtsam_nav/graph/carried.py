"""Where the IMU carries keyframes on their way to the next: the readings of many intervals at once.

As GTSAM's preintegration predicts it, but that turns multiply where that adds in the tangent of the
first attitude: the two differ by the square of what a single reading turns.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.graph.factors import parts
from gtsam_nav.graph.preintegration import InertialStep, Readings
from gtsam_nav.preprocess.running_turns import running_turns
from gtsam_nav.series import BoolArray, IntArray


@dataclass(frozen=True)
class Carried:
    """States at n times: attitudes (n, 3, 3), velocities and positions (n, 3)."""

    R_nb: Array
    v_n: Array
    p_n: Array

    def split(self, at: IntArray) -> list[Carried]:
        """Its parts before, between and after given places."""
        columns = (np.split(column, at) for column in (self.R_nb, self.v_n, self.p_n))
        return [Carried(*one) for one in zip(*columns, strict=True)]


def joined(parts: Iterable[Carried]) -> Carried:
    """All of them, one after the other."""
    columns = zip(*((one.R_nb, one.v_n, one.p_n) for one in parts), strict=True)
    return Carried(*map(np.concatenate, columns))


def coasted(before: Any, elapsed: Array) -> Carried:
    """States at times after a keyframe at its velocity and attitude."""
    (R_nb,), (p_n,), (v_n,) = parts([before])
    n = len(elapsed)
    return Carried(np.tile(R_nb, (n, 1, 1)), np.tile(v_n, (n, 1)), p_n + elapsed[:, None] * v_n)


@dataclass(frozen=True)
class _Pieces:
    """Pieces of time between readings' ends and wanted times, one interval after the other.

    Attributes
    ----------
    of, row : ndarray of int, shape (k,)
        Interval, and which of all readings lasts.
    place : ndarray of int, shape (k,)
        How many pieces of the interval come before.
    dt : ndarray, shape (k,)
    wanted : ndarray of bool, shape (k,)
        Whether a wanted time is its end.
    """

    of: IntArray
    row: IntArray
    place: IntArray
    dt: Array
    wanted: BoolArray


def carried(
    steps: Sequence[InertialStep],
    before: Sequence[Any],
    biases: Sequence[Any],
    elapsed: Sequence[Array],
) -> Carried:
    """States at times after keyframes, by the readings of their steps, all in a row.

    Parameters
    ----------
    steps : sequence of InertialStep, length m
    before, biases : sequences of NavState and imuBias.ConstantBias, length m
        Where each begins.
    elapsed : sequence of ndarray
        Times of each after its keyframe, increasing, s.
    """
    readings = [step.readings() for step in steps]
    pieces = _pieces([own.dt for own in readings], elapsed)
    omega_b, force_b = _in_body_axes(steps, readings, biases)
    R_0k = running_turns(omega_b[pieces.row] * pieces.dt[:, None], pieces.place)
    # a reading pushes along the attitude that it finds
    found = np.where((pieces.place > 0)[:, None, None], np.roll(R_0k, 1, axis=0), np.eye(3))
    dt = pieces.dt[:, None]
    gained = np.einsum("kij,kj->ki", found, force_b[pieces.row]) * dt
    v_0 = _summed(gained, pieces.place)
    p_0 = _summed((v_0 - 0.5 * gained) * dt, pieces.place)
    at = pieces.wanted
    return _placed(
        steps, before, pieces.of[at], np.concatenate(elapsed), R_0k[at], v_0[at], p_0[at]
    )


def _pieces(durations: Sequence[Array], elapsed: Sequence[Array]) -> _Pieces:
    counts = np.array([len(dt) for dt in durations])
    ends = np.concatenate([np.cumsum(dt) for dt in durations])
    times = np.concatenate([ends, *elapsed])
    index = np.arange(len(durations))
    of = np.concatenate([np.repeat(index, counts), np.repeat(index, [len(t) for t in elapsed])])
    order = np.lexsort((times, of))
    of, times, is_end = of[order], times[order], order < len(ends)
    row = np.minimum(np.cumsum(is_end) - is_end, np.cumsum(counts)[of] - 1)
    first = np.searchsorted(of, index)[of]
    place = np.arange(len(of)) - first
    dt = np.where(place > 0, np.diff(times, prepend=0.0), times)
    return _Pieces(of, row, place, dt, ~is_end)


def _in_body_axes(
    steps: Sequence[InertialStep], readings: Sequence[Readings], biases: Sequence[Any]
) -> tuple[Array, Array]:
    """Rates and specific forces at the body's origin, (n, 3) each: less biases, and less what the
    turning presses an IMU at the end of its arm outward with."""
    omega, force = [], []
    for step, own, bias in zip(steps, readings, biases, strict=True):
        mount = step.parameters.getBodyPSensor()
        omega_b, force_b = own.gyro - bias.gyroscope(), own.accel - bias.accelerometer()
        if mount is not None:
            R_bs, arm_b = mount.rotation().matrix(), mount.translation()
            omega_b, force_b = omega_b @ R_bs.T, force_b @ R_bs.T
            if np.any(arm_b):
                force_b = force_b - np.cross(omega_b, np.cross(omega_b, arm_b))
        omega.append(omega_b)
        force.append(force_b)
    return np.concatenate(omega), np.concatenate(force)


def _summed(increments: Array, place: IntArray) -> Array:
    """Sums (k, 3) of an interval's increments so far."""
    whole = np.cumsum(increments, axis=0)
    first = np.arange(len(place)) - place
    return np.asarray(whole - (whole - increments)[first])


def _placed(
    steps: Sequence[InertialStep],
    before: Sequence[Any],
    of: IntArray,
    t: Array,
    R_0k: Array,
    v_0: Array,
    p_0: Array,
) -> Carried:
    """From what the readings make of a body at rest without weight, in the axes it began in, to
    where it is in the navigation frame, which turns with the Earth."""
    from scipy.spatial.transform import Rotation

    R_n0, p_n0, v_n0 = (part[of] for part in parts(before))
    gravity_n = np.array([step.parameters.n_gravity for step in steps])[of]
    rates = [step.parameters.getOmegaCoriolis() for step in steps]
    earth_n = np.array([np.zeros(3) if rate is None else rate for rate in rates])[of]
    t = t[:, None]
    pushed, shifted = (np.einsum("kij,kj->ki", R_n0, by_force) for by_force in (v_0, p_0))
    # to first order: the axes turn away from the force, and from the velocity twice as fast
    v_turned = np.cross(earth_n, t * pushed + shifted + 2.0 * t * v_n0 + t**2 * gravity_n)
    p_turned = np.cross(earth_n, t * shifted + t**2 * v_n0 + t**3 / 3.0 * gravity_n)
    turn = Rotation.from_matrix(R_0k).as_rotvec() - t * np.einsum("kji,kj->ki", R_n0, earth_n)
    return Carried(
        R_n0 @ Rotation.from_rotvec(turn).as_matrix(),
        v_n0 + t * gravity_n + pushed - v_turned,
        p_n0 + t * v_n0 + 0.5 * t**2 * gravity_n + shifted - p_turned,
    )
