"""Every sensor against every other that sees the same motion: who is wrong where they differ."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from gtsam_nav.audit.agreement import Lag
from gtsam_nav.audit.antenna import AntennaFit, antenna_fit, lever_findings, steady_yaw
from gtsam_nav.audit.bearings import bearing_findings
from gtsam_nav.audit.clocks import ClockPair, clock_findings
from gtsam_nav.audit.compass_unit import compasses_in_radians, taken_for_radians
from gtsam_nav.audit.compasses import compass_findings
from gtsam_nav.audit.courses import (
    BOW,
    Baselines,
    Velocity,
    baselines,
    compass_series,
    velocity_sources,
)
from gtsam_nav.audit.currents import Current, current_findings, currents
from gtsam_nav.audit.directions import (
    TRACK,
    DirectionBlame,
    DirectionPair,
    direction_blame,
    direction_findings,
    direction_pairs,
)
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.heading import (
    HeadingAgainstCourse,
    heading_against_course,
    heading_findings,
    mirrored_fixes,
)
from gtsam_nav.audit.inertial import inertial_findings, z_is_up
from gtsam_nav.audit.lagged_products import Signal
from gtsam_nav.audit.ranges import range_findings
from gtsam_nav.audit.receiver import velocity_findings
from gtsam_nav.audit.repeats import frozen_findings
from gtsam_nav.audit.speeds import (
    SpeedPair,
    implausible_findings,
    speed_blame,
    speed_findings,
    speed_pairs,
    stated_scales,
)
from gtsam_nav.audit.tilt import TiltPair, tilt_findings, tilt_pairs
from gtsam_nav.audit.turns import (
    TurnPair,
    Turns,
    turn_findings,
    turn_pairs,
    turns_of,
    wrong_signs,
)
from gtsam_nav.audit.vertical import VerticalPair, reversed_heave, vertical_findings, vertical_pairs
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.noise import DvlNoise, HeadingNoise, OdometryNoise
from gtsam_nav.series import HeadingSeries

TIMED = ("imu", "dvl", "odometry", "heading", "depth", "gnss")
"""Types of sensor that see a motion which others see too."""


@dataclass(frozen=True)
class Comparisons:
    """What the sensors of a mission say of each other.

    Attributes
    ----------
    gnss : tuple of Finding
        What the receivers' velocities say of their fixes.
    turns, turn_pairs : what saw turns, and how each two agree
    radians : dict of str to str
        Compasses in radians, and what tells it.
    compass : HeadingSeries or None
        The first one, declination applied and radians put right.
    sources : tuple of Velocity
        The bow last.
    ways : Baselines or None
        None where all that tells the way by itself reads the water.
    drifts : tuple of Current
        Between fixes and velocities.
    directions : tuple of DirectionPair
    blame : DirectionBlame
    course : HeadingAgainstCourse or None
        Of the first compass, with the first velocity that is not to blame.
    wrong_sign : tuple of str
        Who turns the other way round.
    speeds : tuple of SpeedPair
    wrong_scale : tuple of str
        Who is too fast or too slow.
    vertical : tuple of VerticalPair
    tilts : tuple of TiltPair
    antennas : dict of str to AntennaFit
    """

    gnss: tuple[Finding, ...]
    turns: dict[str, Turns]
    turn_pairs: tuple[TurnPair, ...]
    radians: dict[str, str]
    compass: HeadingSeries | None
    sources: tuple[Velocity, ...]
    ways: Baselines | None
    drifts: tuple[Current, ...]
    directions: tuple[DirectionPair, ...]
    blame: DirectionBlame
    course: HeadingAgainstCourse | None
    wrong_sign: tuple[str, ...]
    speeds: tuple[SpeedPair, ...]
    wrong_scale: tuple[str, ...]
    vertical: tuple[VerticalPair, ...]
    tilts: tuple[TiltPair, ...]
    antennas: dict[str, AntennaFit]

    @property
    def mirrored_gnss(self) -> str | None:
        """The receiver whose fixes draw the reflection of the way, where compass and gyro agree."""
        course = self.course
        if course is None or course.convention.sign > 0 or course.heading in self.wrong_sign:
            return None
        return course.gnss if course.gnss in self.wrong_sign else None

    @property
    def velocity(self) -> Velocity | None:
        """The first sensor of velocities over ground."""
        return self.sources[0] if self.sources[0].name != BOW else None

    @property
    def unwitnessed(self) -> tuple[str, ...]:
        """Who alone tells the way, which fixes would, or the turns, which they or a gyro would."""
        velocity = self.velocity
        found = [velocity.name] if velocity is not None and self.ways is None else []
        compared = {name for pair in self.turn_pairs for name in pair.pair}
        compasses = [name for name, t in self.turns.items() if t.sensor.type == "heading"]
        if self.course is None and not compared.intersection(compasses):
            found += compasses[:1]
        return tuple(found)

    @property
    def yaw(self) -> Signal | None:
        """By the compass, or else by odometry, whose drift is slow."""
        if self.compass is not None and len(self.compass) > 1:
            return Signal(self.compass.t, np.unwrap(self.compass.heading))
        by_odometry = (t for t in self.turns.values() if t.sensor.type == "odometry")
        return next((t.signal for t in by_odometry), None)

    @property
    def suspects_motion(self) -> bool:
        """Whether the way or the turns by which a map is drawn are in doubt."""
        converted = self.course is not None and not self.course.convention.is_stated
        return converted or bool(
            self.wrong_sign or self.wrong_scale or self.blame.quarters or self.blame.offsets
        )


def compare(mission: Mission) -> Comparisons:
    """Compare whatever measures the same."""
    gnss = tuple(f for receiver in mission.of_type("gnss") for f in velocity_findings(receiver))
    distrusted = {f.sensor for f in gnss if f.severity == "warning"}
    turns = {name: t for name, t in turns_of(mission).items() if name not in distrusted}
    pairs = turn_pairs(turns)
    sources = velocity_sources(mission)
    radians = compasses_in_radians(mission, pairs, sources)
    compass = _compass_as_meant(mission, radians)
    ways = baselines(mission, compass)
    drifts = currents(sources, ways)
    if adrift := {drift.sensor for drift in drifts if drift.misleads}:
        sources = tuple(s for s in sources if s.name not in adrift)
        ways = None if sources[0].name == BOW else ways
    directions = direction_pairs(sources, ways, _stated_deg(mission))
    blame = direction_blame(directions)
    course = None if ways is None else _course(mission, ways, sources, blame)
    wrong_sign = _wrong_signs(pairs, course)
    as_stated = course is None or course.convention.is_stated
    speeds = speed_pairs(
        [s for s in sources if s.name not in blame.quarters],
        ways if as_stated else None,
        stated_scales(mission),
    )
    wrong_scale = speed_blame(speeds)
    antennas = {}
    if compass is not None and len(compass) > 1 and as_stated:
        yaw = steady_yaw(Signal(compass.t, np.unwrap(compass.heading)), _gyro(turns, pairs))
        trusted = [s for s in sources if s.name not in (*blame.quarters, *wrong_scale, BOW)]
        fits = {g.name: antenna_fit(g, yaw, trusted) for g in mission.of_type("gnss")}
        antennas = {name: fit for name, fit in fits.items() if fit is not None}
    return Comparisons(
        gnss=gnss,
        turns=turns,
        turn_pairs=pairs,
        radians=radians,
        compass=compass,
        sources=sources,
        ways=ways,
        drifts=drifts,
        directions=directions,
        blame=blame,
        course=course,
        wrong_sign=wrong_sign,
        speeds=speeds,
        wrong_scale=wrong_scale,
        vertical=vertical_pairs(mission),
        tilts=tilt_pairs(mission),
        antennas=antennas,
    )


def comparison_findings(mission: Mission, c: Comparisons) -> Iterator[Finding]:
    """Judge what was compared."""
    upside_down = False
    for imu in mission.of_type("imu"):
        compared = any(imu.name in p.pair for p in c.turn_pairs)
        yield from inertial_findings(imu, imu.name in c.wrong_sign if compared else None)
        upside_down |= z_is_up(imu)
    # velocities that contradict fixes which are mirrored themselves are sound
    yield from (f for f in c.gnss if f.sensor != c.mirrored_gnss)
    yield from turn_findings(c.turns, c.turn_pairs, c.wrong_sign, c.radians)
    yield from compass_findings(mission, c.radians)
    others = {name: t.signal for name, t in c.turns.items() if t.sensor.type != "heading"}
    for compass in mission.of_type("heading"):
        yield from frozen_findings(compass, others)
    yield from current_findings(mission, c.drifts)
    if c.course is not None:
        yield from _course_findings(mission, c.course, c)
    heave = reversed_heave(mission, c.vertical, upside_down)
    told_z = {name for p in c.vertical for name in p.pair}
    untold = {dvl.name for dvl in mission.of_type("dvl")} - told_z
    directions = list(direction_findings(c.sources, c.ways, c.directions, c.blame, heave, untold))
    yield from directions
    for dvl in mission.of_type("dvl"):
        yield from implausible_findings(mission, dvl)
    yield from speed_findings(mission, c.speeds, c.wrong_scale)
    told = {f.sensor for f in directions if f.check == "velocity axes"}
    yield from vertical_findings(mission, {n: r for n, r in heave.items() if n not in told})
    yield from tilt_findings(c.tilts)
    if not c.suspects_motion:
        yield from bearing_findings(mission)
        if c.velocity is not None:
            yield from range_findings(mission, c.velocity)
    for name, fit in c.antennas.items():
        yield from lever_findings(mission.sensors[name], fit)
    timed = [s.name for s in mission.sensors.values() if s.type in TIMED and len(s.series) > 1]
    yield from clock_findings(_clock_pairs(mission, c), timed if len(timed) > 1 else ())


def _course_findings(
    mission: Mission, course: HeadingAgainstCourse, c: Comparisons
) -> Iterator[Finding]:
    """On the compass, or on the fixes where it is these that are mirrored."""
    if c.mirrored_gnss is not None:
        yield mirrored_fixes(course)
        return
    mirrored = course.convention.sign < 0
    suspected = c.wrong_sign if mirrored else (*c.blame.quarters, *c.blame.offsets)
    known = (course.heading, TRACK, BOW)
    yield from heading_findings(
        course,
        _stated_deg(mission)[TRACK],
        [s for s in suspected if s not in known],
        is_magnetic=HeadingNoise.model_validate(mission.sensors[course.heading].noise).magnetic,
    )


def _course(
    mission: Mission, ways: Baselines, sources: tuple[Velocity, ...], blame: DirectionBlame
) -> HeadingAgainstCourse | None:
    compass = mission.first("heading")
    assert compass is not None
    trusted = [s for s in sources if s.name not in (*blame.quarters, *blame.offsets)]
    for velocity in (*trusted, *sources):
        course = heading_against_course(compass.name, ways, velocity)
        if course is not None:
            return course
    return None


def _wrong_signs(
    pairs: tuple[TurnPair, ...], course: HeadingAgainstCourse | None
) -> tuple[str, ...]:
    """With what the fixes say of the compass."""
    if course is None or not course.follows:
        return wrong_signs(pairs, (), ())
    pair = (course.gnss, course.heading)
    mirrored = course.convention.sign < 0
    return wrong_signs(pairs, [pair] * mirrored, [pair] * (not mirrored))


def _compass_as_meant(mission: Mission, radians: Collection[str]) -> HeadingSeries | None:
    """Headings of the first compass, those in radians put right."""
    sensor = mission.first("heading")
    if sensor is None or sensor.name not in radians:
        return compass_series(mission)
    return compass_series(mission.with_sensor(taken_for_radians(sensor)))


def _gyro(turns: dict[str, Turns], pairs: tuple[TurnPair, ...]) -> Signal | None:
    """Turns of a gyro that some other sensor confirms in unit and sign."""
    right = {name for p in pairs if p.unit == 1.0 and not p.opposed for name in p.pair}
    return next(
        (t.signal for name, t in turns.items() if t.sensor.type == "imu" and name in right), None
    )


def _stated_deg(mission: Mission) -> dict[str, float]:
    """Spread of each direction's constant error by the cards, deg."""
    stated = {BOW: 0.0, TRACK: 0.0}
    for sensor in (*mission.of_type("dvl"), *mission.of_type("odometry")):
        model = DvlNoise if sensor.type == "dvl" else OdometryNoise
        stated[sensor.name] = model.model_validate(sensor.noise).misalignment_sigma_deg
    compass = mission.first("heading")
    if compass is not None:
        stated[TRACK] = HeadingNoise.model_validate(compass.noise).bias_sigma_deg
    return stated


def _clock_pairs(mission: Mission, c: Comparisons) -> list[ClockPair]:
    """Whose stamps are compared, and with whom."""
    stated = {name: sensor.time_offset_sigma_s for name, sensor in mission.sensors.items()}

    def pair(y: str, x: str, by: str, lag: Lag) -> ClockPair:
        return ClockPair(y, x, by, lag, float(np.hypot(stated[y], stated[x])))

    return [
        *(pair(p.y, p.x, "turns", p.agreement.lag) for p in c.turn_pairs),
        *(pair(p.y, p.x, "heave", p.agreement.lag) for p in c.vertical),
        *(pair(name, fit.velocity, "the way", fit.lag) for name, fit in c.antennas.items()),
    ]
