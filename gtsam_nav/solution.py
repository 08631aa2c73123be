"""What every estimation method returns."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Literal, Protocol

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Rejection, Relations, Sensor, SonarKind
from gtsam_nav.series import IntArray
from gtsam_nav.trajectory import Trajectory


class Progress(Protocol):
    """Told how far a stage of the work has come, 0 to 1."""

    def __call__(self, stage: str, fraction: float) -> None: ...


def no_progress(stage: str, fraction: float) -> None:
    """The progress callback of those who do not listen."""


class StageClock:
    """Collects the wall time of named stages, in the order they first ran."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time spent inside to a stage."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin


def listed(solutions: Solution | Sequence[Solution]) -> Sequence[Solution]:
    """Solutions as a sequence, a single one too."""
    return [solutions] if isinstance(solutions, Solution) else solutions


@dataclass(frozen=True)
class LoopClosure:
    """One candidate match between two scans, whatever became of it.

    ``dx_m, dy_m, dyaw`` is the pose of scan b in scan a (forward, starboard, clockwise rad); NaN
    where the registration failed. ``score`` is the share of points that paired, NaN of a closure
    that the mission states; ``weight`` is what the robust kernel left of an accepted one in the
    final solution.
    """

    t_a: float
    t_b: float
    dx_m: float
    dy_m: float
    dyaw: float
    sigma_x_m: float
    sigma_y_m: float
    sigma_yaw: float
    score: float
    verdict: Literal["accepted", "rejected"]
    reason: str
    weight: float | None = None


@dataclass(frozen=True)
class SlowStates:
    """Biases and other slowly varying nuisance states with their standard deviations.

    ``columns`` maps a name with its unit (``gyro_z_rad_s``, ``heading_bias_rad``, ...) to values
    and sigmas, each of shape (n,).
    """

    t: Array
    columns: Mapping[str, tuple[Array, Array]]


OBSERVED_SHARE = 0.8
"""A timing error whose sigma stays above this share of what it was beforehand was not observed."""
SURPRISING_SIGMAS = 4.0
"""A timing error of so many of the sigmas that it had beforehand is spoken of."""


@dataclass(frozen=True)
class ClockOffset:
    """A constant timing error that was estimated.

    Attributes
    ----------
    sensor : str
    quantity : {"time_offset", "velocity_lag"}
        Of the stamps of all samples, or of how far a receiver's velocities lag behind them.
    offset_s : float
        What must be added to the sensor's ``time_offset_s`` (or ``velocity_lag_s``).
    sigma_s, prior_sigma_s : float
        Its standard deviation, and what that was before any measurement.
    """

    sensor: str
    quantity: str
    offset_s: float
    sigma_s: float
    prior_sigma_s: float

    @property
    def observed(self) -> bool:
        """Whether the measurements told anything of it."""
        return self.sigma_s < OBSERVED_SHARE * self.prior_sigma_s

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to say where they did not, or told something that was not to be expected."""
        what = f"the {self.quantity.replace('_', ' ')} of sensor '{self.sensor}'"
        if not self.observed:
            stays = f"its sigma stays {self.sigma_s:.3g} s"
            return (f"{what} cannot be told from this mission: {stays}",)
        if abs(self.offset_s) > SURPRISING_SIGMAS * self.prior_sigma_s:
            return (
                f"{what} was found to be off by {self.offset_s:+.3g} s (sigma {self.sigma_s:.2g}"
                f" s), against a stated sigma of {self.prior_sigma_s:.3g} s",
            )
        return ()


@dataclass(frozen=True)
class Innovations:
    """Normalised innovation squared of one sensor's updates.

    ``whitened``, shape (n, dof), holds the innovations themselves in units of their standard
    deviations, uncorrelated; None where a method keeps none.
    """

    t: Array
    nis: Array
    dof: int
    whitened: Array | None = None


@dataclass(frozen=True)
class RobustWeights:
    """What kernel and gate left of one sensor's measurements at the solution.

    Attributes
    ----------
    kernel : str
    t, residual, weight : ndarray, shape (n,)
        Time, residual in standard deviations, and the share of its information that counts: zero
        for what was rejected.
    """

    kernel: str
    t: Array
    residual: Array
    weight: Array


@dataclass(frozen=True)
class PoseGraphEdge:
    """A relative pose between two vertices: R, t of b in a, information in (rot, trans) order."""

    a: int
    b: int
    R_ab: Array
    p_a: Array
    information: Array


@dataclass(frozen=True)
class PoseGraph:
    """The keyframes and relative measurements of a graph solution, for export."""

    t: Array
    p_n: Array
    q_nb_wxyz: Array
    edges: tuple[PoseGraphEdge, ...]


@dataclass(frozen=True)
class SonarMap:
    """Echoes in local NED: positions (k, 3) m, times (k,) s and strengths (k,) 0..255."""

    points_n: Array
    t: Array
    strength: Array


@dataclass(frozen=True)
class SonarScans:
    """The n scans that a method registered, and where they stand in their sonar's series.

    Attributes
    ----------
    sensor : str
        The sonar in the mission.
    t : ndarray, shape (n,)
        Reference times, s: those of `LoopClosure`.
    first_beam, last_beam : ndarray of int, shape (n,)
        Scan k is of the samples ``first_beam[k] <= sample < last_beam[k]``.
    first : ndarray of int, shape (n + 1,)
        Scan k holds the points ``xy[first[k]:first[k + 1]]``.
    xy : ndarray, shape (k, 2)
        Deskewed points in the level vehicle frame (forward, starboard) at their scan's time, m.
    """

    sensor: str
    t: Array
    first_beam: IntArray
    last_beam: IntArray
    first: IntArray
    xy: Array

    def __len__(self) -> int:
        return len(self.t)

    def points(self, k: int) -> Array:
        """Points of scan k, shape (m, 2)."""
        return self.xy[self.first[k] : self.first[k + 1]]


@dataclass(frozen=True)
class LandmarkEstimates:
    """Landmarks in local NED: ids (k,), positions (k, 3) m, covariances (k, 3, 3) m^2.

    ``id`` is the sensor's own where it tells one, else the order of discovery. Landmarks of a
    planar estimate lie at the vehicle's depth; that axis of their covariance is zero.
    """

    id: IntArray
    p_n: Array
    cov_n: Array


@dataclass(frozen=True)
class Solution:
    """The result of one estimation method on one mission.

    Attributes
    ----------
    method : str
    trajectory : Trajectory
        At 10 Hz or better.
    georeferenced : bool
        Whether positions are absolute; else the frame's zero is merely the start, and errors
        without alignment mean nothing.
    online : Trajectory or None
        The causal estimate of each keyframe when it entered, where the method has one.
    reference : Sensor or None
        What the solution may be scored on: the mission's reference, or the fixes that the GNSS
        policy withheld.
    relations : Relations or None
        The mission's own, to be scored on too.
    rejections : tuple of Rejection
        Every measurement that was not used, the reader's included.
    robust_weights : mapping of str to RobustWeights
        By sensor, of those whose measurements stood under a kernel or a gate.
    warnings : tuple of str
        Degradations that the user must hear of.
    clock_offsets : tuple of ClockOffset
        Timing errors that the mission asked to estimate.
    stage_s : mapping
        Wall time of each stage.
    """

    method: str
    trajectory: Trajectory
    mission: Mission
    georeferenced: bool = True
    online: Trajectory | None = None
    reference: Sensor | None = None
    relations: Relations | None = None
    loops: tuple[LoopClosure, ...] = ()
    rejections: tuple[Rejection, ...] = ()
    warnings: tuple[str, ...] = ()
    slow_states: SlowStates | None = None
    clock_offsets: tuple[ClockOffset, ...] = ()
    innovations: Mapping[str, Innovations] = field(default_factory=dict)
    robust_weights: Mapping[str, RobustWeights] = field(default_factory=dict)
    pose_graph: PoseGraph | None = None
    sonar_map: SonarMap | None = None
    scans: SonarScans | None = None
    landmarks: LandmarkEstimates | None = None
    gnss_used: int = 0
    gnss_withheld: int = 0
    n_keyframes: int = 0
    stage_s: Mapping[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        start, stop = self.trajectory.t[[0, -1]].tolist()
        return (
            f"Solution('{self.method}' of '{self.mission.name}', {start:.1f} to {stop:.1f} s,"
            f" {len(self.trajectory)} poses, {len(self.loops)} loop candidates,"
            f" {len(self.rejections)} rejections, {len(self.warnings)} warnings)"
        )

    @property
    def sonar_kind(self) -> SonarKind | None:
        """Whether the sonar that was used is recorded or simulated."""
        return self.mission.sonar_kind
