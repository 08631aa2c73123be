"""A pre-flight audit: what ``gtsam-nav inspect`` finds before anything is estimated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.heading import (
    HeadingAgainstCourse,
    heading_against_course,
    heading_findings,
)
from gtsam_nav.audit.inertial import inertial_findings
from gtsam_nav.audit.motion import DvlLock, dvl_lock, initial_rest_s, lock_findings, velocity_sensor
from gtsam_nav.audit.place import place_findings
from gtsam_nav.audit.sonar import SonarHead, sonar_findings, sonar_head
from gtsam_nav.audit.timing import TIMING_CHECKS, SensorTiming, sensor_timing, timing_findings
from gtsam_nav.methods import runnable_methods
from gtsam_nav.mission import Mission


@dataclass(frozen=True)
class Audit:
    """What a mission holds and what is odd about it.

    Attributes
    ----------
    mission : str
    start_utc : float or None
        POSIX seconds of mission time zero.
    span_s : (float, float)
        First and last sample of any sensor but the reference.
    georeferenced : bool
        Whether the mission has an origin.
    sensors : tuple of SensorTiming
    headings : tuple of HeadingAgainstCourse
    dvls : tuple of DvlLock
    sonars : tuple of SonarHead
    rest_s : float or None
        How long the vehicle lies still at first; None where no sensor tells.
    methods : tuple of str
        Estimation methods that the mission's sensors suffice for.
    findings : tuple of Finding
        In the order of the checks.
    warnings : tuple of str
        The reader's.
    """

    mission: str
    start_utc: float | None
    span_s: tuple[float, float]
    georeferenced: bool
    sensors: tuple[SensorTiming, ...]
    headings: tuple[HeadingAgainstCourse, ...]
    dvls: tuple[DvlLock, ...]
    sonars: tuple[SonarHead, ...]
    rest_s: float | None
    methods: tuple[str, ...]
    findings: tuple[Finding, ...]
    warnings: tuple[str, ...]

    @property
    def alerts(self) -> tuple[str, ...]:
        """What is odd about the samples, a line each; gaps and drops are told elsewhere."""
        return tuple(
            f"{finding.sensor}: {finding.check}: {finding.message}"
            for finding in self.findings
            if finding.severity == "warning" and finding.check not in TIMING_CHECKS
        )

    def to_json(self) -> dict[str, Any]:
        """The audit as a document of plain values."""
        return asdict(self)


def audit(mission: Mission) -> Audit:
    """Look a mission over.

    Parameters
    ----------
    mission : Mission

    Returns
    -------
    Audit
        Never raises for what the data hold: oddities are findings.
    """
    compass = mission.first("heading")
    timings = tuple(sensor_timing(mission, s) for s in mission.sensors.values())
    courses = [heading_against_course(mission, s) for s in mission.of_type("heading")]
    headings = tuple(course for course in courses if course is not None)
    dvls = tuple(dvl_lock(s) for s in mission.of_type("dvl"))
    velocity = velocity_sensor(mission)
    heads = {s.name: sonar_head(s, compass, velocity) for s in mission.of_type("beams")}

    def findings() -> Iterator[Finding]:
        for timing in timings:
            yield from timing_findings(timing)
        for imu in mission.of_type("imu"):
            yield from inertial_findings(imu, compass)
        for gnss in mission.of_type("gnss"):
            yield from place_findings(mission, gnss)
        for heading in headings:
            yield from heading_findings(heading)
        for lock in dvls:
            yield from lock_findings(lock)
        for name, head in heads.items():
            yield from sonar_findings(name, head)

    return Audit(
        mission=mission.name,
        start_utc=mission.start_utc,
        span_s=mission.span_s,
        georeferenced=mission.origin is not None,
        sensors=timings,
        headings=headings,
        dvls=dvls,
        sonars=tuple(head for head in heads.values() if head is not None),
        rest_s=initial_rest_s(mission),
        methods=runnable_methods(mission),
        findings=tuple(findings()),
        warnings=mission.warnings,
    )


def with_alerts(mission: Mission) -> Mission:
    """The mission with the audit's alerts among its warnings."""
    return replace(mission, warnings=(*mission.warnings, *audit(mission).alerts))
