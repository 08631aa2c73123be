"""The head of a scanning sonar: step, sector, direction."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gtsam_nav.audit.findings import Finding
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Sensor
from gtsam_nav.series import BeamSeries

COARSEST_STEP_DEG = 12.0
"""No head turns by more between two beams; the finest step of 0.225 deg, read as rad, is larger."""
LONGEST_RANGE_M = 2000.0
"""No sonar that scans sees further."""


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
    range_m : float
        Of the last bin.
    unit : {"rad", "degrees", "gradians"}
        Of the angles, as far as no head takes the steps that they would be in rad.
    """

    name: str
    step_deg: float
    clockwise_share: float
    n_reversals: int
    sector_deg: float
    beams_per_sweep: int
    n_sweeps: float
    silent_share: float
    range_m: float
    unit: str


def sonar_head(sonar: Sensor) -> SonarHead | None:
    """Describe the head of a sonar; None where it never moved."""
    series = sonar.series
    assert isinstance(series, BeamSeries)
    steps = wrap_angle(np.diff(series.angle))
    moving = steps[np.abs(steps) > 1e-6]
    if not len(moving):
        return None
    step = float(np.median(np.abs(moving)))
    sector = _sector(series.angle, step)
    beams_per_sweep = max(round(sector / step), 1)
    return SonarHead(
        name=sonar.name,
        step_deg=float(np.degrees(step)),
        clockwise_share=float(np.mean(moving > 0)),
        n_reversals=int(np.sum(np.diff(np.sign(moving)) != 0)),
        sector_deg=float(np.degrees(sector)),
        beams_per_sweep=beams_per_sweep,
        n_sweeps=len(series) / beams_per_sweep,
        silent_share=float(np.mean(~np.any(series.intensity, axis=1))),
        range_m=series.resolution_m * series.intensity.shape[1],
        unit=_unit(series.angle),
    )


def sonar_findings(name: str, head: SonarHead | None) -> Iterator[Finding]:
    """Judge the head's movement."""
    if head is None:
        yield Finding("sonar head", name, "warning", "the head angle never changes")
        return
    if head.unit != "rad":
        message = f"the angles are in {head.unit}, not in rad: no head turns by so much a beam"
        yield Finding("sonar angle unit", name, "warning", message)
        return
    way = "full turns" if head.sector_deg == 360.0 else f"a sector of {head.sector_deg:.0f} deg"
    direction = "clockwise" if head.clockwise_share > 0.5 else "counter-clockwise"
    read = (
        f"{way} in steps of {head.step_deg:.2f} deg, {head.beams_per_sweep} beams a sweep, "
        f"{direction}, {head.n_reversals} reversals, echoes to {head.range_m:g} m"
    )
    yield Finding("sonar head", name, "ok", read)
    if head.range_m > LONGEST_RANGE_M:
        message = f"its bins reach to {head.range_m:g} m: their resolution is not in m"
        yield Finding("sonar range", name, "warning", message)
    if head.silent_share > 0.2:
        message = f"{head.silent_share:.0%} of the beams hold no echo at all"
        yield Finding("sonar echoes", name, "warning", message)


def _unit(angle: Array) -> str:
    """What the angles are in, by their steps and by how far they reach."""
    if np.median(np.abs(np.diff(angle))) < np.radians(COARSEST_STEP_DEG):
        return "rad"
    return "degrees" if np.max(np.abs(angle)) <= 360.0 else "gradians"


def _sector(angle: Array, step: float) -> float:
    """Arc that the head covers, rad: 2 pi unless a part of it is never looked at."""
    turned = np.sort(angle % (2 * np.pi))
    arcs = np.diff(turned, append=turned[0] + 2 * np.pi)
    blind = float(np.max(arcs))
    return 2 * np.pi if blind < 5 * step else 2 * np.pi - blind + step
