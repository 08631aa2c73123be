"""How a match answers to misplaced echoes, against matches of scans whose echoes are misplaced."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.registration._pic_information import information, pulls
from gtsam_nav.registration.pic import register
from gtsam_nav.registration.response import response
from gtsam_nav.registration.settings import PicSettings
from gtsam_nav.sonar.scans import Scan, planar_rotations

SETTINGS = PicSettings(floor_xy_m=0.0, floor_yaw_deg=0.0)
Q = np.array([0.8, -0.5, 0.15])


def basin(side_m: float = 9.0, n: int = 60) -> Array:
    """Four walls about the vehicle."""
    along = np.linspace(-side_m, side_m, n)
    wall = np.column_stack([along, np.full(n, side_m)])
    return np.concatenate([wall @ planar_rotations(k * np.pi / 2) for k in range(4)])


def scan_of(xy: Array) -> Scan:
    return Scan(0.0, xy, np.tile(0.1**2 * np.eye(2), (len(xy), 1, 1)))


def rigid(xy: Array) -> Array:
    """Displacements (k, 2, 3) by a unit turn and by unit shifts."""
    turned = np.stack([-xy[:, 1], xy[:, 0]], axis=1)
    shifts = np.broadcast_to(np.eye(2), (len(xy), 2, 2))
    return np.concatenate([turned[..., None], shifts], axis=2)


def test_a_scan_that_is_moved_as_a_whole_moves_the_match() -> None:
    reference = scan_of(basin())
    new = scan_of((basin() - Q[:2]) @ planar_rotations(Q[2]))
    moved = rigid(reference.xy), rigid(new.xy)
    by_reference, by_new = response(reference, new, Q, *moved, SETTINGS)
    c, s = np.cos(Q[2]), np.sin(Q[2])
    # what a wall's lean takes off the information makes the answer a little larger
    np.testing.assert_allclose(
        by_reference, [[-Q[1], 1, 0], [Q[0], 0, 1], [1, 0, 0]], rtol=0.05, atol=0.02
    )
    np.testing.assert_allclose(by_new, [[0, -c, s], [0, -s, -c], [-1, 0, 0]], rtol=0.05, atol=0.02)


def test_a_bent_scan_moves_the_match_as_registration_finds() -> None:
    """Walls fore and aft come 0.1 m nearer on the starboard side: neither a turn nor a shift."""
    reference, xy = scan_of(basin()), basin()
    bend = np.zeros((len(xy), 2, 1))
    bend[:, 0, 0] = -np.sign(xy[:, 0]) * (np.abs(xy[:, 0]) > 8.9) * (xy[:, 1] > 0)
    bend[:, 1, 0] = 0.5 * (xy[:, 1] > 8.9)
    still = np.zeros((len(xy), 2, 1))
    size, cov = 0.1, np.diag([0.3**2, 0.3**2, 0.05**2])
    for by_new, scans in (
        (0, (scan_of(xy + size * bend[..., 0]), reference)),
        (1, (reference, scan_of(xy + size * bend[..., 0]))),
    ):
        match = register(*scans, np.zeros(3), cov, SETTINGS)
        assert match.ok
        moved = (bend, still) if by_new == 0 else (still, bend)
        stated = size * response(*scans, match.q, *moved, SETTINGS)[by_new][:, 0]
        np.testing.assert_allclose(match.q, stated, atol=0.006)
        assert np.abs(stated).max() > 0.01


def test_along_a_corridor_no_match_answers() -> None:
    walls = np.concatenate([basin()[:60], -basin()[:60]]) * [4.0, 1.0]
    scan, ahead = scan_of(walls), np.zeros((len(walls), 2, 1))
    ahead[:, 0] = 1.0
    for answer in response(scan, scan, np.zeros(3), ahead, ahead, SETTINGS):
        np.testing.assert_allclose(answer, 0.0, atol=1e-6)


def test_pulls_are_those_of_the_information() -> None:
    """Of echoes far from each other, whose neighbours are no wall: what a point tells is J' w W J,
    and the first two columns of J are those of the unit matrix."""
    rng = np.random.default_rng(3)
    turn = planar_rotations(Q[2])
    places = 20.0 * np.stack(np.meshgrid(np.arange(4), np.arange(3)), axis=-1).reshape(-1, 2)

    def noisy(xy: Array) -> Scan:
        root = rng.normal(0.0, 0.3, (len(xy), 2, 2))
        return Scan(0.0, xy, root @ root.mT + 0.01 * np.eye(2))

    reference = noisy(places)
    new = noisy((rng.permutation(places) + rng.normal(0.0, 0.1, places.shape) - Q[:2]) @ turn)
    moved_ref, moved_new = rng.normal(size=(12, 2, 5)), rng.normal(size=(12, 2, 4))
    limits = SETTINGS.wall_radius_m, SETTINGS.cauchy_k
    H, by_ref, by_new = pulls(
        *(reference.xy, reference.cov, new.xy, new.cov), Q, *limits, moved_ref, moved_new
    )
    alone = []
    for k in range(len(new)):
        told, _ = information(*(reference.xy, reference.cov, new.xy[[k]], new.cov[[k]]), Q, *limits)
        alone.append(told)
    partner = np.argmin(
        np.linalg.norm(reference.xy - (Q[:2] + new.xy @ turn.T)[:, None], axis=2), axis=1
    )
    np.testing.assert_allclose(H, np.sum(alone, axis=0))
    wanted = sum(told[:, :2] @ moved_ref[j] for told, j in zip(alone, partner, strict=True))
    np.testing.assert_allclose(by_ref, wanted)
    wanted = sum(-told[:, :2] @ turn @ moved_new[k] for k, told in enumerate(alone))
    np.testing.assert_allclose(by_new, wanted)


def test_walls_lend_pulls_and_information_alike() -> None:
    reference, new = scan_of(basin()), scan_of((basin() + 0.05 - Q[:2]) @ planar_rotations(Q[2]))
    scans = reference.xy, reference.cov, new.xy, new.cov
    limits, none = (SETTINGS.wall_radius_m, SETTINGS.cauchy_k), np.zeros((len(new), 2, 0))
    found, _, _ = pulls(*scans, Q, *limits, none, none)
    wanted, _ = information(*scans, Q, *limits)
    np.testing.assert_array_equal(found, wanted)


def test_no_displacement_has_no_answer() -> None:
    scan, none = scan_of(basin()), np.zeros((240, 2, 0))
    assert [a.shape for a in response(scan, scan, Q, none, none, SETTINGS)] == [(3, 0), (3, 0)]
