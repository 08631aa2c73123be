"""What a trajectory in other axes than its reference looks like: a hint, never a score.

Alignments neither reflect nor exchange axes; so a trajectory in east, north, up that is read as
north, east, down scores badly, and nothing in the figures says why.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gtsam_nav.evaluation.alignment import fit_rigid
from gtsam_nav.evaluation.matching import match
from gtsam_nav.frames import Array
from gtsam_nav.series import ReferenceSeries
from gtsam_nav.trajectory import Trajectory

EXPLAINS = 0.2
"""A reading of the axes that leaves less of the error than this share of it explains it."""
FEWEST = 10

READINGS: tuple[tuple[str, Array], ...] = (
    ("north and east are exchanged (ENU read as NED)", np.array([[0.0, 1.0], [1.0, 0.0]])),
    ("east is reversed", np.diag([1.0, -1.0])),
    ("north is reversed", np.diag([-1.0, 1.0])),
    ("north and east are exchanged and both reversed", np.array([[0.0, -1.0], [-1.0, 0.0]])),
    ("it is turned by 180 deg", -np.eye(2)),
    ("it is turned by -90 deg", np.array([[0.0, -1.0], [1.0, 0.0]])),
    ("it is turned by 90 deg, clockwise", np.array([[0.0, 1.0], [-1.0, 0.0]])),
)
"""What is odd about the trajectory, and the matrix that mends it, on (n, e)."""


def frame_hint(
    trajectory: Trajectory,
    reference: ReferenceSeries,
    lever_b: ArrayLike = (0.0, 0.0, 0.0),
    window_s: tuple[float, float] | None = None,
    *,
    georeferenced: bool = True,
) -> str | None:
    """Say which reading of the axes explains most of a trajectory's error, if one does.

    Parameters
    ----------
    trajectory, reference, lever_b, window_s, georeferenced
        As `gtsam_nav.evaluation.metrics.evaluate_trajectory` takes them.

    Returns
    -------
    str or None
    """
    matched = match(trajectory, reference, lever_b, window_s)
    if matched is None or len(matched.t) < FEWEST:
        return None
    seen, meant = (
        p_n[:, :2] - p_n[:, :2].mean(axis=0)
        for p_n in (matched.estimate.p_n, matched.reference.p_n)
    )
    aligned_m = _rmse_m(seen @ fit_rigid(seen, meant)[0].T - meant)
    mirrored = seen * [1.0, -1.0]
    mirrored_m = _rmse_m(mirrored @ fit_rigid(mirrored, meant)[0].T - meant)
    name, left_m = min(
        ((name, _rmse_m(seen @ axes.T - meant)) for name, axes in READINGS), key=lambda r: r[1]
    )
    if mirrored_m < EXPLAINS * aligned_m:
        if not georeferenced or left_m > EXPLAINS * aligned_m:
            name, left_m = "it is mirrored (left and right exchanged)", mirrored_m
        return _hint(name, f"{aligned_m:.2f} m after SE(2)", left_m)
    stated_m = _rmse_m(seen - meant)
    if georeferenced and left_m < EXPLAINS * stated_m:
        return _hint(name, f"{stated_m:.2f} m", left_m)
    return None


def _rmse_m(error_n: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(error_n**2, axis=1))))


def _hint(name: str, now: str, left_m: float) -> str:
    return (
        f"the trajectory looks as if {name}: otherwise its rmse about the mean error would be"
        f" {left_m:.2f} m, not {now}"
    )
