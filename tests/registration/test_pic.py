"""pIC: the compiled loop against the readable one, recovery, covariance and honest failure."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.registration._pic_information import information
from gtsam_nav.registration._pic_kernel import _decay, _strips, _window
from gtsam_nav.registration.pic import (
    Pairing,
    associate,
    information_at,
    normal_equations,
    register,
    register_readable,
)
from gtsam_nav.registration.settings import PicSettings
from gtsam_nav.sonar.scans import Scan, planar_rotations

SIGMA_M = 0.1
PRIOR_COV = np.diag([0.5**2, 0.5**2, np.radians(5) ** 2])
NO_FLOOR = PicSettings(floor_xy_m=0.0, floor_yaw_deg=0.0)


def corner(n: int = 60) -> Array:
    """Two walls at a right angle, 15 m and 12 m long, seen from within."""
    a = np.column_stack([np.linspace(-7, 8, n), np.full(n, 6.0)])
    b = np.column_stack([np.full(n, 8.0), np.linspace(-6, 6, n)])
    return np.concatenate([a, b])


def corridor(n: int = 80) -> Array:
    """Two parallel walls along x that leave the sonar's range."""
    x = np.linspace(-30, 30, n)
    return np.concatenate([np.column_stack([x, np.full(n, 5.0)]), np.column_stack([x, x * 0 - 5])])


def scan_of(xy: Array, sigma_m: float = SIGMA_M) -> Scan:
    return Scan(0.0, np.array(xy), np.tile(sigma_m**2 * np.eye(2), (len(xy), 1, 1)))


def seen_from(xy: Array, q: Array) -> Array:
    """Points of the reference frame in the frame whose pose there is q."""
    return np.asarray((xy - q[:2]) @ planar_rotations(q[2]))


def random_pair(seed: int) -> tuple[Scan, Scan, Array]:
    """A jagged shore seen twice with noise, clutter and covariances of any direction."""
    rng = np.random.default_rng(seed)
    shore = np.cumsum(rng.normal(scale=[0.6, 0.4], size=(70, 2)), axis=0)
    q = np.array([*rng.normal(scale=0.7, size=2), rng.normal(scale=0.08)])
    scans = []
    for xy in (shore, seen_from(shore, q)):
        seen = xy[rng.uniform(size=len(xy)) < 0.9]
        seen = np.concatenate([seen, rng.uniform(-10, 10, size=(5, 2))])
        root = rng.normal(scale=0.1, size=(len(seen), 2, 2))
        cov = root @ np.swapaxes(root, 1, 2) + 0.05**2 * np.eye(2)
        scans.append(Scan(0.0, seen + rng.normal(scale=0.05, size=seen.shape), cov))
    return scans[0], scans[1], q


@pytest.mark.parametrize("association", ["mean", "nearest"])
@settings(max_examples=12)
@given(seed=st.integers(0, 10_000))
def test_compiled_loop_equals_readable_one(association: str, seed: int) -> None:
    reference, new, q = random_pair(seed)
    prior = q + np.random.default_rng(seed + 1).normal(size=3) * [0.4, 0.4, 0.05]
    pic = PicSettings.model_validate({"association": association})
    cov = PRIOR_COV + 0.2 * (np.sqrt(np.outer(*[np.diag(PRIOR_COV)] * 2)) - PRIOR_COV)
    compiled = register(reference, new, prior, cov, pic)
    readable = register_readable(reference, new, prior, cov, pic)
    assert compiled.failure == readable.failure
    assert compiled.iterations == readable.iterations
    assert compiled.overlap == pytest.approx(readable.overlap, abs=1e-12)
    np.testing.assert_allclose(compiled.q, readable.q, atol=1e-9)
    np.testing.assert_allclose(compiled.cov, readable.cov, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("association", ["mean", "nearest"])
@pytest.mark.parametrize("gate", [5.99, 20.0])
@pytest.mark.parametrize("n", [3, 15, 16, 17, 33])
def test_compiled_loop_equals_readable_one_at_any_number_of_points(
    association: str, gate: float, n: int
) -> None:
    """The compiled loop takes points in strips, and many at once."""
    reference, new, q = random_pair(n)
    few = Scan(0.0, reference.xy[:n], reference.cov[:n])
    # so few of the points never come to rest, and what differs grows with each iteration
    chosen = {"association": association, "gate": gate, "max_iterations": 10}
    pic = PicSettings.model_validate(chosen)
    compiled = register(few, new, q, PRIOR_COV, pic)
    readable = register_readable(few, new, q, PRIOR_COV, pic)
    assert compiled.failure == readable.failure
    assert compiled.iterations == readable.iterations
    assert compiled.overlap == readable.overlap
    np.testing.assert_allclose(compiled.q, readable.q, atol=1e-7)


@given(seed=st.integers(0, 10_000), n=st.integers(1, 60), spread=st.sampled_from([0.0, 1e-9, 30.0]))
def test_a_window_holds_all_points_within_reach(seed: int, n: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    ref = np.zeros((5, n))
    # rounded, so that points share an x
    ref[0] = np.sort(np.round(rng.normal(scale=spread, size=n), 1)) + 100.0
    first, width = _strips(ref[0])
    for x, reach in zip(rng.normal(100.0, 40.0, 20), rng.exponential(5.0, 20), strict=True):
        begin, end = _window(ref, first, width, x, reach)
        assert 0 <= begin <= end <= n
        within = np.flatnonzero(np.abs(ref[0] - x) <= reach)
        assert np.all((within >= begin) & (within < end))
    # where there is no place, nothing is read beyond the points
    begin, end = _window(ref, first, width, np.nan, 1.0)
    assert 0 <= begin <= end <= n


def test_the_decay_of_weights_is_exponential_and_never_grows() -> None:
    d2 = np.linspace(0.0, 10.0, 101)
    decay = np.array([_decay(each) for each in d2])
    np.testing.assert_allclose(decay, np.exp(-0.5 * d2), rtol=3e-10)
    far = [_decay(each) for each in (10.0, 1e2, 1e3, 1e5, 1e300, np.inf)]
    assert np.all(np.diff(far) <= 0.0)
    assert far[-1] == 0.0


def basin(rng: np.random.Generator) -> Array:
    """The walls of a basin with a pier in it, seen with noise and gaps."""
    corners = [(-12, 6), (-12, -8), (14, -8), (14, 10), (3, 10), (3, 4)]
    share = np.linspace(0.0, 1.0, 20)[:, None]
    walls = [a + share * (b - a) for a, b in itertools.pairwise(np.array(corners, float))]
    seen = np.concatenate(walls)[rng.uniform(size=100) < 0.5]
    return np.asarray(seen + rng.normal(scale=SIGMA_M, size=seen.shape))


def found_from_afar(seeds: Iterable[int]) -> int:
    """How many pairs are found from starts with errors of 4 m and 20 deg."""
    sigma = np.array([4.0, 4.0, np.radians(20.0)])
    found = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        q = np.array([*rng.normal(size=2), rng.normal(scale=0.1)])
        scans = scan_of(basin(rng)), scan_of(seen_from(basin(rng), q))
        prior = q + rng.normal(size=3) * sigma
        match = register(*scans, prior, np.diag(sigma**2), PicSettings())
        found += match.ok and bool(np.hypot(*(match.q - q)[:2]) < 0.3)
    return found


def test_a_gate_that_stays_wide_while_the_pose_moves_finds_what_one_that_closes_misses(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seeds = (13, 23, 27, 37, 44)
    assert found_from_afar(seeds) >= 4
    monkeypatch.setattr("gtsam_nav.registration.pic.GATE_IN_STEPS", 0.0)
    assert found_from_afar(seeds) <= 1


@pytest.mark.parametrize("association", ["mean", "nearest"])
@given(
    x=st.floats(-0.4, 0.4), y=st.floats(-0.4, 0.4), yaw_deg=st.floats(-4, 4), turn=st.floats(-3, 3)
)
def test_exact_pose_of_noise_free_points(
    association: str, x: float, y: float, yaw_deg: float, turn: float
) -> None:
    # scattered points: on an evenly sampled wall the partner of a point is not itself
    points = np.random.default_rng(5).uniform(-12, 12, size=(30, 2))
    q = np.array([1.0, -2.0, turn])
    prior = q + np.array([x, y, np.radians(yaw_deg)])
    pic = PicSettings.model_validate({"association": association})
    match = register(
        scan_of(points, 0.02), scan_of(seen_from(points, q), 0.02), prior, PRIOR_COV, pic
    )
    assert match.ok
    assert match.overlap == 1.0
    assert match.iterations < pic.max_iterations / 2
    np.testing.assert_allclose(match.q[:2], q[:2], atol=2e-3)
    assert abs(wrap_angle(match.q[2] - q[2])) < 2e-4


@pytest.mark.parametrize("function", [register, register_readable])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("which", [0, 1])
def test_points_that_are_not_finite_are_told(function: object, bad: float, which: int) -> None:
    assert callable(function)
    clouds = [corner(), corner()]
    clouds[which][7, 0] = bad
    match = function(*map(scan_of, clouds), np.zeros(3), PRIOR_COV, PicSettings())
    assert "not finite" in match.failure
    np.testing.assert_array_equal(match.cov, PRIOR_COV)


def test_points_that_are_certain_are_told() -> None:
    scans = [scan_of(corner()), scan_of(corner())]
    for scan in scans:
        scan.cov[7] = 0.0
    match = register(*scans, np.zeros(3), PRIOR_COV, PicSettings())
    assert "singular" in match.failure


@pytest.mark.parametrize("function", [register, register_readable])
def test_three_points_are_enough(function: object) -> None:
    assert callable(function)
    points, q = np.array([[8.0, 1.0], [-3.0, 7.0], [-5.0, -6.0]]), np.array([0.2, -0.1, 0.02])
    match = function(
        scan_of(points), scan_of(seen_from(points, q)), np.zeros(3), PRIOR_COV, NO_FLOOR
    )
    assert match.ok
    np.testing.assert_allclose(match.q, q, atol=1e-3)


def test_yaw_is_wrapped() -> None:
    points = np.random.default_rng(5).uniform(-12, 12, size=(30, 2))
    q = np.array([0.2, 0.1, np.pi - 0.01])
    prior = np.array([0.0, 0.0, -np.pi + 0.01])
    match = register(scan_of(points), scan_of(seen_from(points, q)), prior, PRIOR_COV, NO_FLOOR)
    assert match.ok
    assert -np.pi <= match.q[2] < np.pi
    assert abs(wrap_angle(match.q[2] - q[2])) < 1e-3


@pytest.mark.parametrize("function", [register, register_readable])
@pytest.mark.parametrize(
    ("reference", "new", "reason"),
    [
        (corner()[:2], corner(), "fewer than three points"),
        (corner(), np.empty((0, 2)), "fewer than three points"),
        (corner(), corner() + 500.0, "no compatible points"),
        (corner(), np.concatenate([corner(20), corner(60) - [40.0, 40.0]]), "overlap"),
        (corner()[:60], np.tile(corner()[20], (5, 1)), "singular"),
    ],
)
def test_failure_has_a_reason_and_is_no_identity(
    function: object, reference: Array, new: Array, reason: str
) -> None:
    assert callable(function)
    prior = np.array([0.3, -0.2, 0.05])
    match = function(scan_of(reference), scan_of(new), prior, PRIOR_COV, PicSettings())
    assert not match.ok
    assert reason in match.failure
    assert np.all(np.isfinite(match.q))
    assert np.any(match.q != 0.0)


def test_walls_at_a_single_point_are_not_certain() -> None:
    """Without partners the prior's covariance stays: nothing was learnt."""
    prior = np.array([0.3, -0.2, 0.05])
    match = register(scan_of(corner()), scan_of(corner() + 500), prior, PRIOR_COV, PicSettings())
    np.testing.assert_array_equal(match.q, prior)
    np.testing.assert_array_equal(match.cov, PRIOR_COV)
    assert (match.overlap, match.iterations, match.unobserved.shape) == (0.0, 0, (0, 3))


def test_the_compiled_information_is_the_readable_one() -> None:
    """Of piles from round to long, in noise from small to large beside them."""
    rng = np.random.default_rng(8)
    q, pile = np.array([0.3, -0.2, 0.4]), np.empty((60, 5, 2))
    for k, (length, width) in enumerate(10.0 ** rng.uniform(-1.5, 0.2, size=(60, 2))):
        turn = planar_rotations(rng.uniform(-3.0, 3.0))
        pile[k] = 20.0 * np.array(divmod(k, 8)) + rng.normal(size=(5, 2)) * [length, width] @ turn.T

    def scan(xy: Array) -> Scan:
        root = 10.0 ** rng.uniform(-1.5, -0.3, size=(len(xy), 1, 1)) * rng.normal(
            size=(len(xy), 2, 2)
        )
        return Scan(0.0, xy, root @ np.swapaxes(root, 1, 2) + 1e-4 * np.eye(2))

    reference, new = scan(pile.reshape(-1, 2)), scan(seen_from(pile.mean(axis=1) + 0.05, q))
    for radius, cauchy_k in ((3.0, 1.5), (0.2, 3.0)):
        pic = PicSettings(wall_radius_m=radius, cauchy_k=cauchy_k)
        for k in range(60):
            one = Scan(0.0, new.xy[[k]], new.cov[[k]])
            compiled = information(
                *(reference.xy, reference.cov, one.xy, one.cov), q, radius, cauchy_k
            )
            for ours, theirs in zip(compiled, information_at(reference, one, q, pic), strict=True):
                np.testing.assert_allclose(
                    ours, theirs, rtol=1e-6, atol=1e-9 * np.abs(theirs).max()
                )


@pytest.mark.parametrize("seed", range(5))
def test_corridor_is_uncertain_along_itself(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scans = [scan_of(corridor(n) + rng.normal(scale=SIGMA_M, size=(2 * n, 2))) for n in (80, 90)]
    match = register(*scans, np.array([0.8, 0.2, 0.02]), PRIOR_COV, NO_FLOOR)
    assert match.ok
    along, across = np.sqrt(np.diag(match.cov)[:2])
    assert along > 10 * across
    assert abs(match.q[0]) < 4 * along
    assert abs(match.q[1]) < 0.1
    assert abs(match.q[2]) < np.radians(0.5)


@pytest.mark.parametrize("function", [register, register_readable])
@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_straight_walls_tell_nothing_along_themselves_and_all_the_rest(
    function: object, turn: float
) -> None:
    assert callable(function)
    along = np.array([np.cos(turn), np.sin(turn)])
    lines = [seen_from(corridor(n), np.array([0.0, 0.0, -turn])) for n in (60, 90)]
    prior = np.array([*(0.8 * along), 0.02])
    match = function(scan_of(lines[0]), scan_of(lines[1]), prior, PRIOR_COV, NO_FLOOR)
    assert match.ok
    assert match.unobserved.shape == (1, 3)
    np.testing.assert_allclose(np.abs(match.unobserved[0, :2] @ along), 1.0, atol=1e-6)
    to_way = np.array([along, [-along[1], along[0]]])
    sigma = np.sqrt(np.diag(to_way @ match.cov[:2, :2] @ to_way.T))
    assert sigma[0] > 50.0
    assert sigma[1] < 0.1
    assert np.sqrt(match.cov[2, 2]) < np.radians(1.0)
    # what is not told stays where the search began
    assert match.q[:2] @ along == pytest.approx(0.8, abs=0.5)
    assert abs(match.q[:2] @ to_way[1]) < 0.05


def test_echoes_far_along_a_wall_are_no_landmarks() -> None:
    """At grazing incidence they lie metres apart, and each stands alone in its surroundings."""
    rng = np.random.default_rng(3)
    near = np.linspace(-8.0, 8.0, 60)
    scans = []
    for _ in range(2):
        far = np.cumsum(rng.uniform(3.2, 5.0, 4)) + 8.0
        x = np.concatenate([near, far, -far])
        sides = [np.column_stack([x, np.full(len(x), y)]) for y in (-9.0, 11.0)]
        points = np.concatenate(sides)
        scans.append(scan_of(points + rng.normal(scale=SIGMA_M, size=points.shape)))
    match = register(*scans, np.array([0.3, 0.1, 0.01]), PRIOR_COV, NO_FLOOR)
    assert match.ok
    assert np.sqrt(match.cov[0, 0]) > 5.0
    assert np.sqrt(match.cov[1, 1]) < 0.5


def test_covariance_has_a_floor() -> None:
    many = corner(400)
    pic = PicSettings(floor_xy_m=0.2, floor_yaw_deg=1.0)
    match = register(scan_of(many, 0.01), scan_of(many, 0.01), np.zeros(3), PRIOR_COV, pic)
    assert match.ok
    sigma = np.sqrt(np.diag(match.cov))
    assert np.all(sigma >= [0.2, 0.2, np.radians(1.0)])
    assert np.all(sigma < [0.21, 0.21, np.radians(1.05)])
    bare = register(scan_of(many, 0.01), scan_of(many, 0.01), np.zeros(3), PRIOR_COV, NO_FLOOR)
    assert np.all(np.diag(bare.cov) > 0)
    assert np.all(np.diag(bare.cov) < np.diag(match.cov) / 100)


def quadratic_cost(new: Scan, q: Array, pairing: Pairing) -> float:
    placed = q[:2] + new.xy @ planar_rotations(q[2]).T
    e = (pairing.partner - placed)[pairing.paired]
    W = np.linalg.inv((pairing.cov_partner + pairing.cov_point)[pairing.paired])
    return float(0.5 * np.einsum("ni,nij,nj->", e, W, e))


def test_normal_equations_against_numerical_differentiation() -> None:
    reference, new, q = random_pair(11)
    q = q + np.array([0.1, -0.05, 0.02])
    pairing = associate(reference, new, q, PRIOR_COV, PicSettings())
    H, gradient = normal_equations(new, q, pairing, cauchy_k=1e9)
    step = 1e-5
    steps = step * np.eye(3)
    slope = [
        (quadratic_cost(new, q + d, pairing) - quadratic_cost(new, q - d, pairing)) / (2 * step)
        for d in steps
    ]
    np.testing.assert_allclose(gradient, -np.array(slope), rtol=1e-5, atol=1e-4)
    pairing_at_rest = Pairing(
        pairing.paired,
        q[:2] + new.xy @ planar_rotations(q[2]).T,
        pairing.cov_partner,
        pairing.cov_point,
    )
    curvature = np.array(
        [
            [
                (
                    quadratic_cost(new, q + a + b, pairing_at_rest)
                    - quadratic_cost(new, q + a - b, pairing_at_rest)
                    - quadratic_cost(new, q - a + b, pairing_at_rest)
                    + quadratic_cost(new, q - a - b, pairing_at_rest)
                )
                / (4 * step**2)
                for b in steps
            ]
            for a in steps
        ]
    )
    np.testing.assert_allclose(H, curvature, rtol=1e-3, atol=1e-3 * np.abs(H).max())


def test_cauchy_weight_lessens_far_pairs() -> None:
    reference, new, q = random_pair(12)
    pairing = associate(reference, new, q, PRIOR_COV, PicSettings())
    plain, _ = normal_equations(new, q, pairing, cauchy_k=1e9)
    robust, _ = normal_equations(new, q, pairing, cauchy_k=0.5)
    assert np.all(np.linalg.eigvalsh(plain - robust) > 0)


@pytest.mark.slow
def test_covariance_says_how_far_the_estimate_scatters() -> None:
    rng = np.random.default_rng(0)
    nees = []
    for _ in range(200):
        q = np.array([*rng.normal(scale=0.2, size=2), rng.normal(scale=0.03)])
        scans = [
            scan_of(xy + rng.normal(scale=SIGMA_M, size=xy.shape))
            for xy in (corner(), seen_from(corner(), q))
        ]
        match = register(*scans, np.zeros(3), PRIOR_COV, NO_FLOOR)
        assert match.ok
        e = match.q - q
        nees.append(e @ np.linalg.solve(match.cov, e))
    # 3 degrees of freedom; the pairing's own errors are not in the closed form
    assert 1.0 < np.mean(nees) < 9.0


@pytest.mark.slow
@pytest.mark.realdata
def test_acceptance_on_pairs_with_known_pose(stpere_folder: Path) -> None:
    from benchmarks.pairs import ACCEPTANCE_START, load_pairs, measure
    from gtsam_nav.config import Config

    pairs = load_pairs(stpere_folder, Config())
    assert len(pairs) == 130
    result = measure(pairs, ACCEPTANCE_START, Config(), seed=1)
    assert result.success >= 0.93
    assert result.median_m <= 0.20
    assert result.median_deg <= 0.3
    assert 1.0 < result.median_nees < 4.0
