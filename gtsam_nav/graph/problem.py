"""The estimation problem: keyframes, the states beside them, and what constrains them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.linalg import norm

from gtsam_nav.frames import Array, Origin, rotation_from_rpy
from gtsam_nav.graph import factors
from gtsam_nav.graph.coasting import CoastingStep
from gtsam_nav.graph.factors import B, X
from gtsam_nav.graph.keyframes import MIN_SPACING_S
from gtsam_nav.graph.preintegration import InertialStep
from gtsam_nav.graph.readings import Reading, StateAt, as_given
from gtsam_nav.graph.robust import GatedRobustness, Robustness
from gtsam_nav.graph.scan_matching import PlanarPose
from gtsam_nav.mission import Rejection
from gtsam_nav.preprocess.alignment import Alignment
from gtsam_nav.preprocess.motion import VehicleMotion
from gtsam_nav.preprocess.strapdown import gravity_at
from gtsam_nav.series import BoolArray, IntArray

RECEIVER_STRIDE = 10**7
"""Apart in the numbering of GNSS errors: more keyframes than any mission has."""


NO_KERNEL = Robustness(kernel="none")


@dataclass(frozen=True)
class SensorFactor:
    """A factor with Gaussian noise, the sensor it came from, and its kernel.

    ``index`` is the sensor's sample that it rests on, as in `Rejection`, if it is a single one.
    """

    sensor: str
    gaussian: Any
    robustness: Robustness = NO_KERNEL
    index: int | None = None

    @cached_property
    def factor(self) -> Any:
        """The factor under its kernel."""
        return factors.robust(self.gaussian, self.robustness)

    @property
    def at_first(self) -> Any:
        """The factor under the kernel that it has while the solution is still far."""
        first = self.robustness.at_first
        return self.factor if first is self.robustness else factors.robust(self.gaussian, first)

    def weight_at(self, values: Any) -> float:
        """What the kernel leaves of the factor's information."""
        return factors.weight(self.robustness, float(norm(self.gaussian.whitenedError(values))))


@dataclass(frozen=True)
class Displacement:
    """The measured displacement into keyframe k, and its factor."""

    k: int
    R_ab: Array
    p_a: Array
    entry: SensorFactor


@dataclass(frozen=True)
class ConstantError:
    """A constant that some factors' measurements are off in proportion to.

    Attributes
    ----------
    name : str
        With its unit, as for `SlowStates`.
    sigma : float
        Spread beforehand, about zero.
    effect : list of (SensorFactor, ndarray)
        Derivative of each one's residual, neither whitened nor weighted, shape (dim,).
    """

    name: str
    sigma: float
    effect: list[tuple[SensorFactor, Array]]


@dataclass(frozen=True)
class TimingEffect:
    """Timing errors that are estimated, and how they bend the problem's residuals.

    Attributes
    ----------
    names : tuple of str
    sigma_s : ndarray, shape (m,)
        Spread beforehand, about zero.
    corrected_s : ndarray, shape (m,)
        What the problem's measurements are corrected by already.
    effect : ndarray, shape (rows, m)
        Derivative of the whitened residuals, in the order of the solution's graph: the problem's
        factors, then the readings in use; what follows them knows no time.
    """

    names: tuple[str, ...]
    sigma_s: Array
    corrected_s: Array
    effect: Array


@dataclass
class Problem:
    """Factors and initial values of each keyframe.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Keyframe times.
    alignment : Alignment
        Of the start.
    motion : VehicleMotion
    uses_imu : bool
        Whether rotations come from preintegrated IMU readings or from the AHRS.
    has_compass : bool
        Whether a compass frame stands beside each keyframe.
    measures_velocity : bool
        Whether the motion between keyframes is a DVL's or odometry's; else the IMU carries all.
    by_ranges : bool
        Whether the first guess of the way is what ranges to surveyed beacons told.
    planar : bool
        Whether the vehicle stays upright and at its start's depth because nothing tells otherwise.
    depth_spread_m : float
        How deep below its start it may be all the same, where ranges alone tell; else zero.
    factors : list of lists
        ``factors[k]`` are those that keyframe k brings, but for its inertial step's; they refer to
        no later keyframe.
    readings : list of lists
        The same of the readings.
    variables : list of lists
        Keys and first values of the states that keyframe k brings, but for its own.
    hints : list
        Factors on the first keyframe for the causal pass alone.
    steps : list
        Inertial readings into each keyframe, or its momentum where they lack; None where neither
        carries it.
    origin : Origin or None
        Of the navigation frame.
    bias : gtsam.imuBias.ConstantBias or None
        First value of the IMU's bias.
    displacements : list of Displacement
        Those that the velocity sensor's constant errors act on.
    calibration_sigma : ndarray, shape (2,)
        Spread of these errors: scale, and misalignment about the vertical in rad.
    constants : list of ConstantError
        Others that are marginalised out of the trajectory.
    timing : TimingEffect or None
        Timing errors that are estimated beside the trajectory.
    compass : list of int
        Key of the compass frame of each keyframe; empty without a compass.
    is_pose_graph : bool
        Whether the edges that the mission states, loops among them, join all keyframes.
    exact : list of (SensorFactor, callable)
        Factors whose distance is what it should be near given states alone, as remade there.
    landmarks : dict of int to int
        Key of each landmark by its id.
    level_landmarks : set of int
        Ids of those whose depth no sighting tells.
    range_scales : dict of str to int
        Key of the range scale of each sensor that has one.
    rejections : list of Rejection
        What was left out before any estimate.
    warnings : list of str
    """

    t: Array
    alignment: Alignment
    motion: VehicleMotion
    uses_imu: bool
    has_compass: bool
    measures_velocity: bool = True
    by_ranges: bool = False
    planar: bool = False
    depth_spread_m: float = 0.0
    factors: list[list[SensorFactor]] = field(init=False)
    readings: list[list[Reading]] = field(init=False)
    variables: list[list[tuple[int, Callable[[StateAt], Any]]]] = field(init=False)
    hints: list[Any] = field(default_factory=list)
    steps: list[InertialStep | CoastingStep | None] = field(init=False)
    origin: Origin | None = None
    bias: Any = None
    displacements: list[Displacement] = field(default_factory=list)
    calibration_sigma: Array = field(default_factory=lambda: np.zeros(2))
    constants: list[ConstantError] = field(default_factory=list)
    timing: TimingEffect | None = None
    compass: list[int] = field(default_factory=list)
    is_pose_graph: bool = False
    exact: list[tuple[SensorFactor, Callable[[StateAt], Any]]] = field(default_factory=list)
    landmarks: dict[int, int] = field(default_factory=dict)
    level_landmarks: set[int] = field(default_factory=set)
    range_scales: dict[str, int] = field(default_factory=dict)
    rejections: list[Rejection] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.factors = [[] for _ in self.t]
        self.readings = [[] for _ in self.t]
        self.variables = [[] for _ in self.t]
        self.steps = [None for _ in self.t]
        self._given: list[Any] = []
        self._give = as_given(self._given)
        self.p_n, self.rpy = self.motion.at(self.t)
        self.R_nb = rotation_from_rpy(self.rpy)
        columns = [np.interp(self.t, self.motion.t, axis) for axis in self.motion.v_b.T]
        self.v_b = np.stack(columns, axis=1)
        self.sigma_v = np.interp(self.t, self.motion.t, self.motion.sigma_v)

    @property
    def is_stiff(self) -> bool:
        """Whether the IMU ties neighbours so much tighter than anything ties them to the Earth that
        GTSAM's Cholesky, which compares pivots, finds the system indeterminate: then QR."""
        return self.uses_imu and not self.measures_velocity

    @property
    def entries(self) -> list[SensorFactor]:
        """All factors in the order of their keyframes."""
        every: list[SensorFactor] = []
        for k in range(len(self.t)):
            every += self.brought(k)
        return every

    @property
    def all_readings(self) -> list[Reading]:
        """All readings in the order of their keyframes."""
        return [reading for brought in self.readings for reading in brought]

    def brought(self, k: int) -> list[SensorFactor]:
        """The factors that keyframe k brings, its inertial readings preintegrated."""
        step = self.steps[k]
        return self.factors[k] + ([] if step is None else [SensorFactor("imu", step.factor)])

    def first_rows(self) -> tuple[dict[int, int], int]:
        """Row at which each of the `entries` begins, by its identity, and how many there are."""
        entries = self.entries
        ends = np.cumsum([0, *(entry.gaussian.dim() for entry in entries)]).tolist()
        return dict(zip(map(id, entries), ends, strict=False)), ends[-1]

    def add(
        self,
        k: int,
        sensor: str,
        factor: Any,
        robustness: Robustness = NO_KERNEL,
        index: int | None = None,
    ) -> SensorFactor:
        """Let keyframe k bring one more factor of Gaussian noise, to stand under a kernel."""
        entry = SensorFactor(sensor, factor, robustness, index)
        self.factors[k].append(entry)
        return entry

    def add_gated(
        self, k: int, sensor: str, index: int, factor: Any, robustness: GatedRobustness
    ) -> None:
        """The same, as a reading that may be left out where the kernel goes with a gate."""
        if robustness.gate_probability is None:
            self.add(k, sensor, factor, robustness, index)
            return
        t, reason, row = float(self.t[k]), f"{sensor} outlier", len(self._given)
        self._given.append(factor)
        self.readings[k].append(Reading(t, sensor, index, self._give, row, robustness, reason))

    def add_variable(self, k: int, key: int, value: Any) -> None:
        """Let keyframe k bring one more state, of a given first value."""
        self.variables[k].append((key, lambda _: value))

    def compass_at(self, k: int) -> int | None:
        """Key of the compass frame of keyframe k, if there is one."""
        return self.compass[k] if self.compass else None

    def spans(self, t: Array) -> BoolArray:
        """Which of given times lie within the keyframes', or at a start or stop that gave way to
        an anchor."""
        before, after = self.t[0] - MIN_SPACING_S, self.t[-1] + MIN_SPACING_S
        return np.asarray((t > before) & (t < after))

    def keyframe_nearest(self, t: Array) -> IntArray:
        """Indices of the keyframes nearest to given times."""
        return np.searchsorted(0.5 * (self.t[1:] + self.t[:-1]), t, side="right")

    def integrate_at(self, k: int, bias: Any) -> None:
        """Have the readings into keyframe k integrated at a bias, or near enough to it."""
        step = self.steps[k]
        if step is not None:
            self.steps[k] = step.at(bias)

    def integrate_all_at(self, values: Any) -> None:
        """The same of all keyframes at the biases of an estimate."""
        if self.uses_imu:
            for k in range(1, len(self.t)):
                self.integrate_at(k, values.atConstantBias(B(k - 1)))

    def set_gravity(self, k: int, before: Any) -> None:
        """Let the readings into keyframe k feel the gravity of where the one before it is."""
        step = self.steps[k]
        if step is not None:
            step.parameters.n_gravity = gravity_at(before.position(), self.origin)

    def set_all_gravity(self, values: Any) -> None:
        """The same of all keyframes where they are in an estimate."""
        steps = [step for step in self.steps if step is not None]
        if not steps:
            return
        p_n = np.array([values.atNavState(X(step.k - 1)).position() for step in steps])
        for step, gravity_n in zip(steps, gravity_at(p_n, self.origin), strict=True):
            step.parameters.n_gravity = gravity_n

    def initial_state(self, k: int) -> Any:
        """Keyframe k as the vehicle's own motion has it."""
        return factors.nav_state(self.R_nb[k], self.p_n[k], self.R_nb[k] @ self.v_b[k])

    def predicted(self, k: int, before: Any, bias: Any) -> Any:
        """Keyframe k from the state of the one before it: by the IMU where nothing measures the
        velocity, else by the vehicle's own motion."""
        step = self.steps[k]
        if step is not None and not self.measures_velocity:
            return step.predicted(before, bias)
        R_ab, p_a = self.increments
        return factors.moved(before, R_ab[k - 1], p_a[k - 1], self.v_b[k])

    @cached_property
    def increments(self) -> tuple[Array, Array]:
        """Rotation (n - 1, 3, 3) and displacement (n - 1, 3) of each keyframe but the first in the
        one before it, by the vehicle's own motion."""
        back = np.swapaxes(self.R_nb[:-1], 1, 2)
        return back @ self.R_nb[1:], (back @ np.diff(self.p_n, axis=0)[:, :, None])[:, :, 0]

    def planar_increment(self, a: int, b: int) -> PlanarPose:
        """Keyframe b in keyframe a by the vehicle's own motion, with its uncertainty."""
        c, s = np.cos(self.rpy[a, 2]), np.sin(self.rpy[a, 2])
        dt = self.t[b] - self.t[a]
        position = float(self.motion.displacement_variance(self.t[a], self.t[b]))
        yaw = self.motion.yaw_variance_rad2_s * dt
        ne = np.array([[c, s], [-s, c]]) @ (self.p_n[b] - self.p_n[a])[:2]
        return PlanarPose(
            ne, float(self.rpy[b, 2] - self.rpy[a, 2]), np.diag([position, position, yaw])
        )
