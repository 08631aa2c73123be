"""Where the fixes lie, against the mission's stated origin."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtsam_nav.audit import fixes
from gtsam_nav.audit.findings import Finding
from gtsam_nav.frames import Array, Origin, geodetic_from_ned, ned_from_geodetic
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import GnssSeries

FAR_M = 200e3
"""No day at sea ends further from where it began."""


def place_findings(mission: Mission, receiver: Sensor) -> Iterator[Finding]:
    """Judge the distance of a receiver's fixes from the origin."""
    series, origin = receiver.series, mission.origin
    assert isinstance(series, GnssSeries)
    p_n = series.p_n[np.all(np.isfinite(series.p_n), axis=1)]
    if origin is None or not len(p_n):
        return
    place_n = np.median(p_n, axis=0)
    distance_m = float(np.linalg.norm(place_n[:2]))
    read = f"the fixes lie {distance_m / 1e3:.1f} km from the mission's origin"
    if distance_m < FAR_M:
        yield Finding("fixes against origin", receiver.name, "ok", read)
        return
    what, fix = "the origin or the fixes are wrong", ""
    if _exchanged_distance_m(place_n, origin) < FAR_M:
        what, fix = "their latitude and longitude are exchanged", fixes.EXCHANGED_DEGREES
    yield Finding("fixes against origin", receiver.name, "warning", f"{read}: {what}", fix)


def _exchanged_distance_m(place_n: Array, origin: Origin) -> float:
    """Distance from the origin were latitude and longitude the other way round."""
    latitude_deg, longitude_deg, height_m = geodetic_from_ned(place_n, origin)
    exchanged_n = ned_from_geodetic(longitude_deg, latitude_deg, height_m, origin)
    return float(np.linalg.norm(exchanged_n[:2]))
