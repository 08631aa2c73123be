"""Correlative registration: every pose that the prior allows is tried, so that none is overlooked.

Olson, *Real-time correlative scan matching* (ICRA 2009). The reference points are blurred into a
field on a grid, and a pose scores by the mean of the field under the new points. Iterative methods
find the solution nearest to their start; this finds the best, and says where another is as good: in
a corridor, or where two places look alike, there is none to be believed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.registration.settings import CorrelativeSettings
from gtsam_nav.series import IntArray

BLUR_CELLS = 1.0
"""Standard deviation of the field around a reference point."""
MARGIN_CELLS = 4
"""By which the field reaches beyond the points."""
BLOCK = 4
"""Cells a side that are tried together: where the best of them cannot be good, none is."""
GATE = 16.27
"""Chi-square of 0.999, three degrees of freedom: poses less likely by the prior are not tried."""


@dataclass(frozen=True)
class Found:
    """The best pose of the new points in the reference.

    Attributes
    ----------
    q : ndarray, shape (3,)
        x, y (m) and yaw (rad, clockwise from above), to the grid's step.
    score : float
        Share of the new points that the reference explains there.
    failure : str
        Why it must not be used; empty where it may.
    """

    q: Array
    score: float
    failure: str = ""


def search(
    reference: Array, new: Array, prior: Array, cov_prior: Array, settings: CorrelativeSettings
) -> Found:
    """Search all poses that a prior allows.

    Parameters
    ----------
    reference, new : ndarray, shapes (n, 2) and (m, 2)
        Points, each set in its own frame, m.
    prior : ndarray, shape (3,)
        Expected pose of the new points in the reference: x, y, yaw.
    cov_prior : ndarray, shape (3, 3)
    settings : CorrelativeSettings
    """
    from gtsam_nav.registration._correlative_kernel import score_volume

    cell_m = settings.cell_m
    step_rad = cell_m / max(float(np.sqrt(np.mean(np.sum(new**2, axis=1)))), cell_m)
    cov = cov_prior + np.diag([cell_m, cell_m, step_rad]) ** 2
    farthest = np.array([settings.reach_m, settings.reach_m, np.radians(settings.reach_deg)])
    reach = np.minimum(np.sqrt(GATE * np.diag(cov)), farthest)
    field, corner = _field(reference, cell_m)
    turns = np.arange(-int(reach[2] / step_rad), int(reach[2] / step_rad) + 1) * step_rad
    blocks = int(np.ceil(max(reach[:2]) / cell_m / BLOCK))
    volume = score_volume(
        field,
        _bound(field),
        BLOCK,
        corner,
        cell_m,
        new,
        prior,
        np.linalg.inv(cov),
        GATE,
        np.asarray(turns, dtype=float),
        blocks,
        settings.max_rival,
    )
    best = np.array(np.unravel_index(np.argmax(np.nan_to_num(volume)), volume.shape))
    score = float(np.nan_to_num(volume[tuple(best)]))
    q = prior + np.array([*((best[1:] - blocks * BLOCK) * cell_m), turns[best[0]]])
    q[2] = wrap_angle(q[2])
    if score < settings.min_score:
        return Found(q, score, f"score {score:.2f} below {settings.min_score:.2f}")
    rival = _rival(volume, best, settings, step_rad)
    if rival > settings.max_rival * score:
        return Found(q, score, f"ambiguous: {rival / score:.2f} of its score elsewhere")
    return Found(q, score)


def thinned(xy: Array, cell_m: float) -> Array:
    """One point a cell, the mean of those in it, shape (k, 2)."""
    cells = np.floor(xy / cell_m).astype(np.int64)
    _, inverse, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    sums = [np.bincount(inverse.ravel(), axis) for axis in xy.T]
    return np.stack(sums, axis=1) / count[:, None]


def _field(xy: Array, cell_m: float) -> tuple[Array, Array]:
    """Nearness to the points on a grid, one at a point, and the middle of its first cell."""
    from scipy.ndimage import distance_transform_edt

    corner = xy.min(axis=0) - MARGIN_CELLS * cell_m
    index = np.rint((xy - corner) / cell_m).astype(np.int64)
    free = np.ones(index.max(axis=0) + MARGIN_CELLS + 1, dtype=bool)
    free[index[:, 0], index[:, 1]] = False
    distance = distance_transform_edt(free)
    return np.asarray(np.exp(-0.5 * (distance / BLUR_CELLS) ** 2), dtype=float), corner


def _bound(field: Array) -> Array:
    """Greatest value in the block of cells that begins at each one; the margin holds no more."""
    from scipy.ndimage import maximum_filter

    return np.asarray(maximum_filter(field, BLOCK, origin=-(BLOCK // 2), mode="constant"))


def _rival(volume: Array, best: IntArray, settings: CorrelativeSettings, step_rad: float) -> float:
    """Best score of the poses that are clearly others."""
    k, i, j = np.ogrid[tuple(slice(n) for n in volume.shape)]
    away = np.hypot(i - best[1], j - best[2]) * settings.cell_m > settings.rival_m
    turned = np.abs(wrap_angle((k - best[0]) * step_rad))
    away = away | (turned > np.radians(settings.rival_deg))
    return float(np.nanmax(np.where(away, volume, np.nan), initial=0.0))
