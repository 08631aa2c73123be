"""What speaks against a solution, or is not known in it: said as warnings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gtsam_nav.graph.measurements.gnss import POSITION_OUTLIER
from gtsam_nav.graph.online import OnlinePass
from gtsam_nav.graph.output import keyframe_trajectory
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.scan_matching import ScanMatch
from gtsam_nav.graph.settling import Settled
from gtsam_nav.graph.weights import Weighed
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.unaided import said_of_drift
from gtsam_nav.sonar.echoes import Echoes
from gtsam_nav.trajectory import Trajectory

TELL_THE_WAY = ("gnss", "landmarks", "beams", "scans", "clouds")
"""Types of sensor, beside those of velocity, without which an IMU tells the way alone."""
LEAST_BELIEVED = 0.2
"""Where a smaller share of the fixes agrees, none of them tells where the vehicle is."""
FEWEST, CONTRADICTION = 20, 3.0
"""So many measurements whose median lies at so many standard deviations are not merely noisy."""
FEWEST_LOOPS = 8
"""Of so many that are refused it is not chance that none stood."""
UNMEASURED_M, UNMEASURED_RATIO = 1.0, 10.0
"""A depth that is less sure than this, and than so many times the place, was not measured."""


def fixes(problem: Problem, settled: Settled) -> tuple[int, int]:
    """Number of fixes with a position, and of those that were believed."""
    every, used = (
        len({(r.sensor, r.index) for r in some if r.reason == POSITION_OUTLIER})
        for some in (problem.all_readings, settled.used)
    )
    return every, used


def is_georeferenced(problem: Problem, settled: Settled, mission: Mission) -> bool:
    """Whether the start is known in the world, and the fixes that told it were believed."""
    every, believed = fixes(problem, settled)
    told = _enough(believed, every) or mission.initial.p_n is not None
    return problem.alignment.georeferenced and told


def _enough(believed: int, every: int) -> bool:
    """Whether the fixes that were believed are more than a chance agreement among outliers."""
    return believed >= LEAST_BELIEVED * every


def doubts(problem: Problem, settled: Settled, *, converged: bool) -> Iterator[str]:
    """What speaks against the solution."""
    every, believed = fixes(problem, settled)
    if not _enough(believed, every):
        yield (
            f"gnss: only {believed} of {every} fixes agree with each other: too few to tell which"
            " are right, so where they put the vehicle is arbitrary"
        )
    if not (converged and settled.settled):
        what = "batch solve" if converged else "refinement"
        yield f"the {what} stopped before it settled"


def missing_loops(wanted: bool, matches: Sequence[ScanMatch]) -> Iterator[str]:
    """Where false loop closures were asked for and none was drawn."""
    if wanted and not any(m.is_injected for m in matches):
        yield "no loop closures: there were none to put false ones among"


def refused_loops(matches: Sequence[ScanMatch]) -> Iterator[str]:
    """Where no loop closure of scans stood."""
    loops = [m for m in matches if m.is_loop]
    if len(loops) >= FEWEST_LOOPS and not any(m.accepted for m in loops):
        yield (
            f"none of {len(loops)} loop closures between scans was accepted, and the refinement"
            " rests on the same echoes: `inspect` tells a sonar that is mounted otherwise than"
            " stated; sonar.use=false leaves it out"
        )


def unaided(mission: Mission, problem: Problem, keyframes: Trajectory) -> Iterator[str]:
    """Where nothing but the IMU tells the way."""
    seen = any(mission.of_type(kind) for kind in TELL_THE_WAY)
    if not (problem.measures_velocity or seen or mission.edges is not None):
        yield said_of_drift(keyframes, float(keyframes.t[0]))


def unmeasured_height(keyframes: Trajectory) -> Iterator[str]:
    """Where the sensors hold the vehicle in place but leave its height to the accelerometers."""
    assert keyframes.cov_pose_n is not None
    variance = np.diagonal(keyframes.cov_pose_n, axis1=1, axis2=2)
    down, level = np.sqrt(variance[:, 2]), np.sqrt(np.max(variance[:, :2], axis=1))
    k = int(np.argmax(down))
    if down[k] > max(UNMEASURED_M, UNMEASURED_RATIO * float(np.max(level))):
        yield (
            f"nothing measures the height: its standard deviation grows to {down[k]:.0f} m at"
            f" {keyframes.t[k]:.1f} s; that of north and east stays below {np.max(level):.2g} m"
        )


def unsure_for_echoes(problem: Problem, online: OnlinePass, echoes: Echoes) -> tuple[str, ...]:
    """Why the echoes are not registered jointly: their map would be as vague as they see far."""
    if problem.measures_velocity or not len(echoes.xy_b):
        return ()
    t = problem.t[online.keyframes]
    filtered = keyframe_trajectory(t, online.states, online.covariances)
    assert filtered.sigma_p_n is not None
    level_m = float(np.max(filtered.sigma_p_n[:, :2]))
    sight_m = float(np.max(np.linalg.norm(echoes.xy_b, axis=1)))
    if level_m <= sight_m:
        return ()
    return (
        "the echoes are not registered jointly: nothing measures the velocity, and the place is"
        f" unsure by {level_m:.0f} m (1 sigma) where the sonar sees {sight_m:.0f} m far",
    )


def contradictions(rows: Sequence[Weighed]) -> Iterator[str]:
    """The sensors that most of the time say something else than the solution, all in one warning.

    Those come first whose outliers nothing keeps from pulling the others, and of these the worst.
    """
    kinds: dict[tuple[str, str], list[Weighed]] = {}
    for row in rows:
        kinds.setdefault((row.sensor, row.kind), []).append(row)
    members = []
    for (sensor, kind), own in kinds.items():
        rejected = sum(row.weight == 0.0 for row in own)
        median = float(np.median([row.residual for row in own]))
        if len(own) < FEWEST or not (2 * rejected > len(own) or median > CONTRADICTION):
            continue
        what = f"half of its residuals are above {median:.1f} standard deviations"
        if 2 * rejected > len(own):
            what = f"{rejected} of {len(own)} measurements were left out"
        several = sum(of == sensor for of, _ in kinds) > 1
        measured = f" {kind.removesuffix(' outlier')}" if several and kind else ""
        members.append((any(row.doubted for row in own), -median, sensor, f"{measured} ({what})"))
    members.sort()
    if not members:
        return
    named = ", ".join(f"'{sensor}'{what}" for _, _, sensor, what in members)
    others = "" if len({sensor for _, _, sensor, _ in members}) > 1 else " and the other sensors"
    said = f"{named}{others} contradict each other"
    bare = dict.fromkeys(f"'{sensor}'" for doubted, _, sensor, _ in members if not doubted)
    if bare:
        pulling = f"keeps outliers of {', '.join(bare)} from pulling the others"
        said += f"; neither a kernel nor a gate {pulling}"
    yield said
