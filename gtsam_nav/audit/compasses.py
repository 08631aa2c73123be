"""Two compasses that point apart: one of them is mounted or read otherwise than its card says."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from itertools import combinations

import numpy as np

from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.heading import circular_median_and_spread
from gtsam_nav.audit.significance import limit
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.sensors.noise import HeadingNoise
from gtsam_nav.series import HeadingSeries

TOLERATED_DEG = 10.0
"""Iron aboard turns a compass by so much, course by course."""
MOST_COMPARED = 500


def compass_findings(mission: Mission, radians: Collection[str]) -> Iterator[Finding]:
    """Compare each two compasses; those in radians are told elsewhere."""
    compasses = [s for s in mission.of_type("heading") if s.name not in radians]
    for a, b in combinations(compasses, 2):
        noise_a, noise_b = (HeadingNoise.model_validate(s.noise) for s in (a, b))
        difference = _differences(a, b)
        if len(difference) < 2 or noise_a.magnetic != noise_b.magnetic:
            continue
        median, spread = np.degrees(circular_median_and_spread(difference))
        apart_deg = median + noise_b.declination_deg - noise_a.declination_deg
        apart_deg = (apart_deg + 180.0) % 360.0 - 180.0
        noise_deg = 1.2533 * spread / np.sqrt(len(difference))
        stated_deg = float(np.hypot(noise_a.bias_sigma_deg, noise_b.bias_sigma_deg))
        read = f"points {apart_deg:+.1f} deg from {a.name} in the median, spread {spread:.1f} deg"
        explained_deg = limit(noise_deg, len(difference) - 1, stated_deg)
        if abs(apart_deg) > max(explained_deg, TOLERATED_DEG):
            message = f"{read}: one of the two is mounted or read otherwise than stated"
            yield Finding("compasses apart", b.name, "warning", message)
        else:
            yield Finding("compasses apart", b.name, "ok", read)


def _differences(a: Sensor, b: Sensor) -> Array:
    """Heading of b less that of a, rad, at some of the times of b that a covers."""
    first, second = a.series, b.series
    assert isinstance(first, HeadingSeries)
    assert isinstance(second, HeadingSeries)
    if len(first) < 2:
        return np.empty(0)
    second = second.crop(first.t[0], first.t[-1])
    second = second.select(slice(None, None, 1 + len(second) // MOST_COMPARED))
    at_second = np.interp(second.t, first.t, np.unwrap(first.heading))
    return np.asarray(second.heading - at_second)
