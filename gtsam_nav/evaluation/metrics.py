"""The scores of a solution, as they stand in metrics.json."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import TypeAdapter

from gtsam_nav.evaluation.alignment import ALIGNMENTS, Aligned, AlignmentName, align
from gtsam_nav.evaluation.consistency import Consistency, consistency, horizontal_nees
from gtsam_nav.evaluation.matching import Matched, match
from gtsam_nav.evaluation.relations import RelationScores, relation_scores
from gtsam_nav.evaluation.relative import relative_error
from gtsam_nav.evaluation.statistics import (
    AbsoluteErrors,
    ErrorStatistics,
    RelativeErrors,
    Se2Statistics,
    StartStatistics,
)
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission, Sensor, SonarKind
from gtsam_nav.series import ReferenceSeries
from gtsam_nav.solution import ClockOffset, Solution
from gtsam_nav.trajectory import MAX_GAP_S, Trajectory

LEAST_COVERAGE = 0.99
"""A run that covers less of its reference has failed."""

LEAST_ONLINE_COVERAGE = 0.5
"""A causal estimate that covers less of the reference is not scored."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class LoopCounts:
    """Candidate loop closures and what became of them."""

    proposed: int = 0
    accepted: int = 0
    rejected: int = 0


WHY_NONE = {
    "none": "the estimate is in a local frame, not in the reference's: fixes, or the mission's"
    " 'initial' position and heading, would tie it to that",
    "start": "the reference never leaves its first 30 m",
    "se2": "the reference has too few points apart",
    "se3": "the reference has too few points apart",
}
"""Why an error is not there although something is scored."""


@dataclass(frozen=True, kw_only=True)
class TrajectoryMetrics:
    """How well a trajectory agrees with a reference.

    Attributes
    ----------
    ate : AbsoluteErrors
        Horizontal (n, e).
    ate_3d : AbsoluteErrors or None
        With the vertical; None where the reference has no usable one.
    rpe : RelativeErrors
    drift_percent : float or None
        Horizontal error at the last scored sample, without alignment, over the distance that the
        reference travelled.
    heading_error_deg : ErrorStatistics or None
        Of the absolute heading error; None where the reference has no heading.
    nees : Consistency or None
        On (n, e), without alignment; None where the trajectory has no covariance.
    coverage : float or None
        Scored share of the reference's span (inside the window), 0 to 1.
    """

    ate: AbsoluteErrors = field(default_factory=AbsoluteErrors)
    ate_3d: AbsoluteErrors | None = None
    rpe: RelativeErrors = field(default_factory=RelativeErrors)
    drift_percent: float | None = None
    heading_error_deg: ErrorStatistics | None = None
    nees: Consistency | None = None
    coverage: float | None = None

    @property
    def failed(self) -> bool:
        """Whether the trajectory covers too little of its reference."""
        return self.coverage is not None and self.coverage < LEAST_COVERAGE

    def to_json(self) -> dict[str, Any]:
        """The document of metrics.json: null for what cannot be told, never NaN."""
        document: dict[str, Any] = TypeAdapter(type(self)).dump_python(self, by_alias=True)
        return document

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Self:
        """The inverse of `to_json`.

        Raises
        ------
        pydantic.ValidationError
            Where the document has another shape.
        """
        metrics: Self = TypeAdapter(cls).validate_python(document)
        return metrics

    def __str__(self) -> str:
        lines = self._lines()
        return "\n".join(lines) or "no score: nothing to score on (no reference, no withheld fix)"

    def _lines(self) -> list[str]:
        if self.coverage is None:
            return []
        if self.coverage == 0.0 and self.ate == AbsoluteErrors():
            return ["no score: the estimate covers nothing of the reference"]
        lines = []
        for name in ALIGNMENTS:
            e: ErrorStatistics | None = getattr(self.ate, name)
            figures = (
                f"-  ({WHY_NONE[name]})"
                if e is None
                else f"mean {e.mean:.2f}  rmse {e.rmse:.2f}  p95 {e.p95:.2f}  max {e.max:.2f} m"
            )
            lines.append(f"ate {name:<5}  {figures}")
        if self.nees is not None:
            lines.append(f"nees       {self.nees.mean:.2f} ({self.nees.dof} degrees of freedom)")
            if self.nees.doubt:
                lines[-1] += f": {self.nees.doubt}"
        if self.coverage is not None:
            lines.append(f"coverage   {self.coverage:.3f}")
        return lines


@dataclass(frozen=True, kw_only=True)
class Metrics(TrajectoryMetrics):
    """Everything that metrics.json says of a run.

    Attributes
    ----------
    ate_online : AbsoluteErrors or None
        Of the causal estimate, where the method has one and its keyframes are at most 5 s apart
        over at least half of the reference.
    relations : RelationScores or None
        Where the mission has surveyed relations.
    nis : mapping of str to Consistency
        Of the updates, by sensor.
    loops : LoopCounts
    rejected : mapping of str to int
        Measurements that were not used, by sensor.
    n_keyframes : int
    sonar : {"simulated", "recorded"} or None
    gnss_used, gnss_withheld : int
        Fixes that were measurements of the estimator, and fixes that it never saw.
    clock_offsets : tuple of ClockOffset
        Timing errors that were estimated.
    """

    ate_online: AbsoluteErrors | None = None
    relations: RelationScores | None = None
    nis: Mapping[str, Consistency]
    loops: LoopCounts
    rejected: Mapping[str, int]
    n_keyframes: int
    sonar: SonarKind | None
    gnss_used: int
    gnss_withheld: int
    clock_offsets: tuple[ClockOffset, ...] = ()

    def _lines(self) -> list[str]:
        scored = self.relations
        parts = {} if scored is None else {"near": scored.near, "loops": scored.loops}
        return [
            *super()._lines(),
            *(
                f"relations  {name}: median {e.median_m:.3f} m {e.median_deg:.2f} deg,"
                f" p95 {e.p95_m:.3f} m {e.p95_deg:.2f} deg ({e.n})"
                for name, e in parts.items()
                if e is not None
            ),
        ]


def evaluate(
    solution: Solution,
    reference: Sensor | Mission | None = None,
    window_s: tuple[float, float] | None = None,
) -> Metrics:
    """Score a solution.

    Parameters
    ----------
    solution : Solution
    reference : Sensor or Mission, optional
        Of type ``reference``, or a mission that carries one; None takes the solution's own: the
        mission's reference, or else the fixes that the GNSS policy withheld.
    window_s : (float, float), optional
        Half-open span of mission time that is scored.

    Returns
    -------
    Metrics
        Every score is None where there is nothing to score on.
    """
    if isinstance(reference, Mission):
        reference = reference.reference
    reference = reference or solution.reference
    scores, ate_online = TrajectoryMetrics(), None
    if reference is not None:
        series, lever_b = reference_series(reference), reference.xyz_b
        scores = evaluate_trajectory(
            solution.trajectory, series, lever_b, window_s, georeferenced=solution.georeferenced
        )
        ate_online = _online_errors(solution, series, lever_b, window_s)
    return Metrics(
        **{f.name: getattr(scores, f.name) for f in fields(scores)},
        ate_online=ate_online,
        relations=_relation_scores(solution),
        nis={
            sensor: found
            for sensor, innovations in sorted(solution.innovations.items())
            if (found := consistency(innovations.nis, innovations.dof)) is not None
        },
        loops=LoopCounts(
            proposed=len(solution.loops),
            accepted=sum(loop.verdict == "accepted" for loop in solution.loops),
            rejected=sum(loop.verdict == "rejected" for loop in solution.loops),
        ),
        rejected=dict(sorted(Counter(r.sensor for r in solution.rejections).items())),
        n_keyframes=solution.n_keyframes,
        sonar=solution.sonar_kind,
        gnss_used=solution.gnss_used,
        gnss_withheld=solution.gnss_withheld,
        clock_offsets=solution.clock_offsets,
    )


def _relation_scores(solution: Solution) -> RelationScores | None:
    """At the times at which the scans were taken, as far as the method knows these."""
    relations = solution.relations
    if relations is None:
        return None
    offset_s = sum(
        clock.offset_s
        for clock in solution.clock_offsets
        if clock.sensor == relations.sensor and clock.quantity == "time_offset"
    )
    return relation_scores(solution.trajectory, relations, offset_s)


def _online_errors(
    solution: Solution,
    reference: ReferenceSeries,
    lever_b: Array,
    window_s: tuple[float, float] | None,
) -> AbsoluteErrors | None:
    """Errors of the causal estimate; None where its keyframes lie too far apart to be scored."""
    matched = solution.online and match(solution.online, reference, lever_b, window_s)
    if not matched:
        return None
    if matched.coverage < LEAST_ONLINE_COVERAGE:
        logger.warning(
            "%s: the causal estimate is not scored: no more than %.0f %% of the reference lies "
            "between keyframes that are at most %g s apart",
            solution.method,
            100 * matched.coverage,
            MAX_GAP_S,
        )
        return None
    return _absolute_errors(matched, solution.georeferenced)[0]


def reference_series(sensor: Sensor) -> ReferenceSeries:
    """The series of a reference sensor.

    Raises
    ------
    ValueError
        For a sensor of another type.
    """
    if not isinstance(sensor.series, ReferenceSeries):
        raise ValueError(f"sensor '{sensor.name}' is of type {sensor.type}, not a reference")
    return sensor.series


def evaluate_trajectory(
    trajectory: Trajectory,
    reference: ReferenceSeries,
    lever_b: ArrayLike = (0.0, 0.0, 0.0),
    window_s: tuple[float, float] | None = None,
    *,
    georeferenced: bool = True,
) -> TrajectoryMetrics:
    """Score a trajectory against a reference.

    Parameters
    ----------
    trajectory : Trajectory
        Of the body's origin.
    reference : ReferenceSeries
    lever_b : array_like, shape (3,)
        The reference's antenna in body coordinates, m.
    window_s : (float, float), optional
        Half-open span of mission time that is scored.
    georeferenced : bool
        Whether estimate and reference share a frame. Where they do not, what takes no alignment
        (``ate.none``, drift, heading error, NEES) is None.
    """
    matched = match(trajectory, reference, lever_b, window_s)
    if matched is None:
        return TrajectoryMetrics()
    if not len(matched.t):
        return TrajectoryMetrics(coverage=matched.coverage)
    nees = horizontal_nees(matched) if georeferenced else None
    ate, ate_3d = _absolute_errors(matched, georeferenced, vertical=reference.vertical_usable)
    return TrajectoryMetrics(
        ate=ate,
        ate_3d=ate_3d,
        rpe=RelativeErrors(
            per_10_m=relative_error(matched, 10.0),
            per_50_m=relative_error(matched, 50.0),
            per_10_percent=relative_error(matched, None),
        ),
        drift_percent=_drift_percent(matched) if georeferenced else None,
        heading_error_deg=_heading_error_deg(matched) if georeferenced else None,
        nees=None if nees is None else consistency(nees, 2),
        coverage=matched.coverage,
    )


def _absolute_errors(
    matched: Matched, georeferenced: bool, vertical: bool = False
) -> tuple[AbsoluteErrors, AbsoluteErrors | None]:
    """In the horizontal and, with the vertical, in space; without alignment only in one frame."""
    horizontal, in_space = dict[str, Any](), dict[str, Any]()
    for name in ALIGNMENTS:
        aligned = align(matched, name)
        if aligned is not None and (georeferenced or name != "none"):
            horizontal[name] = _statistics(name, aligned, aligned.horizontal_m)
            if vertical:
                in_space[name] = _statistics(name, aligned, np.linalg.norm(aligned.error_n, axis=1))
        del aligned  # memory holds one alignment of a long mission
    return AbsoluteErrors(**horizontal), AbsoluteErrors(**in_space) if vertical else None


def _statistics(name: AlignmentName, aligned: Aligned, errors: Array) -> ErrorStatistics:
    if name == "start":
        return StartStatistics.of(errors, stretch_s=aligned.stretch_s)
    if name == "se2":
        return Se2Statistics.of(errors, determinant=float(np.linalg.det(aligned.R)))
    return ErrorStatistics.of(errors)


def _drift_percent(matched: Matched) -> float | None:
    distance = float(matched.travelled_m[-1])
    if distance == 0.0:
        return None
    last = (matched.estimate.p_n - matched.reference.p_n)[-1, :2]
    return 100.0 * float(np.hypot(*last)) / distance


def _heading_error_deg(matched: Matched) -> ErrorStatistics | None:
    if matched.reference.rpy is None:
        return None
    error = wrap_angle(matched.estimate_yaw - matched.reference.rpy[:, 2])
    return ErrorStatistics.of(np.degrees(np.abs(error)))
