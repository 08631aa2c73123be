"""The head of a scanning sonar: step, sector, direction, and the sign of its angle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.motion import dead_reckoned_way
from gtsam_nav.frames import Array, rpy_from_rotation, wrap_angle
from gtsam_nav.mission import Sensor
from gtsam_nav.series import BeamSeries, HeadingSeries

TURNED_RAD = np.radians(15.0)
"""Turn of the vehicle between two sweeps that shows the handedness."""
FEWEST_TURNS = 3
RING_DOWN_M = 2.0
CELL_M = 2.0


@dataclass(frozen=True)
class SonarHead:
    """How the head moves.

    Attributes
    ----------
    step_deg : float
        Median step between beams.
    clockwise_share : float
        Share of the steps that go clockwise, seen from above.
    n_reversals : int
    sector_deg : float
        360 for full turns.
    beams_per_sweep : int
        Beams of a full turn, or of one crossing of the sector.
    n_sweeps : float
    silent_share : float
        Share of the beams without any echo.
    likeness, mirrored_likeness : float or None
        Mean correlation of the pictures that successive sweeps draw in the navigation frame, over
        the sweeps between which the vehicle turned; and with the head angle taken
        counter-clockwise. None where there are too few turns.
    """

    name: str
    step_deg: float
    clockwise_share: float
    n_reversals: int
    sector_deg: float
    beams_per_sweep: int
    n_sweeps: float
    silent_share: float
    likeness: float | None
    mirrored_likeness: float | None


def sonar_head(sonar: Sensor, heading: Sensor | None, velocity: Sensor | None) -> SonarHead | None:
    """Describe the head of a sonar; None where it never moved.

    With a compass, and better with a velocity too, the sweeps before and after a turn of the
    vehicle show whether the head angle has the right sign.
    """
    series = sonar.series
    assert isinstance(series, BeamSeries)
    steps = wrap_angle(np.diff(series.angle))
    moving = steps[np.abs(steps) > 1e-6]
    if not len(moving):
        return None
    step = float(np.median(np.abs(moving)))
    sector = _sector(series.angle, step)
    beams_per_sweep = max(round(sector / step), 1)
    likeness = (
        None
        if heading is None
        else _sweep_likeness(series, sonar.R_bs, heading, velocity, beams_per_sweep)
    )
    return SonarHead(
        name=sonar.name,
        step_deg=float(np.degrees(step)),
        clockwise_share=float(np.mean(moving > 0)),
        n_reversals=int(np.sum(np.diff(np.sign(moving)) != 0)),
        sector_deg=float(np.degrees(sector)),
        beams_per_sweep=beams_per_sweep,
        n_sweeps=len(series) / beams_per_sweep,
        silent_share=float(np.mean(~np.any(series.intensity, axis=1))),
        likeness=None if likeness is None else likeness[0],
        mirrored_likeness=None if likeness is None else likeness[1],
    )


def sonar_findings(name: str, head: SonarHead | None) -> Iterator[Finding]:
    """Judge the head's movement and the sign of its angle."""
    if head is None:
        yield Finding("sonar head", name, "warning", "the head angle never changes")
        return
    way = "full turns" if head.sector_deg == 360.0 else f"a sector of {head.sector_deg:.0f} deg"
    direction = "clockwise" if head.clockwise_share > 0.5 else "counter-clockwise"
    read = (
        f"{way} in steps of {head.step_deg:.2f} deg, {head.beams_per_sweep} beams a sweep, "
        f"{direction}, {head.n_reversals} reversals"
    )
    yield Finding("sonar head", name, "ok", read)
    if head.silent_share > 0.2:
        message = f"{head.silent_share:.0%} of the beams hold no echo at all"
        yield Finding("sonar echoes", name, "warning", message)
    if head.likeness is None or head.mirrored_likeness is None:
        return
    read = (
        f"sweeps before and after a turn agree by {head.likeness:.2f}, "
        f"mirrored by {head.mirrored_likeness:.2f}"
    )
    if head.mirrored_likeness > head.likeness + 0.05:
        message = f"{read}: the head angle seems to count counter-clockwise"
        yield Finding("sonar handedness", name, "warning", message)
    else:
        yield Finding("sonar handedness", name, "ok", read)


def _sector(angle: Array, step: float) -> float:
    """Arc that the head covers, rad: 2 pi unless a part of it is never looked at."""
    turned = np.sort(angle % (2 * np.pi))
    arcs = np.diff(turned, append=turned[0] + 2 * np.pi)
    blind = float(np.max(arcs))
    return 2 * np.pi if blind < 5 * step else 2 * np.pi - blind + step


def _sweep_likeness(
    series: BeamSeries,
    R_bs: Array,
    heading: Sensor,
    velocity: Sensor | None,
    beams_per_sweep: int,
) -> tuple[float, float] | None:
    """Mean correlation of successive sweeps over turns: as stated, and mirrored."""
    compass = heading.series
    assert isinstance(compass, HeadingSeries)
    n_sweeps = len(series) // beams_per_sweep
    yaw = np.interp(series.t, compass.t, np.unwrap(compass.heading))
    middle = np.arange(n_sweeps) * beams_per_sweep + beams_per_sweep // 2
    turned = np.flatnonzero(np.abs(wrap_angle(np.diff(yaw[middle]))) > TURNED_RAD)
    if len(turned) < FEWEST_TURNS:
        return None
    way_n = np.zeros((len(series), 2))
    if velocity is not None:
        way_n = dead_reckoned_way(series.t, yaw, velocity)
    mounting = float(rpy_from_rotation(R_bs)[2])
    range_m = _strongest_echo_m(series)
    likeness = []
    for sign in (1.0, -1.0):
        bearing = yaw + mounting + sign * series.angle
        points_n = way_n + range_m[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
        sweeps = points_n[: n_sweeps * beams_per_sweep].reshape(n_sweeps, beams_per_sweep, 2)
        pairs = [_correlation(sweeps[k], sweeps[k + 1]) for k in turned]
        likeness.append(float(np.mean(pairs)))
    return likeness[0], likeness[1]


def _strongest_echo_m(series: BeamSeries) -> Array:
    """Range of each beam's strongest bin, beyond the ring-down of the head."""
    blind = min(int(RING_DOWN_M / series.resolution_m), series.intensity.shape[1] - 1)
    bin_index = blind + np.argmax(series.intensity[:, blind:], axis=1)
    return np.asarray((bin_index + 0.5) * series.resolution_m)


def _correlation(one_n: Array, other_n: Array) -> float:
    """Of the pictures that two sets of points (k, 2) draw on the same cells."""
    both = np.concatenate([one_n, other_n])
    low, high = both.min(axis=0) - CELL_M, both.max(axis=0) + CELL_M
    edges = [np.arange(a, b + CELL_M, CELL_M) for a, b in zip(low, high, strict=True)]
    one, other = (np.histogramdd(points, edges)[0].ravel() for points in (one_n, other_n))
    return float(np.corrcoef(one, other)[0, 1])
