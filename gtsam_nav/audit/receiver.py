"""The velocities of a receiver against its own fixes: east and north exchanged, wrong signs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtsam_nav.audit import fixes
from gtsam_nav.audit.courses import BASELINE_M, BASELINE_SIGMAS, FEWEST_BASELINES, far_apart, way
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.significance import best, losses
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Sensor
from gtsam_nav.series import GnssSeries

READINGS: tuple[tuple[str, str, Array], ...] = (
    ("", "", np.eye(2)),
    (
        "east and north exchanged (ENU)",
        fixes.columns({"vn": "ve", "ve": "vn"}) + ", " + fixes.scale("vd", -1),
        np.array([[0.0, 1.0], [1.0, 0.0]]),
    ),
    ("vn reversed", fixes.scale("vn", -1), np.diag([-1.0, 1.0])),
    ("ve reversed", fixes.scale("ve", -1), np.diag([1.0, -1.0])),
    ("vn and ve reversed", fixes.scale("vn ve", -1), -np.eye(2)),
)
"""What is odd, what mends it, and the velocity (n, e) that is meant; the stated one first."""


def velocity_findings(gnss: Sensor) -> Iterator[Finding]:
    """Compare the direction of the velocities with that of the fixes, between fixes well apart."""
    series = gnss.series
    assert isinstance(series, GnssSeries)
    if series.v_n is None:
        return
    length_m = max(BASELINE_M, BASELINE_SIGMAS * float(np.median(series.sigma[:, :2])))
    pairs = far_apart(series, length_m)
    if len(pairs) < FEWEST_BASELINES:
        return
    first, last = np.array(pairs).T
    seen = series.p_n[last, :2] - series.p_n[first, :2]
    way_n = way(series.t, series.v_n[:, :2])
    by_velocity = way_n[last] - way_n[first]
    errors = wrap_angle(
        np.array([_angle(by_velocity @ meant.T) - _angle(seen) for *_, meant in READINGS])
    )
    chosen = best(losses(errors))
    median_deg = float(np.degrees(np.median(errors[chosen])))
    read = f"velocities less fixes: {median_deg:+.1f} deg over {len(pairs)} baselines"
    if chosen:
        name, fix, _ = READINGS[chosen]
        message = f"{read} once {name}, as they seem to be"
        yield Finding("gnss velocity", gnss.name, "warning", message, fix)
    else:
        yield Finding("gnss velocity", gnss.name, "ok", read)


def _angle(vectors_n: Array) -> Array:
    return np.arctan2(vectors_n[:, 1], vectors_n[:, 0])
