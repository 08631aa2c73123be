"""Sigmas of fixes against how the fixes scatter: those that are in mm."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtsam_nav.audit import fixes
from gtsam_nav.audit.findings import Finding
from gtsam_nav.mission import Sensor
from gtsam_nav.preprocess.first_fixes import located
from gtsam_nav.series import GnssSeries

LARGE_M = 8.0
"""Stand-alone receivers, whose fixes follow each other smoothly, state less."""
QUIET = 100.0
"""Fixes that scatter so many times less than they state are better than that."""
FEWEST_FIXES = 20
MEDIAN_CHI2 = 0.455
"""Of one degree of freedom."""
THIRD_DIFFERENCE = np.sqrt(20.0)
"""Standard deviation of white noise's third difference, which a steady turn leaves out."""


def sigma_findings(receiver: Sensor) -> Iterator[Finding]:
    """A warning where the sigmas of a receiver are far too large for its fixes."""
    series = receiver.series
    assert isinstance(series, GnssSeries)
    series = series.select(located(series))
    if len(series) < FEWEST_FIXES:
        return
    stated_m = float(np.median(series.sigma[:, :2]))
    third = np.diff(series.p_n[:, :2], n=3, axis=0)
    scatter_m = float(np.sqrt(np.median(third**2) / MEDIAN_CHI2)) / THIRD_DIFFERENCE
    if stated_m < LARGE_M or scatter_m > stated_m / QUIET:
        return
    yield Finding(
        "gnss sigma",
        receiver.name,
        "warning",
        f"the fixes state sigmas of {stated_m:.3g} m, and scatter by {scatter_m:.2g} m: where the"
        " sigmas are in mm, this mends them",
        fixes.scale("sigma_n sigma_e sigma_d", 1e-3),
    )
