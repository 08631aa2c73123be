"""A pre-flight audit: what ``gtsam-nav inspect`` finds before anything is estimated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

from gtsam_nav.audit.comparisons import Comparisons, compare, comparison_findings
from gtsam_nav.audit.exchanged import exchanged_findings
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.heading import HeadingAgainstCourse
from gtsam_nav.audit.motion import DvlLock, dvl_lock, initial_rest_s, lock_findings
from gtsam_nav.audit.place import place_findings
from gtsam_nav.audit.repeats import repeat_findings, stuck_findings
from gtsam_nav.audit.scan_map import moved_scans, scan_findings
from gtsam_nav.audit.sigmas import sigma_findings
from gtsam_nav.audit.sonar import SonarHead, sonar_findings, sonar_head
from gtsam_nav.audit.sonar_map import map_findings, map_likeness, sweeps_of
from gtsam_nav.audit.timing import (
    TIMING_CHECKS,
    SensorTiming,
    sensor_timing,
    span_findings,
    stamp_findings,
    timing_findings,
)
from gtsam_nav.methods import runnable_methods
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.pose_edges import EDGES
from gtsam_nav.preprocess.edge_loops import n_loops
from gtsam_nav.preprocess.receivers import with_best_receiver_first


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
    edges, loops : int
        Relative poses of a pose graph, and how many of them close loops.
    edges_left_out : int
        How many more of a graph in space were rejected. Those of a planar graph are drops of its
        odometry, and of a mission folder's own a warning tells.
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
    edges: int
    loops: int
    edges_left_out: int
    methods: tuple[str, ...]
    findings: tuple[Finding, ...]
    warnings: tuple[str, ...]

    @property
    def alerts(self) -> tuple[str, ...]:
        """What is odd about the samples, a line each; gaps and drops are told elsewhere."""
        return tuple(
            f"{finding.sensor}: {finding.check}: {finding.text}"
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
    timings = tuple(sensor_timing(mission, s) for s in mission.sensors.values())
    dvls = tuple(dvl_lock(s) for s in mission.of_type("dvl"))
    sonars = mission.of_type("beams")
    heads = {s.name: sonar_head(s) for s in sonars}
    places = [f for gnss in mission.of_type("gnss") for f in place_findings(mission, gnss)]
    stamps, stuck = tuple(stamp_findings(mission)), tuple(stuck_findings(mission))
    # at another time, in another part of the world or stuck it says nothing true of the others
    away = [str(f.sensor) for f in (*stamps, *stuck, *places) if f.severity == "warning"]
    together = mission.without(*away)
    exchanged = tuple(exchanged_findings(together))
    together = together.without(*(str(f.sensor) for f in exchanged))
    compared = compare(with_best_receiver_first(together))

    def findings() -> Iterator[Finding]:
        for timing in timings:
            yield from timing_findings(timing)
        yield from span_findings(mission)
        yield from stamps
        yield from stuck
        for sensor in mission.sensors.values():
            if sensor.type != "reference":
                yield from repeat_findings(sensor)
        yield from (*places, *exchanged)
        for receiver in mission.of_type("gnss"):
            yield from sigma_findings(receiver)
        for lock in dvls:
            yield from lock_findings(lock)
        yield from comparison_findings(together, compared)
        for sonar in sonars:
            yield from sonar_findings(sonar.name, heads[sonar.name])
            yield from _map_findings(sonar, heads[sonar.name], compared)
        for scanner in mission.of_type("scans"):
            yield from _scan_findings(scanner, compared)

    return Audit(
        mission=mission.name,
        start_utc=mission.start_utc,
        span_s=mission.span_s,
        georeferenced=mission.origin is not None,
        sensors=timings,
        headings=() if compared.course is None else (compared.course,),
        dvls=dvls,
        sonars=tuple(head for head in heads.values() if head is not None),
        rest_s=initial_rest_s(together),
        edges=0 if mission.edges is None else len(mission.edges),
        loops=n_loops(mission),
        edges_left_out=sum(r.sensor == EDGES for r in mission.rejections),
        methods=runnable_methods(mission),
        findings=tuple(findings()),
        warnings=mission.warnings,
    )


def _map_findings(
    sonar: Sensor, head: SonarHead | None, compared: Comparisons
) -> Iterator[Finding]:
    """The map's own consistency, where nothing else is wrong with what it is drawn by."""
    compass = compared.compass
    if head is None or head.unit != "rad" or compass is None or compared.suspects_motion:
        return
    velocity = compared.velocity
    sweeps = sweeps_of(sonar, compass, velocity, head.beams_per_sweep)
    if sweeps is not None:
        like = map_likeness(sweeps, knows_way=velocity is not None)
        yield from map_findings(sonar, like, compared.unwitnessed)


def _scan_findings(scanner: Sensor, compared: Comparisons) -> Iterator[Finding]:
    """The same of points."""
    yaw = compared.yaw
    if yaw is None or compared.suspects_motion:
        return
    scans = moved_scans(scanner, yaw, compared.velocity)
    if scans is not None:
        like = map_likeness(scans, scans.knows_way)
        yield from scan_findings(scanner, like, compared.unwitnessed)


def with_alerts(mission: Mission) -> Mission:
    """The mission with the audit's alerts among its warnings."""
    return replace(mission, warnings=(*mission.warnings, *audit(mission).alerts))
