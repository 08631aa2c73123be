"""The scan viewer's data: raw beams, deskewed points, and what the loops make of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gtsam_nav.evaluation.histories import ranked
from gtsam_nav.evaluation.page.columns import (
    ANGLE_DEG,
    TIME_S,
    Document,
    packed,
    packed_bytes,
)
from gtsam_nav.series import BeamSeries, IntArray
from gtsam_nav.solution import Solution, SonarScans
from gtsam_nav.sonar.echoes import beam_bearings

MOST_BINS = 100
"""Of a beam; neighbouring bins of a longer one are taken together, the strongest stands."""
MOST_RAW_CELLS = 8_000_000
"""Beams times bins; of a longer mission the scans that are in no loop are left out first."""
LEVELS = 16
"""Shades of the raw picture."""
POINT_M = 0.02


def sonar_document(solutions: Sequence[Solution]) -> Document | None:
    """The scans of the foremost solution that has some; None where none has."""
    solution = next((s for s in ranked(solutions) if s.scans is not None and len(s.scans)), None)
    if solution is None or solution.scans is None:
        return None
    scans = solution.scans
    return {
        "method": solution.method,
        "sensor": scans.sensor,
        "simulated": solution.mission.sensors[scans.sensor].simulated,
        "t": packed(scans.t, TIME_S),
        "first": packed(scans.first),
        "x": packed(scans.xy[:, 0], POINT_M),
        "y": packed(scans.xy[:, 1], POINT_M),
        "raw": _raw(solution, scans),
    }


def _raw(solution: Solution, scans: SonarScans) -> Document | None:
    """Beams with their bearings from the bow; None for scans that were extracted elsewhere."""
    sonar = solution.mission.sensors[scans.sensor]
    beams = sonar.series
    if not isinstance(beams, BeamSeries):
        return None
    pool = -(-beams.intensity.shape[1] // MOST_BINS)
    n_bins = -(-beams.intensity.shape[1] // pool)
    kept = _scans_in_budget(solution, scans, n_bins)
    if not len(kept):
        return None
    beam = np.concatenate([np.arange(scans.first_beam[k], scans.last_beam[k]) for k in kept])
    sizes = scans.last_beam[kept] - scans.first_beam[kept]
    return {
        "scan": kept.tolist(),
        "first": packed(np.concatenate([[0], np.cumsum(sizes)])),
        "bearing_deg": packed(np.degrees(beam_bearings(sonar, beams.angle[beam])), ANGLE_DEG),
        "bins": n_bins,
        "bin_m": pool * beams.resolution_m,
        "levels": LEVELS,
        "intensity": packed_bytes(_pooled(beams.intensity[beam], pool)),
    }


def _scans_in_budget(solution: Solution, scans: SonarScans, n_bins: int) -> IntArray:
    """Scans whose raw beams are shown: all that fit, those of loops before the others."""
    times = {t for loop in solution.loops for t in (loop.t_a, loop.t_b)}
    in_loop = np.isin(scans.t, list(times))
    order = np.argsort(~in_loop, kind="stable")
    cells = np.cumsum((scans.last_beam - scans.first_beam)[order]) * n_bins
    return np.sort(order[cells <= MOST_RAW_CELLS])


def _pooled(intensity: NDArray[np.uint8], pool: int) -> NDArray[np.uint8]:
    """The strongest of each so many bins, in few levels."""
    missing = -intensity.shape[1] % pool
    padded = np.pad(intensity, ((0, 0), (0, missing)))
    strongest = padded.reshape(len(intensity), -1, pool).max(axis=2)
    return np.asarray(strongest // (256 // LEVELS), dtype=np.uint8)
