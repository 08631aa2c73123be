"""The joint refinement's compiled parts: derivatives, null space, and tiny cases by hand."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import pytest

from gtsam_nav.frames import Array
from gtsam_nav.graph._echo_equations import (
    correlation_excess,
    outward_residuals,
    squared_residuals,
)
from gtsam_nav.graph._echo_kernel import (
    MOST_AROUND,
    ByX,
    carried_by_knots,
    fixed_points,
    grid,
    kept,
    local_lines,
    partners,
    sorted_by_x,
)
from gtsam_nav.graph.scan_pairs import PlacedEchoes, ScanPairs
from gtsam_nav.series import BoolArray, IntArray
from gtsam_nav.sonar.scans import planar_rotations


@dataclass
class Case:
    """Two scans of five echoes between four knots, paired one to one."""

    arms_b: Array
    knots: Array
    knot: IntArray
    fraction: Array
    cov: Array
    normal: Array
    is_line: BoolArray
    i: IntArray
    j: IntArray
    weight: Array

    scan_first = np.array([0, 5, 10])

    def arms(self, knots: Array) -> Array:
        turns = knots[:, 2][np.stack([self.knot, self.knot + 1], axis=1)]
        return np.einsum("keij,kej->kei", planar_rotations(turns), self.arms_b)

    def xy(self, knots: Array) -> Array:
        arms, f = self.arms(knots), self.fraction[:, None]
        ends = [knots[self.knot + e, :2] + arms[:, e] for e in (0, 1)]
        return np.asarray((1 - f) * ends[0] + f * ends[1])

    def cost(self, step: Array) -> float:
        """Weighted squared residuals; each residual's direction turns with echo j."""
        knots = self.knots + step.reshape(-1, 3)
        e = (self.xy(knots)[self.i] - self.xy(knots)[self.j])[:, :, None]
        turn = step.reshape(-1, 3)[:, 2]
        f = self.fraction[self.j]
        turned = (1 - f) * turn[self.knot[self.j]] + f * turn[self.knot[self.j] + 1]
        e_j = np.swapaxes(planar_rotations(turned), 1, 2) @ e
        total = 0.0
        for m, (a, b) in enumerate(zip(self.i, self.j, strict=True)):
            S, d = self.cov[a] + self.cov[b], e_j[m, :, 0]
            if self.is_line[b]:
                n = self.normal[b]
                total += 0.5 * self.weight[m] * (n @ d) ** 2 / (n @ S @ n)
            else:
                total += 0.5 * self.weight[m] * d @ np.linalg.solve(S, d)
        return float(total)

    def system(self) -> tuple[Array, Array]:
        pairs = ScanPairs(np.array([[0, 1]]), self.knot, self.scan_first, len(self.knots))
        placed = PlacedEchoes(self.xy(self.knots), self.arms(self.knots), self.cov, self.fraction)
        first = np.array([0, len(self.i)])
        information, gradient = pairs.normal_equations(
            self.i, self.j, first, placed, self.normal, self.is_line, self.weight
        )
        return information.toarray(), gradient


APART = np.repeat([0, 2], 5)
ADJOINING = np.array([0, 0, 0, 1, 1, 1, 1, 2, 2, 2])


def case(seed: int, residual_m: float = 0.3, knot: IntArray = APART) -> Case:
    rng = np.random.default_rng(seed)
    knots = np.column_stack([3.0 * np.arange(4), rng.normal(size=4), rng.normal(size=4)])
    fraction = rng.uniform(size=10)
    place = rng.uniform(-10, 10, size=(10, 2))
    place[5:] = place[:5] + rng.normal(scale=residual_m, size=(5, 2))
    ends = knots[np.stack([knot, knot + 1], axis=1)]
    arms_n = place[:, None] - ends[:, :, :2]
    arms_b = np.einsum("keji,kej->kei", planar_rotations(ends[:, :, 2]), arms_n)
    root = rng.normal(scale=0.2, size=(10, 2, 2))
    direction = rng.uniform(0, 6, 10)
    return Case(
        arms_b=arms_b,
        knots=knots,
        knot=knot,
        fraction=fraction,
        cov=root @ np.swapaxes(root, 1, 2) + 0.01 * np.eye(2),
        normal=np.stack([np.cos(direction), np.sin(direction)], axis=1),
        is_line=np.tile([True, False, True, False, True], 2),
        i=np.arange(10),
        j=(np.arange(10) + 5) % 10,
        weight=rng.uniform(0.2, 1.0, 10),
    )


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("knot", [APART, ADJOINING])
def test_gradient_is_that_of_the_cost(seed: int, knot: IntArray) -> None:
    c = case(seed, knot=knot)
    _, g = c.system()
    h = 1e-6
    slope = [(c.cost(h * d) - c.cost(-h * d)) / (2 * h) for d in np.eye(12)]
    np.testing.assert_allclose(g, -np.array(slope), rtol=1e-4, atol=1e-4 * np.abs(g).max())


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("knot", [APART, ADJOINING])
def test_information_is_the_curvature_where_residuals_vanish(seed: int, knot: IntArray) -> None:
    c = case(seed, residual_m=0.0, knot=knot)
    A, g = c.system()
    np.testing.assert_allclose(g, 0.0, atol=1e-9)
    np.testing.assert_allclose(A, A.T)
    h = 1e-4
    d = h * np.eye(12)
    curvature = [
        [(c.cost(a + b) - c.cost(a - b) - c.cost(b - a) + c.cost(-a - b)) / (4 * h * h) for b in d]
        for a in d
    ]
    np.testing.assert_allclose(A, curvature, atol=1e-3 * np.abs(A).max())


@pytest.mark.parametrize("seed", range(4))
def test_moving_everything_together_costs_nothing(seed: int) -> None:
    """Also where residuals do not vanish: else the sonar would invent an absolute heading."""
    c = case(seed, residual_m=0.5)
    A, g = c.system()
    north = np.tile([1.0, 0.0, 0.0], 4)
    east = np.tile([0.0, 1.0, 0.0], 4)
    turn = np.column_stack([-c.knots[:, 1], c.knots[:, 0], np.ones(4)]).ravel()
    largest = np.linalg.eigvalsh(A)[-1]
    for direction in (north, east, turn):
        unit = direction / np.linalg.norm(direction)
        assert np.linalg.norm(A @ unit) < 1e-9 * largest
        assert abs(g @ unit) < 1e-9 * np.linalg.norm(g)
    assert np.trace(A) > 1.0


def test_echoes_are_carried_by_their_two_knots() -> None:
    rng = np.random.default_rng(0)
    knot, fraction = np.array([0, 0, 1, 2, 2]), np.array([0.0, 0.3, 1.0, 0.5, 0.9])
    knot_ne, turn, motion_knot_ne = (rng.normal(size=size) for size in ((4, 2), 4, (4, 2)))
    ne, yaw, xy_b = rng.normal(size=(5, 2)), rng.normal(size=5), rng.normal(size=(5, 2))
    root = rng.normal(size=(5, 2, 2))
    cov_b = root @ np.swapaxes(root, 1, 2)

    turns = np.stack([turn[knot], turn[knot + 1]], axis=1)
    share = np.stack([1.0 - fraction, fraction], axis=1)
    B = planar_rotations(yaw + np.sum(share * turns, axis=1))
    ends = np.stack([knot, knot + 1], axis=1)
    paths = planar_rotations(turns) @ (ne[:, None] - motion_knot_ne[ends])[..., None]
    from_vehicle = B @ xy_b[..., None]
    arms_wanted = (paths + from_vehicle[:, None])[..., 0]
    xy_wanted = np.sum(share[..., None] * (knot_ne[ends] + arms_wanted), axis=1)

    xy, arms, cov = carried_by_knots(
        knot_ne, turn, motion_knot_ne, knot, fraction, ne, yaw, xy_b, cov_b
    )
    np.testing.assert_allclose(xy, xy_wanted, atol=1e-12)
    np.testing.assert_allclose(arms, arms_wanted, atol=1e-12)
    np.testing.assert_allclose(cov, B @ cov_b @ np.swapaxes(B, 1, 2), atol=1e-12)


def one_scan(xy: Array) -> ByX:
    return sorted_by_x(xy, np.zeros(len(xy), dtype=int), np.array([0, len(xy)]))


def test_local_lines_find_the_wall_and_not_the_loner() -> None:
    wall = np.column_stack([np.linspace(0, 4, 9), 0.5 * np.linspace(0, 4, 9)])
    xy = np.concatenate([wall, [[1.0, 2.5]], [[30.0, 30.0]]])
    normal, is_line = local_lines(one_scan(xy), 3.0, 0.4)
    np.testing.assert_array_equal(is_line, [True] * 9 + [False, False])
    across = np.array([-1.0, 2.0]) / np.sqrt(5)
    np.testing.assert_allclose(np.abs(normal[:9] @ across), 1.0, atol=1e-6)


def test_local_lines_do_not_mix_scans() -> None:
    wall = np.column_stack([np.linspace(0, 4, 6), np.zeros(6)])
    by_x = sorted_by_x(wall, np.repeat([0, 1], 3), np.array([0, 3, 6]))
    _, is_line = local_lines(by_x, 10.0, 0.4)
    assert not np.any(is_line)


def paired(
    xy: Array, scan_first: list[int], is_line: BoolArray, normal: Array, gate: float = 1.0
) -> list[list[tuple[int, int]]]:
    """Pairs of each two of three scans: 0 and 1, 0 and 2, 1 and 2."""
    scan = np.repeat([0, 1, 2], np.diff(scan_first))
    i, j, first = partners(
        np.array([[0, 1], [0, 2], [1, 2]]),
        sorted_by_x(xy, scan, np.array(scan_first)),
        gate,
        normal,
        is_line,
        np.ones(len(xy), dtype=bool),
    )
    every = list(zip(i.tolist(), j.tolist(), strict=True))
    found = [every[a:b] for a, b in itertools.pairwise(first.tolist())]
    assert all(pairs == sorted(pairs) for pairs in found)  # runs of residuals rely on it
    return found


def test_partners_are_the_nearest_of_the_other_scan() -> None:
    xy = np.array([[0.0, 0.0], [0.5, 0.0], [0.2, 0.0], [9.0, 9.0], [0.1, 0.0]])
    points, walls = np.zeros(5, dtype=bool), np.ones(5, dtype=bool)
    along = np.tile([0.0, 1.0], (5, 1))
    mutual = [[(0, 2), (2, 0)], [(0, 4), (4, 0)], [(2, 4), (4, 2)]]
    assert paired(xy, [0, 1, 4, 5], points, along) == mutual
    # an echo on a wall takes its nearest even where that one prefers another
    one_sided = [[(0, 2), (1, 0), (2, 0)], [(0, 4), (4, 0)], [(1, 4), (2, 4), (4, 2)]]
    assert paired(xy, [0, 1, 4, 5], walls, along) == one_sided
    assert paired(xy, [0, 1, 4, 5], points, along, gate=0.1) == [[], [], []]


@pytest.mark.parametrize("seed", range(3))
def test_partners_are_those_of_an_exhaustive_search(seed: int) -> None:
    rng = np.random.default_rng(seed)
    xy, scan = rng.uniform(0, 8, (120, 2)), np.repeat([0, 1, 2], 40)
    is_line, direction = rng.uniform(size=120) < 0.6, rng.choice([0.0, 0.3, 1.5], 120)
    normal = np.column_stack([np.cos(direction), np.sin(direction)])
    distance = np.linalg.norm(xy[:, None] - xy, axis=2)
    likewise = (is_line[:, None] == is_line) & (~is_line | (np.abs(normal @ normal.T) >= 0.9))
    distance[(distance >= 1.5) | ~likewise] = np.inf
    wanted = []
    for a, b in ((0, 1), (0, 2), (1, 2)):
        between = np.where((scan == a)[:, None] & (scan == b), distance, np.inf)
        between = np.minimum(between, between.T)
        best = np.argmin(between, axis=1)
        has = np.isfinite(between.min(axis=1))
        wanted.append(
            [(i, int(best[i])) for i in np.flatnonzero(has) if is_line[i] or best[best[i]] == i]
        )
    assert paired(xy, [0, 40, 80, 120], is_line, normal, gate=1.5) == wanted
    assert sum(map(len, wanted)) > 100


def test_walls_pair_with_walls_of_like_direction_only() -> None:
    xy = np.zeros((4, 2)) + 1e-3 * np.arange(4)[:, None]
    is_line = np.array([True, True, True, False])
    normal = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, -1.0], [0.0, 0.0]])
    assert paired(xy, [0, 1, 4, 4], is_line, normal) == [[(0, 2), (2, 0)], [], []]


def test_groups_of_which_some_members_are_kept() -> None:
    keep = np.array([True, False, True, False, False, True])
    np.testing.assert_array_equal(kept(keep, np.array([0, 2, 2, 5, 6])), [0, 1, 1, 2, 3])


def surroundings() -> tuple[Array, BoolArray, Array]:
    """Two walls of nine echoes each, a stray, a corner, a pile of three, and one far from all."""
    wall = np.column_stack([np.linspace(-2, 2, 9), np.zeros(9)])
    other = np.column_stack([np.full(9, 2.0), np.linspace(0, 4, 9)])
    stray, corner = [[-1.0, 0.6]], [[1.8, 0.2]]
    pile = [[20.0, 20.0], [20.1, 20.0], [20.0, 20.1]]
    xy = np.concatenate([wall, other, stray, corner, pile, [[50.0, 0.0]]])
    is_line = np.arange(len(xy)) < 18
    normal = np.zeros((len(xy), 2))
    normal[:9], normal[9:18] = [0.0, 1.0], [1.0, 0.0]
    return xy, is_line, normal


def test_fixed_points_are_corners_and_scatterers() -> None:
    xy, is_line, normal = surroundings()
    found = fixed_points(xy, grid(xy, 1.5), normal, is_line, 1.5)
    assert not np.any(found[:18])  # echoes of walls
    assert not found[18]  # stray echo beside one wall
    assert found[19]  # corner
    assert np.all(found[20:23])  # scatterer
    assert not found[23]  # alone: nothing to compare with


def test_fixed_points_are_the_same_where_a_mission_comes_by_very_often() -> None:
    xy, is_line, normal = (np.repeat(part, 300, axis=0) for part in surroundings())
    kind = np.repeat(np.arange(24), 300)
    mixed = np.random.default_rng(0).permutation(len(xy))
    xy, is_line, normal, kind = xy[mixed], is_line[mixed], normal[mixed], kind[mixed]
    assert MOST_AROUND < 2000  # echoes beside the stray and the corner
    found = fixed_points(xy, grid(xy, 1.5), normal, is_line, 1.5)
    assert not np.any(found[kind <= 18])
    assert np.all(found[kind > 18])


def test_squared_residuals_of_walls_and_points() -> None:
    xy = np.array([[1.0, 2.0], [0.4, 1.5]])
    cov = np.array([[[0.04, 0.01], [0.01, 0.09]], [[0.02, 0.0], [0.0, 0.05]]])
    normal = np.array([[0.0, 1.0], [0.6, 0.8]])
    e, S, n = xy[0] - xy[1], cov[0] + cov[1], normal[1]
    i, j = np.array([0]), np.array([1])
    on_wall = squared_residuals(i, j, xy, cov, normal, np.array([True, True]))
    np.testing.assert_allclose(on_wall, (n @ e) ** 2 / (n @ S @ n))
    off_wall = squared_residuals(i, j, xy, cov, normal, np.array([False, False]))
    np.testing.assert_allclose(off_wall, 0.5 * e @ np.linalg.solve(S, e))


def test_residuals_grow_outwards_however_normals_point() -> None:
    """Two echoes a decimetre behind a wall at 5 m north, one before it."""
    xy = np.array([[5.0, 0.0], [5.1, 1.0], [4.9, 2.0], [5.0, 3.0]])
    vehicle, normal = np.zeros((4, 2)), np.array([[1.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [-1.0, 0.0]])
    i, j = np.array([1, 2, 1, 2]), np.array([0, 0, 3, 3])
    found = outward_residuals(i, j, xy, vehicle, normal)
    np.testing.assert_allclose(found, [0.1, -0.1, 0.1, -0.1])
    beyond = outward_residuals(i, j, xy, np.full((4, 2), 9.0), normal)
    np.testing.assert_allclose(beyond, -found)


def excess_by_definition(r: Array, normal: Array, run: IntArray, clip: float, lags: int) -> float:
    r = np.clip(r, -clip, clip)
    excess = 1.0
    for lag in range(1, lags + 1):
        along = np.abs(np.sum(normal[:-lag] * normal[lag:], axis=1)) > 0.95
        likewise = along & (run[:-lag] == run[lag:])
        excess += 2.0 * max(float(np.sum((r[:-lag] * r[lag:])[likewise]) / np.sum(r**2)), 0.0)
    return excess


def test_what_echoes_err_together_is_told_within_runs_along_one_wall() -> None:
    rng = np.random.default_rng(1)
    white = rng.normal(size=3000)
    r = np.convolve(white, np.ones(5), "same")
    run, echo = np.repeat(np.arange(100), 30), rng.permutation(3000)
    direction = rng.choice([0.0, 0.2, 1.5], 3000)
    normal = np.column_stack([np.cos(direction), np.sin(direction)])
    found = correlation_excess(r, normal, echo, run, 4.0, 10)
    assert found == pytest.approx(excess_by_definition(r, normal[echo], run, 4.0, 10))
    same_wall = np.tile([1.0, 0.0], (3000, 1))
    assert correlation_excess(r, same_wall, echo, run, np.inf, 10) == pytest.approx(5.0, abs=0.5)
    assert correlation_excess(white, same_wall, echo, run, np.inf, 3) == pytest.approx(1, abs=0.15)
    assert correlation_excess(np.zeros(3), same_wall, echo, run, 1.0, 2) == 1.0
