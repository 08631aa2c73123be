"""Joint refinement: all echoes registered at once, each at its own beam's time.

Between knots (keyframes at the middle of scans) the vehicle's own motion is corrected by a blend,
linear in time, of what the two knots make of it, so that a scan may bend. Walls give residuals
across themselves, all else in the plane between mutual nearest echoes; weights adapt to the
residuals found. If N scans saw one spot, the N (N - 1) / 2 differences among them carry what N - 1
independent ones would: each echo's residuals are weighed by 1 / N. Neighbouring echoes of a scan
err together; how far is measured on the residuals, and lessens their weight too.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.knot_system import JointPosterior, KnotSystem
from gtsam_nav.graph.problem import Problem
from gtsam_nav.graph.scan_pairs import PlacedEchoes, ScanPairs, nearby_scans
from gtsam_nav.graph.sensor_posterior import SensorPosterior, sensor_posterior
from gtsam_nav.graph.settings import RefinementSettings
from gtsam_nav.series import BoolArray, IntArray
from gtsam_nav.solution import Progress
from gtsam_nav.sonar.echoes import Echoes
from gtsam_nav.sonar.scans import Turns

if TYPE_CHECKING:
    from gtsam_nav.graph._echo_kernel import ByX

log = logging.getLogger(__name__)

CHI2_MEDIAN_1_DOF, CHI2_MEDIAN_2_DOF = 0.4549, 1.3863
LEAST_SPREAD2 = 0.05
"""Residuals may be this much smaller in variance than the echoes' stated noise."""
MAX_LAG = 30
"""Echoes further apart in a scan than this many are taken to err independently."""
SHARED_ERROR_EVERY = 5
"""Iterations between two measurements of how far echoes err together."""
MOST_RESIDUALS = 2_000_000
"""So many residuals tell it; on more of them every second pair of scans is looked at, or third."""
MAX_STEPS = 25
"""Without a sonar; reweighed least squares under a kernel takes its time."""
CONVERGED_STEP = 1e-3
ALL_BUT_LINEAR = np.array([0.1, 0.1, np.radians(0.3)])
"""Ways of a knot (n, e, yaw) beyond which walls are found anew, and sensors linearised: what is
bent within is less than a millimetre."""
ARRIVING_M = 0.1
"""While a knot steps further, sensors and the choice of scans may be older ..."""
ON_THE_WAY = 10.0 * ALL_BUT_LINEAR
"""... by so much: what is bent within is centimetres."""
MAX_KNOT_SPACING_S = 20.0
"""Where scans are further apart, the keyframes between them are knots too."""


@dataclass(frozen=True)
class Knots:
    """Where echoes stand between keyframes.

    Attributes
    ----------
    keyframes : ndarray of int, shape (m,)
        Keyframes that echoes depend on, and scans' middles, in order: the knots.
    knot : ndarray of int, shape (k,)
        Index of the knot before each echo; the next knot is the one after it.
    fraction : ndarray, shape (k,)
        Of the interval between the two.
    """

    keyframes: IntArray
    knot: IntArray
    fraction: Array


def knots_of(
    t_echoes: Array, t_keyframes: Array, t_scans: Array, spacing_s: float = MAX_KNOT_SPACING_S
) -> Knots:
    """Choose the knots among the keyframes and place the echoes between them.

    Scans' middles are enough where no more than the spacing parts them; elsewhere every keyframe
    that echoes depend on is a knot.
    """
    chosen = np.isin(t_keyframes, t_scans)
    chosen[[0, -1]] = True
    t_chosen = t_keyframes[chosen]
    gap = np.diff(t_chosen)[np.clip(np.searchsorted(t_chosen, t_keyframes) - 1, 0, None)]
    candidates = np.flatnonzero(chosen | (gap > spacing_s))
    t_knots = t_keyframes[candidates]
    before = np.clip(np.searchsorted(t_knots, t_echoes, side="right") - 1, 0, len(t_knots) - 2)
    # a scan's place is asked for even where it holds no echo
    middles = np.searchsorted(t_knots, t_scans)
    used = np.unique(np.concatenate([before, before + 1, middles]))
    fraction = (t_echoes - t_knots[before]) / (t_knots[before + 1] - t_knots[before])
    return Knots(candidates[used], np.searchsorted(used, before), np.clip(fraction, 0.0, 1.0))


@dataclass(frozen=True)
class Refined:
    """Final values, and the Gaussian about them."""

    values: Any
    posterior: SensorPosterior | JointPosterior
    iterations: int
    converged: bool


class _Walls(NamedTuple):
    """Of each echo the normal of its wall (k, 2), whether it lies on one, and whether it may have
    partners."""

    normal: Array
    is_line: BoolArray
    eligible: BoolArray


def refine_without_sonar(graph: Any, values: Any, problem: Problem) -> Refined:
    """Gauss-Newton with the velocity's constant errors, which the batch solve leaves out.

    Where it does not settle, as about a yaw that nothing tells, the values are those that it would
    have moved least.
    """
    least, nearest = np.inf, None
    for count in range(1, MAX_STEPS + 1):
        posterior = sensor_posterior(graph, values, np.empty(0, dtype=np.int64), problem)
        largest = float(np.max(np.abs(posterior.step)))
        if largest <= CONVERGED_STEP:
            return Refined(posterior.moved(), posterior, count, converged=True)
        if nearest is None or largest < least:
            least, nearest = largest, Refined(values, posterior, count, converged=False)
        values = posterior.moved()
    assert nearest is not None
    return nearest


class JointRefinement:
    """Registers all echoes of a mission at once.

    Parameters
    ----------
    echoes : Echoes
    turns : Turns
    problem : Problem
        Whose keyframes and motion are refined.
    settings : RefinementSettings
    """

    def __init__(
        self,
        echoes: Echoes,
        turns: Turns,
        problem: Problem,
        settings: RefinementSettings,
    ) -> None:
        t_keyframes, motion = problem.t, problem.motion
        bounds = np.searchsorted(echoes.beam, np.append(turns.first, turns.last[-1:]))
        inside = slice(bounds[0], bounds[-1])
        self.problem = problem
        self.settings = settings
        self.xy_b = echoes.xy_b[inside]
        self.cov_b = echoes.cov_b[inside]
        self.t = echoes.t[inside]
        self.scan_first = bounds - bounds[0]
        self.scan = np.repeat(np.arange(len(turns)), np.diff(bounds))
        # without a gyro the compass's disturbance strays within a scan: every keyframe corrects it
        spacing_s = MAX_KNOT_SPACING_S if motion.compass_sigma is None else 0.0
        self.knots = knots_of(self.t, t_keyframes, turns.t_ref, spacing_s)
        p_n, rpy = motion.at(self.t)
        self._ne, self._yaw = p_n[:, :2], rpy[:, 2]
        p_n, rpy = motion.at(t_keyframes[self.knots.keyframes])
        self._knot_ne, self._knot_yaw = p_n[:, :2], rpy[:, 2]
        self._rounds, self._excess = 0, 1.0
        self._scan_knot = np.searchsorted(t_keyframes[self.knots.keyframes], turns.t_ref)

    def run(self, graph: Any, values: Any, progress: Progress) -> Refined:
        """Refine until the estimate stops changing.

        Parameters
        ----------
        graph : gtsam.NonlinearFactorGraph
            All factors but the scan matches, whose echoes are used here.
        values : gtsam.Values
            Start.
        """
        from gtsam_nav.graph._echo_kernel import sorted_by_x

        s = self.settings
        gate, count, settled = s.first_gate_m, 0, False
        posterior: JointPosterior | None = None
        system: KnotSystem | None = None
        walls: _Walls | None = None
        while not settled and count < s.max_iterations:
            posterior = None  # its fronts make room for pairs of echoes, and these for the next
            origin = self._planar_of(values)
            placed = self._place(origin)
            by_x = sorted_by_x(placed.xy, self.scan, self.scan_first)
            if system is None:
                # the sensors anew after a turn of the whole track: linear, it would stretch it
                pairs = self._nearby(origin)
                keyframes = self.knots.keyframes
                system = KnotSystem(graph, values, keyframes, self.problem, pairs.touching)
                before = np.zeros((len(keyframes), 3))
                walls = None
            if walls is None:
                walls, walls_at = self._walls(placed.xy, by_x), before
            A, gradient = self._normal_equations(origin, placed, by_x, pairs, walls, gate)
            del placed, by_x
            posterior = system.with_sonar(A, gradient, before)
            values = posterior.moved()
            is_linear = bool(np.all(np.abs(before) <= ALL_BUT_LINEAR))
            moved = np.max(np.abs(posterior.planar - before)[:, :2], axis=1)
            before = posterior.planar
            largest, knot = float(np.max(moved)), int(np.argmax(moved))
            log.debug("refinement: largest step %.3f m at knot %d", largest, knot)
            arriving = largest < max(ARRIVING_M, s.converged_m)
            settled = is_linear and largest < s.converged_m and gate <= s.last_gate_m
            if gate > s.last_gate_m:
                # once the knots arrive a wider one has little left to bring in
                gate = s.last_gate_m if arriving else max(gate * s.gate_factor, s.last_gate_m)
                if gate == s.last_gate_m:
                    self._rounds = 0
            count += 1
            if np.any(np.abs(before) > (ALL_BUT_LINEAR if arriving else ON_THE_WAY)):
                system = None
            if np.any(np.abs(before - walls_at) > ALL_BUT_LINEAR):
                walls = None
            progress("refinement", count / s.max_iterations)
        progress("refinement", 1.0)
        log.info("joint refinement: %d iterations, converged: %s", count, settled)
        assert posterior is not None  # nobody calls this for no iteration
        return Refined(values, posterior, count, settled)

    def _nearby(self, knots: Array) -> ScanPairs:
        """Scans to be compared, by the knots' poses."""
        s = self.settings
        near = nearby_scans(
            knots[self._scan_knot, :2],
            np.diff(self.scan_first),
            s.neighbour_radius_m,
            s.max_neighbours,
        )
        return ScanPairs(near, self.knots.knot, self.scan_first, len(knots))

    def _walls(self, xy: Array, by_x: ByX) -> _Walls:
        """What surrounds the echoes where they lie, (k, 2)."""
        from gtsam_nav.graph._echo_kernel import fixed_points, grid, local_lines

        s = self.settings
        normal, is_line = local_lines(by_x, s.line_radius_m, s.line_thickness_m)
        fixes = fixed_points(xy, grid(xy, s.point_radius_m), normal, is_line, s.point_radius_m)
        return _Walls(normal, is_line, is_line | fixes)

    def _planar_of(self, values: Any) -> Array:
        """North, east and yaw of the knots, yaw unwrapped beside the motion's; shape (m, 3)."""
        states = [values.atNavState(X(int(k))) for k in self.knots.keyframes]
        ne = np.array([s.position()[:2] for s in states])
        yaw = np.array([s.attitude().yaw() for s in states])
        beside = self._knot_yaw + wrap_angle(yaw - self._knot_yaw)
        return np.column_stack([ne, beside])

    def _normal_equations(
        self,
        knots: Array,
        placed: PlacedEchoes,
        by_x: ByX,
        pairs: ScanPairs,
        walls: _Walls,
        gate: float,
    ) -> tuple[Any, Array]:
        """Sonar's information on the knots, sparse (3m, 3m), and the gradient (3m,) there."""
        from gtsam_nav.graph._echo_equations import squared_residuals
        from gtsam_nav.graph._echo_kernel import partners

        xy, cov = placed.xy, placed.cov
        normal, is_line, eligible = walls
        i, j, first = partners(pairs.scans, by_x, gate, normal, is_line, eligible)
        i, j, first = self._keep_trusted_points(i, j, first, is_line)
        weight = self._weights(i, squared_residuals(i, j, xy, cov, normal, is_line), is_line)
        if self._rounds % SHARED_ERROR_EVERY == 0:
            vehicle = knots[self._scan_knot, :2]
            self._excess = self._shared_error(i, j, xy, vehicle, normal, is_line)
        self._rounds += 1
        weight /= self._excess
        return pairs.normal_equations(i, j, first, placed, normal, is_line, weight)

    def _place(self, knots: Array) -> PlacedEchoes:
        """Echoes in the navigation frame, by the knots' poses."""
        from gtsam_nav.graph._echo_kernel import carried_by_knots

        fraction = self.knots.fraction
        xy, arms, cov = carried_by_knots(
            knots[:, :2].copy(),
            knots[:, 2] - self._knot_yaw,
            self._knot_ne,
            self.knots.knot,
            fraction,
            self._ne,
            self._yaw,
            self.xy_b,
            self.cov_b,
        )
        return PlacedEchoes(xy, arms, cov, fraction)

    def _keep_trusted_points(
        self, i: IntArray, j: IntArray, first: IntArray, is_line: BoolArray
    ) -> tuple[IntArray, IntArray, IntArray]:
        """Off the walls only places that several scans saw count."""
        from gtsam_nav.graph._echo_kernel import kept

        seen = np.bincount(i, minlength=len(self.scan)) >= self.settings.min_sightings
        keep = is_line[i] | (seen[i] & seen[j])
        return i[keep], j[keep], kept(keep, first)

    def _weights(self, i: IntArray, d2: Array, is_line: BoolArray) -> Array:
        """Cauchy weights in units of the spread found, shared among an echo's many partners."""
        on_wall = is_line[i]
        across = _spread2(d2[on_wall], CHI2_MEDIAN_1_DOF)
        in_plane = _spread2(d2[~on_wall], CHI2_MEDIAN_2_DOF / 2)
        spread2 = np.where(on_wall, across, in_plane)
        visits = np.bincount(i, minlength=len(self.scan)) + 1
        return np.asarray(1.0 / ((spread2 + d2 / self.settings.cauchy_k**2) * visits[i]))

    def _shared_error(
        self, i: IntArray, j: IntArray, xy: Array, vehicle: Array, normal: Array, is_line: BoolArray
    ) -> float:
        """How far the echoes of a scan on one wall err together, rather than each on its own.

        Motion within the scan and the beam's shape displace neighbouring echoes alike; this many
        of them are worth one independent echo.
        """
        from gtsam_nav.graph._echo_equations import correlation_excess, outward_residuals

        walls = is_line[i]
        i, j = i[walls], j[walls]
        if len(i) == 0:
            return 1.0
        run = self.scan[i] * len(vehicle) + self.scan[j]
        every = -(-len(run) // MOST_RESIDUALS)
        if every > 1:
            some = run % every == 0
            i, j, run = i[some], j[some], run[some]
        residual = outward_residuals(i, j, xy, vehicle[self.scan], normal)
        clip = 3.0 * 1.4826 * float(np.median(np.abs(residual)))
        return float(correlation_excess(residual, normal, i, run, clip, MAX_LAG))


def _spread2(d2: Array, expected_median: float) -> float:
    """By how much squared residuals are larger than their stated noise makes them."""
    if len(d2) == 0:
        return 1.0
    return max(LEAST_SPREAD2, float(np.median(d2)) / expected_median)
