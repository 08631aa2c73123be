"""Which fixes a solution took: those that it had and did not reject, no more than it counts."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import GnssSeries
from gtsam_nav.solution import Solution


def used_fixes(solution: Solution) -> tuple[Array, Array]:
    """Times (k,) and places (k, 3) of the fixes that a solution used, in the order of time.

    A method that takes its start from a fix and nothing else counts one: the first.
    """
    rejected = {(r.sensor, r.index) for r in solution.rejections}
    t, p_n = [np.empty(0)], [np.empty((0, 3))]
    for sensor in solution.mission.of_type("gnss"):
        series = sensor.series
        assert isinstance(series, GnssSeries)
        kept = [(sensor.name, row) not in rejected for row in series.row.tolist()]
        t.append(series.t[kept])
        p_n.append(series.p_n[kept])
    stamps, places = np.concatenate(t), np.concatenate(p_n)
    first = np.argsort(stamps, kind="stable")[: solution.gnss_used]
    return stamps[first], places[first]
