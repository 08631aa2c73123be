"""Points of scans that are none: by a range of nothing a scanner may say that nothing came back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtsam_nav.mission import Sensor
from gtsam_nav.series import ScanSeries

NO_RETURN_M = 0.01
"""Nothing can be seen that is nearer than this."""


def without_no_returns(sensor: Sensor) -> tuple[Sensor, tuple[str, ...]]:
    """The sensor without points at the scanner itself, and what to say of them.

    All but scans pass through.
    """
    scans = sensor.series
    if not isinstance(scans, ScanSeries):
        return sensor, ()
    seen = np.hypot(*(scans.points_b[:, :2] - sensor.xyz_b[:2]).T) > NO_RETURN_M
    if np.all(seen):
        return sensor, ()
    first = np.concatenate([[0], np.cumsum(seen)])[scans.first]
    kept = replace(scans, first=first, points_b=scans.points_b[seen])
    warning = f"sensor '{sensor.name}': {np.sum(~seen)} points at the scanner itself are left out"
    return replace(sensor, series=kept), (warning,)
