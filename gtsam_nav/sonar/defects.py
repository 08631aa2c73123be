"""What makes a sonar unusable for scan matching."""

from __future__ import annotations

import numpy as np

from gtsam_nav.mission import Sensor
from gtsam_nav.series import BeamSeries, ScanSeries

WHOLE_SENSOR = -1
"""`Rejection.index` of a sensor that was not used at all."""


def sonar_defect(sonar: Sensor) -> str:
    """Why a sonar cannot be used; empty where it can."""
    series = sonar.series
    if isinstance(series, ScanSeries):
        return "" if len(series.points_b) else "the scans hold no points"
    assert isinstance(series, BeamSeries)
    if len(series) < 3:
        return "fewer than three beams"
    if not np.any(series.intensity):
        return "all echo intensities are zero"
    if np.ptp(series.angle) == 0.0:
        return "the head angle never changes"
    return ""
