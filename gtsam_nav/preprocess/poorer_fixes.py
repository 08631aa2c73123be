"""Fixes of a poorer solution than a receiver's best: float beside fixed, stand-alone beside DGPS.

What such a solution is off by lasts for minutes: ambiguities that are not resolved, the ionosphere.
A sigma of half a metre that each of sixty fixes had for itself would tell the place to centimetres.
Where no card states what successive fixes share, the poorer ones are taken to share an error of
their own size, beside it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.first_fixes import located
from gtsam_nav.sensors.fix_errors import solutions
from gtsam_nav.sensors.noise import GnssNoise
from gtsam_nav.series import BoolArray, GnssSeries

FEWEST_FIXES = 6
"""Of a solution."""


def with_poorer_fixes(mission: Mission) -> Mission:
    """The mission in which fixes of a poorer solution share an error, with what is said of them."""
    for receiver in mission.of_type("gnss"):
        if GnssNoise.model_validate(receiver.noise).correlated_share == 0:
            mission = _with_poorer_fixes(mission, receiver)
    return mission


def _with_poorer_fixes(mission: Mission, receiver: Sensor) -> Mission:
    series = receiver.series
    assert isinstance(series, GnssSeries)
    sigma = series.sigma[:, :2].max(axis=1)
    usual = list(filter(_are_several, solutions(sigma, located(series))))
    before = np.zeros(len(series)) if series.offset_sigma is None else series.offset_sigma
    # those beside a jump share an error already
    poorer = [
        which for which in (which & (before == 0) for which in usual[1:]) if _are_several(which)
    ]
    if not poorer:
        return mission
    offset = before.copy()
    for which in poorer:
        offset[which] = np.median(sigma[which])
    total = np.hypot(series.sigma, np.sqrt(offset**2 - before**2)[:, None])
    shared = replace(series, sigma=total, offset_sigma=offset)
    said = (
        f"{np.sum(poorer)} fixes of '{receiver.name}' state sigmas of"
        f" {' and '.join(f'{np.median(sigma[which]):.2g} m' for which in poorer)} or so, others"
        f" {np.median(sigma[usual[0]]):.2g} m: of a poorer solution, they are taken to share an"
        " error of that size; noise: {correlated_share: ...} says otherwise"
    )
    return replace(
        mission.with_sensor(replace(receiver, series=shared)),
        warnings=(*mission.warnings, said),
    )


def _are_several(which: BoolArray) -> bool:
    return int(np.sum(which)) >= FEWEST_FIXES
