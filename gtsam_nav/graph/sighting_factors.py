"""Sightings of landmarks as native factors, linear about the present estimate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.graph.factors import LinearFactor, Several, displaced, nav_state

Pair = tuple[Any, Any]


@dataclass(frozen=True)
class SightingSlopes:
    """Derivatives of a sighting's residual (m,), each of shape (m, 3), along body axes.

    In the landmark's offset from the body, ``R_nb' (l_n - p_n)``, and in a small turn of the body.
    """

    offset: Array
    turn: Array


def sighting(key: int, landmark: int, measured_b: Array, root: Array) -> Any:
    """A sighting, linear about the landmark's present offset ``R_nb' (l_n - p_n)`` from the body.

    The native residual is that offset less a measured one: here the one at which the linearised
    sighting would agree (`step_back`), weighed along range and bearing. Made anew at each estimate,
    it is the sighting's own least squares once that no longer moves.

    Parameters
    ----------
    measured_b : ndarray, shape (3,)
    root : ndarray, shape (9, 9)
        Of the information, as `offset_roots` has it.
    """
    noise = gtsam.noiseModel.Gaussian.SqrtInformation(root, False)
    return gtsam.BetweenFactorNavState(key, landmark, displaced(measured_b), noise)


def offset_roots(by_offset: Array, sigma: Array) -> Array:
    """Square roots (n, 9, 9) of what sightings tell of the position of one NavState in another.

    Parameters
    ----------
    by_offset : ndarray, shape (n, m, 3)
        Jacobians of their residuals (n, m) in the offset.
    sigma : ndarray, shape (n, m)
    """
    roots = np.zeros((len(sigma), 9, 9))
    roots[:, : sigma.shape[1], 3:6] = by_offset / sigma[:, :, None]
    return roots


def step_back(offset: Array, by_offset: Array, residual: Array) -> Array:
    """Offsets (..., 3) after the shortest step that takes their residuals (..., m) away."""
    turned = np.swapaxes(by_offset, -1, -2)
    gram = by_offset @ turned + 1e-18 * np.eye(residual.shape[-1])
    along = np.linalg.solve(gram, residual[..., None])
    return np.asarray(offset - (turned @ along)[..., 0])


def leaning_sighting(
    key: int, landmark: int, states: Pair, slopes: SightingSlopes, residual: Array, sigma: Array
) -> Any:
    """As `sighting`, where a tilt of the body must not pass for an offset of the landmark.

    The offset along body axes mixes a tilt with the depth between the two, which means nothing
    where the landmark is level with the body; of ranges alone its direction means nothing either.
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
    step_b = step_back(np.zeros(3), slopes.offset, residual)
    p_n = states[0].position() - states[1].position() - R_nb @ step_b
    measured = nav_state(R_nb, p_n, np.zeros(3))
    return gtsam.BetweenFactorNavState(landmark, key, measured, noise)


def scaled_sighting(
    keys: Several,
    states: Several,
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
