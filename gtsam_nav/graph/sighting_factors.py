"""Sightings of landmarks as native factors, linear about the present estimate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.graph.factors import LinearFactor, Trio, nav_state

Pair = tuple[Any, Any]


@dataclass(frozen=True)
class SightingSlopes:
    """Derivatives of a sighting's residual (m,), each of shape (m, 3), along body axes.

    In the landmark's offset from the body, ``R_nb' (l_n - p_n)``, and in a small turn of the body.
    """

    offset: Array
    turn: Array


def sighting(
    key: int, landmark: int, offset_b: Array, by_offset: Array, residual: Array, sigma: Array
) -> Any:
    """A sighting, linear about the landmark's present offset ``R_nb' (l_n - p_n)`` from the body.

    The native residual is that offset less a measured one: here the one at which the linearised
    sighting would agree, weighed along range and bearing. Made anew at each estimate, it is the
    sighting's own least squares once that no longer moves.

    Parameters
    ----------
    offset_b : ndarray, shape (3,)
    by_offset : ndarray, shape (m, 3)
        Jacobian of the sighting's residual (m,) in the offset.
    residual, sigma : ndarray, shape (m,)
        Of the sighting at that offset.
    """
    measured_b = offset_b + _step(by_offset, residual)
    root = np.zeros((9, 9))
    root[: len(residual), 3:6] = by_offset / sigma[:, None]
    noise = gtsam.noiseModel.Gaussian.SqrtInformation(root, False)
    measured = nav_state(np.eye(3), measured_b, np.zeros(3))
    return gtsam.BetweenFactorNavState(key, landmark, measured, noise)


def level_sighting(
    key: int, landmark: int, states: Pair, slopes: SightingSlopes, residual: Array, sigma: Array
) -> Any:
    """As `sighting`, of a landmark that is level with a body which may tilt, and be anywhere deep.

    The offset along body axes mixes a tilt with the depth between the two, which means nothing.
    The native residual is here that of the body in the landmark's frame, along n, where the depth
    is a component of its own; how the body is turned is the rotation's part of it.

    Parameters
    ----------
    states : tuple of two NavStates
        Of the body, and of the landmark, of which only the position means anything.
    """
    R_nb = states[0].attitude().matrix()
    root = np.zeros((9, 9))
    root[: len(residual), :3] = slopes.turn / sigma[:, None]
    root[: len(residual), 3:6] = -slopes.offset / sigma[:, None]
    noise = gtsam.noiseModel.Gaussian.SqrtInformation(root, False)
    p_n = states[0].position() - states[1].position() - R_nb @ _step(slopes.offset, residual)
    measured = nav_state(R_nb, p_n, np.zeros(3))
    return gtsam.BetweenFactorNavState(landmark, key, measured, noise)


def _step(by_offset: Array, residual: Array) -> Array:
    """The shortest step of an offset that takes its residual away, shape (3,)."""
    gram = by_offset @ by_offset.T + 1e-18 * np.eye(len(residual))
    return np.asarray(-by_offset.T @ np.linalg.solve(gram, residual))


def scaled_sighting(
    keys: Trio,
    states: Trio,
    slopes: SightingSlopes,
    by_scale: Array,
    residual: Array,
    sigma: Array,
) -> LinearFactor:
    """As `sighting`, of a sensor whose ranges are all too long by a share that is a state.

    Parameters
    ----------
    keys, states : tuples of three
        Keyframe, landmark and range scale.
    by_scale : ndarray, shape (m,)
        Derivative of the residual (m,) in the scale.
    residual, sigma : ndarray, shape (m,)
    """
    R_nb = states[0].attitude().matrix()
    m = len(residual)
    J_body, J_landmark, J_scale = np.zeros((m, 9)), np.zeros((m, 9)), np.zeros((m, 9))
    J_body[:, :3], J_body[:, 3:6] = slopes.turn, -slopes.offset
    J_landmark[:, 3:6] = slopes.offset @ R_nb.T
    J_scale[:, 3] = by_scale
    across = sigma[:, None]
    jacobians = J_body / across, J_landmark / across, J_scale / across
    return LinearFactor(keys, states, jacobians, residual / sigma)
