"""The judgement of loop closures before any of them enters the final solution."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.graph.backend import graph_of
from gtsam_nav.graph.loop_consistency import (
    doubted,
    evidence_of,
    graduated_inliers,
    keyframes_of,
    largest_consistent_set,
    normalised_squares,
)
from gtsam_nav.graph.online import match_factor
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.scan_matching import ScanMatch
from gtsam_nav.graph.sensor_posterior import sensor_posterior
from gtsam_nav.graph.settling import Settled, settle
from gtsam_nav.series import IntArray

log = logging.getLogger(__name__)


def judged(
    matches: Sequence[ScanMatch],
    problem: Problem,
    values: Any,
    scan_keyframe: IntArray,
    config: Config,
) -> tuple[list[ScanMatch], Settled | None]:
    """All matches, of the accepted closures only those that pass still so.

    Parameters
    ----------
    matches : sequence of ScanMatch
        Those of consecutive scans are left alone.
    values : gtsam.Values
        Start.

    Returns
    -------
    matches : list of ScanMatch
    settled : Settled or None
        The solution without any closure that they were judged by, if any were.
    """
    settings, robust = config.graph.loops, config.graph.robust
    loops = [m for m in matches if m.is_loop and m.accepted]
    if not loops or (settings.consistency_probability is None and settings.arbiter == "none"):
        return list(matches), None
    consecutive = [
        match_factor(m, scan_keyframe, robust.loops)
        for m in matches
        if m.accepted and not m.is_loop
    ]
    settled = settle(problem, [*problem.entries, *consecutive], values)
    graph = graph_of(problem.entries)
    graph.push_back(settled.factors)
    graph.push_back(graph_of(consecutive))
    keyframes = keyframes_of(loops, scan_keyframe)
    posterior = sensor_posterior(graph, settled.values, keyframes, problem)
    evidence = doubted(evidence_of(loops, scan_keyframe, posterior))
    reasons = [""] * len(loops)
    left = np.arange(len(loops))
    if settings.consistency_probability is not None:
        kept = largest_consistent_set(evidence, settings.consistency_probability)
        for i in left[~kept].tolist():
            reasons[i] = "inconsistent with other loops"
        left = left[kept]
    if settings.arbiter == "gnc" and len(left):
        kept = graduated_inliers(evidence.select(left), settings.arbiter_probability)
        for i in left[~kept].tolist():
            reasons[i] = "truncated by the arbiter"
        left = left[kept]
    log.info("%d of %d loop closures believed", len(left), len(loops))
    believed = np.array([not reason for reason in reasons])
    residuals = np.sqrt(normalised_squares(evidence, believed)).tolist()
    verdicts = {
        id(m): replace(m, reason=reason, normalised_residual=residual)
        for m, reason, residual in zip(loops, reasons, residuals, strict=True)
        if reason
    }
    return [verdicts.get(id(m), m) for m in matches], settled
