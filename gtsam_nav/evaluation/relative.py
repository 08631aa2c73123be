"""Relative pose error: how fast an estimate drifts, whatever its alignment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.evaluation.alignment import align
from gtsam_nav.evaluation.matching import Matched
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.series import IntArray

ROUNDING_M = 1e-6
"""A segment that is this much too short is long enough."""


@dataclass(frozen=True)
class RelativeError:
    """Mean error over path segments of one length.

    ``percent`` is horizontal error over distance; ``deg_per_m`` heading error over distance, None
    where the reference has no heading.
    """

    percent: float
    deg_per_m: float | None


def relative_error(matched: Matched, segment_m: float | None) -> RelativeError | None:
    """Compare the displacements of estimate and reference over all segments of a length.

    With a heading in the reference, displacements are compared in the horizontal body axes of
    their first sample; without one, along the axes of n after the SE(2) alignment. Neither depends
    on where or how the whole trajectory lies.

    Parameters
    ----------
    matched : Matched
    segment_m : float or None
        Length of path along the reference, m; None takes a tenth of all of it.

    Returns
    -------
    RelativeError or None
        None where the reference's path is shorter than the segment.

    Notes
    -----
    Sturm et al., *A benchmark for the evaluation of RGB-D SLAM systems*, IROS 2012, section VI.A,
    over distance as in Geiger et al., CVPR 2012.
    """
    if len(matched.t) < 2:
        return None
    travelled = matched.travelled_m
    length = travelled[-1] / 10.0 if segment_m is None else segment_m
    end = np.searchsorted(travelled, travelled + length - ROUNDING_M)
    begin = np.flatnonzero(end < len(travelled))
    if not len(begin) or length <= ROUNDING_M:
        return None
    end = end[begin]
    covered = travelled[end] - travelled[begin]
    reference_ne = matched.reference.p_n[:, :2]
    if matched.reference.rpy is None:
        aligned = align(matched, "se2")
        assert aligned is not None
        error = _displacement(aligned.p_n, begin, end) - _displacement(reference_ne, begin, end)
        deg_per_m = None
    else:
        yaw, yaw_reference = matched.estimate_yaw, matched.reference.rpy[:, 2]
        error = _displacement(matched.estimate.p_n, begin, end, yaw) - _displacement(
            reference_ne, begin, end, yaw_reference
        )
        turn = wrap_angle((yaw - yaw_reference)[end] - (yaw - yaw_reference)[begin])
        deg_per_m = float(np.degrees(np.mean(np.abs(turn) / covered)))
    percent = 100.0 * float(np.mean(np.hypot(error[:, 0], error[:, 1]) / covered))
    return RelativeError(percent, deg_per_m)


def _displacement(p_n: Array, begin: IntArray, end: IntArray, yaw: Array | None = None) -> Array:
    """Horizontal displacement of each segment, turned by minus the heading at its begin."""
    dn, de = (p_n[end, :2] - p_n[begin, :2]).T
    if yaw is None:
        return np.column_stack([dn, de])
    c, s = np.cos(yaw[begin]), np.sin(yaw[begin])
    return np.column_stack([c * dn + s * de, -s * dn + c * de])
