"""Scans: where turns begin and end, and what deskewing does."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import Array
from gtsam_nav.mission import Sensor
from gtsam_nav.series import BeamSeries, ScanSeries
from gtsam_nav.sonar.echoes import Echoes, echoes_of_scans
from gtsam_nav.sonar.motion import PlanarMotion
from gtsam_nav.sonar.scans import (
    Turns,
    find_turns,
    form_scans,
    planar_rotations,
    thin_by_motion,
    thin_scans,
)

STEP = np.radians(1.8)
DT = 0.07


def beams_at(angle: Array, t: Array | None = None) -> Sensor:
    n = len(angle)
    series = BeamSeries(
        t=DT * np.arange(n) if t is None else t,
        angle=np.asarray(angle) % (2 * np.pi),
        intensity=np.zeros((n, 4), np.uint8),
    )
    return Sensor(name="sonar", type="beams", series=series)


def spans(turns: Turns) -> list[tuple[int, int]]:
    return list(zip(turns.first.tolist(), turns.last.tolist(), strict=True))


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("start", [0.0, 1.234])
def test_full_turns_have_200_beams(direction: int, start: float) -> None:
    sonar = beams_at(start + direction * STEP * np.arange(650))
    turns = find_turns(sonar, max_gap_s=3.0)
    assert spans(turns) == [(0, 200), (200, 400), (400, 600), (600, 650)]
    np.testing.assert_allclose(turns.t_ref, sonar.series.t[[100, 300, 500, 625]])


def test_a_lost_ping_does_not_shift_the_turns() -> None:
    kept = np.delete(np.arange(600), [50, 51, 320])
    turns = find_turns(beams_at(STEP * kept, DT * kept), max_gap_s=3.0)
    assert [kept[first] for first in turns.first] == [0, 200, 400]


@pytest.mark.parametrize("direction", [1, -1])
def test_a_gap_ends_a_scan(direction: int) -> None:
    t = DT * np.arange(300)
    t[120:] += 5.0
    sonar = beams_at(direction * STEP * np.arange(300), t)
    assert spans(find_turns(sonar, max_gap_s=3.0)) == [(0, 120), (120, 300)]
    assert spans(find_turns(sonar, max_gap_s=6.0))[0] == (0, 200)


def test_sector_sweeps_end_where_the_head_reverses() -> None:
    sweep = STEP * np.arange(40)
    angle = np.concatenate([sweep, sweep[-2::-1], sweep[1:]])
    turns = find_turns(beams_at(1.0 + angle), max_gap_s=3.0)
    assert len(turns) == 3
    assert turns.first[0] == 0
    assert turns.last[-1] == len(angle)
    for first, last in spans(turns):
        signs = np.sign(np.diff(angle[first:last]))
        assert np.all(signs == signs[0])


@pytest.mark.parametrize("sector_deg", [60.0, 120.0, 190.0, 300.0])
def test_a_head_that_flies_back_keeps_all_of_its_sweeps(sector_deg: float) -> None:
    sweep = np.radians(np.arange(0.0, sector_deg + 1.0, 2.0))
    n = len(sweep)
    turns = find_turns(beams_at(1.0 + np.tile(sweep, 3)), max_gap_s=3.0)
    assert spans(turns) == [(0, n), (n, 2 * n), (2 * n, 3 * n)]


def test_a_head_that_reverses_after_a_full_turn_makes_two_scans() -> None:
    turn = STEP * np.arange(200)
    turns = find_turns(beams_at(np.concatenate([turn, turn[::-1]])), max_gap_s=3.0)
    assert spans(turns) == [(0, 201), (201, 400)]


def test_fewer_than_three_beams_are_no_scan() -> None:
    t = np.array([0.0, 0.1, 20.0, 20.1, 20.2, 40.0])
    turns = find_turns(beams_at(STEP * np.arange(6), t), max_gap_s=3.0)
    assert spans(turns) == [(2, 5)]
    assert len(find_turns(beams_at(STEP * np.arange(1)), max_gap_s=3.0)) == 0


def test_frozen_head_makes_one_scan_without_end() -> None:
    turns = find_turns(beams_at(np.full(500, 0.4)), max_gap_s=3.0)
    assert spans(turns) == [(0, 500)]


def test_scans_extracted_elsewhere_stay_what_they_are() -> None:
    series = ScanSeries(
        t=np.array([1.0, 2.5, 3.0]), first=np.array([0, 2, 2, 3]), points_b=np.eye(3, 2)
    )
    sensor = Sensor(name="scans", type="scans", series=series)
    turns = find_turns(sensor, max_gap_s=0.1)
    np.testing.assert_array_equal(turns.t_ref, series.t)
    still = PlanarMotion(np.array([0.0, 9.0]), np.zeros((2, 2)), np.zeros(2), 0.01, 0.01)
    scans = form_scans(echoes_of_scans(sensor), turns, still)
    assert [len(scan) for scan in scans] == [2, 0, 1]
    np.testing.assert_allclose(scans[0].xy, series.points_b[:2], atol=1e-12)


def turning_vehicle() -> PlanarMotion:
    """0.7 m/s along a course that changes by 3 deg/s, over one turn of the head."""
    t = np.linspace(0.0, 14.0, 2801)
    yaw = 2.9 + np.radians(3.0) * t
    steps = 0.7 * np.diff(t)[:, None] * np.stack([np.cos(yaw), np.sin(yaw)], 1)[:-1]
    return PlanarMotion(t, np.vstack([np.zeros(2), np.cumsum(steps, 0)]), yaw, 0.01, 1e-4)


def wall_seen(motion: PlanarMotion, offset_m: float = 12.0) -> Echoes:
    """What 200 beams see of the wall ``e = offset``, each from where the vehicle is then."""
    t = DT * np.arange(200)
    ne, yaw = motion.at(t)
    azimuth = yaw + STEP * np.arange(200)
    seen = np.sin(azimuth) > 0.3
    to_wall = (offset_m - ne[:, 1]) / np.sin(azimuth)
    bearing = azimuth - yaw
    xy_b = to_wall[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], 1)
    k = np.flatnonzero(seen)
    return Echoes(t[k], k, xy_b[k], np.tile(0.01 * np.eye(2), (len(k), 1, 1)), np.ones(len(k)))


def thickness(xy: Array) -> float:
    return float(np.sqrt(np.linalg.eigvalsh(np.cov(xy.T))[0]))


def test_deskewing_makes_a_wall_straight() -> None:
    motion = turning_vehicle()
    echoes = wall_seen(motion)
    turns = Turns(np.array([0]), np.array([200]), np.array([DT * 100]))
    (scan,) = form_scans(echoes, turns, motion)
    assert thickness(echoes.xy_b) > 0.5
    assert thickness(scan.xy) < 1e-6
    # and it lies where the vehicle at the middle beam has it
    ne, yaw = motion.at(np.array([scan.t_ref]))
    np.testing.assert_allclose((scan.xy @ planar_rotations(yaw[0]).T + ne)[:, 1], 12.0)


def test_covariance_grows_with_the_time_from_the_middle_beam() -> None:
    motion = turning_vehicle()
    echoes = wall_seen(motion)
    (scan,) = form_scans(echoes, Turns(np.array([0]), np.array([200]), np.array([7.0])), motion)
    elapsed = np.abs(echoes.t - 7.0)
    range2 = (scan.xy**2).sum(axis=1)
    grown = np.trace(scan.cov, axis1=1, axis2=2) - np.trace(echoes.cov_b, axis1=1, axis2=2)
    np.testing.assert_allclose(grown, elapsed * (2 * 0.01 + range2 * 1e-4), atol=1e-12)
    # along the ray only the position's drift is added
    ray = scan.xy / np.sqrt(range2)[:, None]
    along = np.einsum("ki,kij,kj->k", ray, scan.cov, ray)
    np.testing.assert_allclose(along, 0.01 + elapsed * 0.01, atol=1e-12)


def test_turns_without_echoes_are_empty_scans() -> None:
    motion = turning_vehicle()
    turns = Turns(np.array([0, 200]), np.array([200, 400]), np.array([7.0, 13.9]))
    scans = form_scans(wall_seen(motion), turns, motion)
    assert len(scans[0]) > 50
    assert len(scans[1]) == 0


def test_thinning_keeps_a_spacing_and_the_first() -> None:
    t = np.array([0.0, 0.5, 1.9, 2.0, 2.1, 4.5])
    np.testing.assert_array_equal(thin_scans(t, 2.0), [0, 3, 5])
    np.testing.assert_array_equal(thin_scans(t, 0.0), np.arange(6))
    assert len(thin_scans(np.empty(0), 2.0)) == 0


def test_thinning_by_motion_counts_from_the_last_that_was_kept() -> None:
    """Half a metre a second for ten seconds, then a turn on the spot of a tenth of a radian."""
    t = np.arange(20.0)
    north = 0.5 * np.minimum(t, 10.0)
    yaw = 3.0 + 0.1 * np.maximum(t - 10.0, 0.0)
    motion = PlanarMotion(t, np.column_stack([north, 0 * t]), yaw, 0.0, 0.0)
    np.testing.assert_array_equal(thin_by_motion(t, motion, 2.0, 0.25), [0, 4, 8, 13, 16, 19])
    np.testing.assert_array_equal(thin_by_motion(t, motion, 1.0, 9.0), [0, 2, 4, 6, 8, 10])
    np.testing.assert_array_equal(thin_by_motion(t, motion, 0.0, 9.0), np.arange(20))
    assert len(thin_by_motion(np.empty(0), motion, 1.0, 1.0)) == 0


def test_a_head_that_rests_neither_reverses_nor_forgets_its_sense() -> None:
    angle = STEP * np.array([0, 1, 2, 2, 2, 3, 4, 3, 2, 1, 0])
    turns = find_turns(beams_at(1.0 + angle), max_gap_s=3.0)
    assert spans(turns) == [(0, 7), (7, 11)]
