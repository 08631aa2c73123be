"""Fixes of a poorer solution than a receiver's best: float beside fixed, stand-alone beside DGPS.

What such a solution is off by lasts for minutes: ambiguities that are not resolved, the ionosphere.
A sigma of half a metre that each of sixty fixes had for itself would tell the place to centimetres.
Where no card states what successive fixes share, the poorer ones are taken to share an error of
their own size, beside it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.first_fixes import located
from gtsam_nav.sensors.noise import GnssNoise
from gtsam_nav.series import BoolArray, GnssSeries

POORER = 5.0
"""A sigma that is so many times that of the best is another solution's, not another geometry's."""
BEST_PERCENTILE, FEWEST_FIXES = 5.0, 6


def with_poorer_fixes(mission: Mission) -> Mission:
    """The mission in which fixes of a poorer solution share an error, with what is said of them."""
    for receiver in mission.of_type("gnss"):
        series = receiver.series
        assert isinstance(series, GnssSeries)
        if GnssNoise.model_validate(receiver.noise).correlated_share > 0:
            continue
        sigma = series.sigma[:, :2].max(axis=1)
        poorer, best_m = _poorer(sigma, located(series))
        if series.offset_sigma is not None:  # these share one already
            poorer &= series.offset_sigma == 0
        if np.sum(poorer) < FEWEST_FIXES:
            continue
        usual_m = float(np.median(sigma[poorer]))
        offset = np.zeros(len(series)) if series.offset_sigma is None else series.offset_sigma
        offset = np.where(poorer, usual_m, offset)
        total = np.where(poorer[:, None], np.hypot(series.sigma, usual_m), series.sigma)
        shared = replace(series, sigma=total, offset_sigma=offset)
        said = (
            f"{np.sum(poorer)} fixes of '{receiver.name}' state sigmas of {usual_m:.2g} m or so,"
            f" others {best_m:.2g} m: of a poorer solution, they are taken to share an error of"
            " that size; noise: {correlated_share: ...} says otherwise"
        )
        mission = replace(
            mission.with_sensor(replace(receiver, series=shared)),
            warnings=(*mission.warnings, said),
        )
    return mission


def _poorer(sigma: Array, known: BoolArray) -> tuple[BoolArray, float]:
    """Which fixes are of a poorer solution, and the sigma of the best, m."""
    if not np.any(known):
        return known, 0.0
    best_m = float(np.percentile(sigma[known], BEST_PERCENTILE))
    return known & (sigma > POORER * best_m), best_m
