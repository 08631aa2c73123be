"""Compasses whose headings are in radians where degrees are expected.

Read as degrees they never leave a sector of 6.3 degrees. That they mean the whole circle is told by
the turns of others, by the course over ground, or by how they wrap.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtsam_nav.audit.courses import Velocity, baselines, compass_series
from gtsam_nav.audit.significance import best, losses
from gtsam_nav.audit.turns import (
    FULL_TURN_READ_AS_DEG,
    TurnPair,
    in_radians,
    is_narrow,
    wrong_units,
)
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import HeadingSeries

FEWEST_WRAPS = 2
"""Of a vehicle that swings at anchor one step may look like a wrap."""
LARGE_STEP, NEAR_FULL = 0.1, 0.9
"""Shares of a full turn: no heading steps by more than the one between two samples, but where it
wraps by more than the other."""


def compasses_in_radians(
    mission: Mission,
    pairs: tuple[TurnPair, ...],
    sources: tuple[Velocity, ...],
) -> dict[str, str]:
    """Compasses whose headings are in radians, and what tells it.

    Parameters
    ----------
    mission : Mission
    pairs : tuple of TurnPair
    sources : tuple of Velocity
        What turns headings into a way.
    """
    wrong_unit, found = wrong_units(pairs), {}
    for compass in mission.of_type("heading"):
        series = compass.series
        assert isinstance(series, HeadingSeries)
        if not is_narrow(series):
            continue
        own = [p for p in pairs if compass.name in p.pair]
        if compass.name in wrong_unit or (in_radians(series) and any(p.unit == 1.0 for p in own)):
            others = [p.x if p.y == compass.name else p.y for p in own]
            found[compass.name] = f"then they turn with {' and '.join(others)}"
        elif own:
            continue
        elif _points_along(mission, compass, sources):
            found[compass.name] = "then they go with the course over ground"
        elif _wraps(series):
            found[compass.name] = f"they wrap by {2 * np.pi:.2f}"
    return found


def _points_along(mission: Mission, compass: Sensor, sources: tuple[Velocity, ...]) -> bool:
    """Whether radians fit the course between fixes, and headings as they read do not."""
    if compass is not mission.first("heading"):
        return False
    read = compass_series(mission)
    meant = compass_series(mission.with_sensor(taken_for_radians(compass)))
    ways = baselines(mission, read)
    if ways is None or read is None or meant is None:
        return False
    for velocity in sources:
        covered = ways.covered(velocity)
        if np.sum(covered) > 1:
            errors = [
                ways.direction_errors(np.unwrap(s.heading), velocity)[covered]
                for s in (read, meant)
            ]
            return best(losses(np.array(errors))) == 1
    return False


def _wraps(series: HeadingSeries) -> bool:
    """Whether every large step is one of a full turn, and there are several."""
    steps = np.abs(np.diff(series.heading))
    large = steps[steps > LARGE_STEP * FULL_TURN_READ_AS_DEG]
    return len(large) >= FEWEST_WRAPS and bool(np.all(large > NEAR_FULL * FULL_TURN_READ_AS_DEG))


def taken_for_radians(compass: Sensor) -> Sensor:
    """The compass as it is meant, where its headings in radians were read as degrees."""
    series = compass.series
    assert isinstance(series, HeadingSeries)
    return replace(compass, series=replace(series, heading=np.degrees(series.heading)))
