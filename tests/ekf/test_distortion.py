"""What errors of the motion within a scan do to its echoes and matches, against drawn errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.config import load_config
from gtsam_nav.ekf.compounding import compound, inverse, tail_to_tail
from gtsam_nav.ekf.constant_velocity import YAW
from gtsam_nav.ekf.distortion import Distortion, bending, distortions, walking
from gtsam_nav.ekf.scan_match import match_consecutive
from gtsam_nav.ekf.scan_track import ScanTrack, follow_scans
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission
from gtsam_nav.registration.pic import register
from gtsam_nav.registration.response import response
from gtsam_nav.registration.settings import PicSettings
from gtsam_nav.series import ReferenceSeries
from gtsam_nav.simulation.settings import DvlSimulation, SimulationSettings
from gtsam_nav.sonar.echoes import Echoes
from gtsam_nav.sonar.motion import PlanarMotion
from gtsam_nav.sonar.preparation import SonarData, deskewed
from gtsam_nav.sonar.scans import Turns, planar_rotations

SETTINGS = PicSettings(floor_xy_m=0.0, floor_yaw_deg=0.0)
SCAN_S, BEAMS = 14.0, 200
SPEED_M_S, SIGMA_M = 0.7, 0.1
YAW_GROWTH, WAY_GROWTH = np.radians(0.4) ** 2, 0.02**2
CORNERS = np.array([[-20.0, -8.0], [30.0, -8.0], [30.0, 12.0], [-20.0, 12.0]])


def ranges(place: Array, azimuth: Array) -> Array:
    """To the walls of a room."""
    best = np.full(len(azimuth), np.inf)
    ray = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    for start, end in zip(CORNERS, np.roll(CORNERS, -1, axis=0), strict=True):
        along = end - start
        normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)
        with np.errstate(divide="ignore"):
            r = np.sum((start - place) * normal, axis=1) / (ray @ normal)
        best = np.where((r > 0) & (r < best), r, best)
    return best


def straight() -> tuple[Echoes, Turns, Array]:
    """Echoes of two turns of the head on a straight way, with the times of their beams."""
    t = np.linspace(0.0, 2 * SCAN_S, 2 * BEAMS, endpoint=False)
    bearing = 2 * np.pi * t / SCAN_S
    place = np.column_stack([SPEED_M_S * t, 0.0 * t])
    xy_b = ranges(place, bearing)[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    cov = np.tile(SIGMA_M**2 * np.eye(2), (len(t), 1, 1))
    echoes = Echoes(t, np.arange(len(t)), xy_b, cov, np.full(len(t), 100.0))
    first = np.array([0, BEAMS])
    return echoes, Turns(first, first + BEAMS, t[first + BEAMS // 2]), t


def way(t: Array, yaw_error: Array, ne_error: Array) -> PlanarMotion:
    """Dead reckoning whose heading and velocity are wrong."""
    step = np.diff(t, prepend=t[0])[:, None] * SPEED_M_S
    ne = np.cumsum(step * np.column_stack([np.cos(yaw_error), np.sin(yaw_error)]), axis=0)
    return PlanarMotion(t, ne + ne_error, yaw_error, 0.0, 0.0)


def walk(rng: np.random.Generator, t: Array, growth: float) -> Array:
    return np.cumsum(rng.normal(size=len(t)) * np.sqrt(growth * np.diff(t, prepend=t[0])))


@pytest.fixture(scope="module")
def stated() -> tuple[SonarData, list[Distortion]]:
    echoes, turns, t = straight()
    motion = way(t, np.zeros(len(t)), np.zeros((len(t), 2)))
    data = deskewed(echoes, turns, motion)
    return data, distortions(data, motion, WAY_GROWTH * t, walking(YAW_GROWTH), SETTINGS)


def drawn(runs: int) -> list[SonarData]:
    rng, (echoes, turns, t) = np.random.default_rng(4), straight()
    found = []
    for _ in range(runs):
        ne_error = np.column_stack([walk(rng, t, WAY_GROWTH) for _ in range(2)])
        found.append(deskewed(echoes, turns, way(t, walk(rng, t, YAW_GROWTH), ne_error)))
    return found


def test_echoes_are_displaced_as_drawn(stated: tuple[SonarData, list[Distortion]]) -> None:
    data, distorted = stated
    moved = np.array([one.scans[1].xy for one in drawn(400)]) - data.scans[1].xy
    cov = distorted[1].moved @ np.swapaxes(distorted[1].moved, 1, 2)
    for beam in (0, 40, 160, BEAMS - 1):
        d2 = np.sum(moved[:, beam] * np.linalg.solve(cov[beam], moved[:, beam].T).T, axis=1)
        assert np.mean(d2) == pytest.approx(2.0, rel=0.15)


def test_a_vehicle_strays_from_its_scan_as_drawn() -> None:
    """By a walk, which is at the last echo elsewhere than the scan on the whole."""
    rng, runs, (echoes, turns, t) = np.random.default_rng(6), 1000, straight()
    motion = way(t, np.zeros(len(t)), np.zeros((len(t), 2)))
    data = deskewed(echoes, turns, motion)
    distorted = distortions(data, motion, WAY_GROWTH * t, walking(0.0), SETTINGS)[1]
    steps = rng.normal(size=(len(t), 2, runs)) * np.sqrt(WAY_GROWTH * np.diff(t)[0])
    error = np.cumsum(steps, axis=0)[BEAMS:]
    moved, scan = error - error[BEAMS // 2], data.scans[1]
    whole = response(scan, scan, np.zeros(3), moved, moved, SETTINGS)[0][:2]
    seen = np.cov(np.concatenate([moved[-1] - whole, whole - moved[0]]))
    strayed = distorted.strayed.reshape(4, -1)
    np.testing.assert_allclose(strayed @ strayed.T, seen, atol=0.05 * np.trace(seen))


def test_what_its_headings_move_a_scan_by_stays_with_that_scan(
    stated: tuple[SonarData, list[Distortion]],
) -> None:
    strayed = stated[1][1].strayed
    to_last = strayed.sum(axis=0)
    np.testing.assert_allclose(
        to_last @ to_last.T, WAY_GROWTH * SCAN_S * np.eye(2), rtol=0.01, atol=1e-9
    )


def test_at_its_reference_time_a_scan_is_where_it_is(
    stated: tuple[SonarData, list[Distortion]],
) -> None:
    np.testing.assert_allclose(stated[1][0].moved[BEAMS // 2], 0.0, atol=1e-12)


def test_echoes_after_the_reference_time_alone_are_displaced_as_among_others(
    stated: tuple[SonarData, list[Distortion]],
) -> None:
    """Nothing happened to them between it and the first of them that did not happen once."""
    echoes, turns, t = straight()
    motion = way(t, np.zeros(len(t)), np.zeros((len(t), 2)))
    half, late = BEAMS // 2, BEAMS // 2 + 20
    for begin, end in ((late, BEAMS), (0, half - 20)):
        part = Turns(np.array([begin]), np.array([end]), turns.t_ref[:1])
        data = deskewed(echoes, part, motion)
        (alone,) = distortions(data, motion, WAY_GROWTH * t, walking(YAW_GROWTH), SETTINGS)
        among = stated[1][0].moved[begin:end]
        np.testing.assert_allclose(
            alone.moved @ np.swapaxes(alone.moved, 1, 2),
            among @ np.swapaxes(among, 1, 2),
            rtol=1e-2,
            atol=1e-5,
        )


def test_a_scan_taken_at_once_is_not_distorted() -> None:
    echoes, turns, t = straight()
    at_once = replace(echoes, t=np.repeat(turns.t_ref, BEAMS))
    motion = way(t, np.zeros(len(t)), np.zeros((len(t), 2)))
    data = deskewed(at_once, turns, motion)
    distorted = distortions(data, motion, WAY_GROWTH * t, walking(YAW_GROWTH), SETTINGS)
    assert all(one.moved.size == one.whole.size == 0 for one in distorted)
    match = register(*data.scans, np.array([9.8, 0.0, 0.0]), np.diag([0.1, 0.1, 0.01]), SETTINGS)
    assert all(by.size == 0 for by in bending(*data.scans, match, *distorted, SETTINGS))


def test_what_moves_a_scan_as_a_whole_does_not_bend_its_matches(
    stated: tuple[SonarData, list[Distortion]],
) -> None:
    data, _ = stated
    match = register(*data.scans, np.array([9.8, 0.0, 0.0]), np.diag([0.1, 0.1, 0.01]), SETTINGS)
    nowhere = np.zeros((2, 2, 3))
    still = Distortion(np.zeros((BEAMS, 2, 3)), np.zeros((3, 3)), nowhere)
    for k in (0, 1):
        xy = data.scans[k].xy
        turned = np.stack([-xy[:, 1], xy[:, 0]], axis=1)
        shifts = np.broadcast_to(np.eye(2), (len(xy), 2, 2))
        whole = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
        moved = Distortion(np.concatenate([turned[..., None], shifts], axis=2), whole, nowhere)
        pair = (moved, still) if k == 0 else (still, moved)
        by_a, by_b = bending(*data.scans, match, *pair, SETTINGS)
        assert np.linalg.norm(np.hstack([by_a, by_b]), axis=1).max() < 0.06


@pytest.mark.slow
def test_matches_are_as_wrong_as_stated() -> None:
    """In simulated marinas, against the true poses of the scans' beams; not without bending."""
    with_bending, without = [], []
    for seed in range(2):
        mission = gn.simulate("marina", seed=seed, settings=SimulationSettings.matched())
        track = follow_scans(mission, load_config(None, ["gnss.use=none"]))
        poses = poses_of_beams(mission, track)
        for k in range(1, len(track)):
            found, bends = match_consecutive(track, k, load_config())
            if not found.accepted:
                continue
            error = found.match.q - tail_to_tail(poses[k - 1], poses[k])[0]
            error[2] = wrap_angle(error[2])
            bending = sum(by @ by.T for by in bends)
            for d2, cov in (
                (with_bending, found.match.cov),
                (without, found.match.cov - bending),
            ):
                d2.append(float(error @ np.linalg.solve(cov, error)) / 3)
    assert len(with_bending) > 60
    assert 0.7 < np.mean(with_bending) < 1.4
    assert np.mean(without) > 1.5


def test_errors_within_scans_mend_the_way_between_them() -> None:
    """As told by the echoes that they displaced, with headings put right on the way."""
    noisy = DvlSimulation(
        sigma_m_s=0.2, dropouts_per_min=0.0, scale_sigma=0.0, misalignment_sigma_deg=0.0
    )
    settings = SimulationSettings.matched().model_copy(update={"dvl": noisy})
    mission = gn.simulate("marina", seed=100, duration_s=200.0, settings=settings)
    track = follow_scans(mission, load_config(None, ["gnss.use=none"]))
    poses, exact = poses_of_beams(mission, track), exact_motion(mission)
    within = []
    for scan, true, distortion in zip(
        track.sonar.scans,
        deskewed(track.sonar.echoes, track.sonar.turns, exact).scans,
        track.distortions,
        strict=True,
    ):
        displaced, J = (scan.xy - true.xy).ravel(), distortion.moved.reshape(2 * len(scan), -1)
        # beside the noise of single headings
        cov = J @ J.T + 0.3**2 * np.eye(len(displaced))
        within.append(J.T @ np.linalg.solve(cov, displaced))
    off = np.interp(track.filtered.t, exact.t, exact.yaw) - track.filtered.x[:, YAW]
    steps = np.diff(track.filtered.x[:, :2], axis=0)
    turned = np.einsum("nij,nj->ni", planar_rotations(off[:-1]), steps)
    way = np.concatenate([np.zeros((1, 2)), np.cumsum(turned, axis=0)])[track.record]
    stated, seen = [], []
    for k in range(2, len(track)):
        onward, reached = track._strayed(k - 1)[0], track._strayed(k)[1]
        stated.append(onward @ within[k - 1] + reached @ within[k])
        seen.append(poses[k, :2] - poses[k - 1, :2] - way[k] + way[k - 1])
    assert np.corrcoef(np.ravel(stated), np.ravel(seen))[0, 1] > 0.3


def exact_motion(mission: Mission) -> PlanarMotion:
    reference = mission.reference
    assert reference is not None
    assert isinstance(reference.series, ReferenceSeries)
    assert reference.series.rpy is not None
    yaw = np.unwrap(reference.series.rpy[:, 2])
    return PlanarMotion(reference.series.t, reference.series.p_n[:, :2], yaw, 0.0, 0.0)


def poses_of_beams(mission: Mission, track: ScanTrack) -> Array:
    """True poses of what the scans are, put together by a motion that is not quite right."""
    motion = exact_motion(mission)
    exact = deskewed(track.sonar.echoes, track.sonar.turns, motion)
    ne, yaw = motion.at(track.t)
    poses = []
    for pose, scan, true in zip(
        np.column_stack([ne, yaw]), track.sonar.scans, exact.scans, strict=True
    ):
        moved = (scan.xy - true.xy)[:, :, None]
        whole = response(scan, scan, np.zeros(3), moved, moved, track.pic)[0][:, 0]
        poses.append(compound(pose, inverse(whole)[0])[0])
    return np.array(poses)
