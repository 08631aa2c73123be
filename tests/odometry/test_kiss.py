"""Cloud odometry: it follows, knows how well, and says what it left out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from gtsam_nav.errors import EstimationError
from gtsam_nav.frames import quaternion_from_rpy
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.odometry import kiss
from gtsam_nav.odometry.cloud_track import CloudTrack
from gtsam_nav.odometry.kiss import KissOdometry, cloud_odometry
from gtsam_nav.odometry.settings import KissSettings
from gtsam_nav.series import Cloud, CloudSeries, ReferenceSeries
from gtsam_nav.simulation import SimulationSettings, make_scenario, simulate
from gtsam_nav.solution import no_progress
from gtsam_nav.trajectory import Trajectory


def harbour(duration_s: float, seed: int = 0) -> Mission:
    """The simulated harbour without rest at its beginning: the vessel soon moves."""
    settings = make_scenario("harbour").settings
    motion = settings.motion.model_copy(update={"rest_s": 0.0, "ramp_s": 1.0})
    moving = SimulationSettings.model_validate({**dict(settings), "motion": motion})
    return simulate("harbour", seed, duration_s, moving)


def truth_of(mission: Mission) -> Trajectory:
    assert mission.reference is not None
    series = mission.reference.series
    assert isinstance(series, ReferenceSeries)
    assert series.rpy is not None
    return Trajectory(t=series.t, p_n=series.p_n, q_nb_wxyz=quaternion_from_rpy(series.rpy))


def nees_of(track: CloudTrack, mission: Mission) -> np.ndarray:
    """Normalised squared errors of the increments between kept clouds, shape (m,)."""
    truth = truth_of(mission).interpolate([cloud.t for cloud in track.key])
    found = []
    for j in range(1, len(track.key)):
        increment = track.increment(j - 1, j)
        R_a = truth.R_nb[j - 1].T
        e = increment.error_of(R_a @ truth.R_nb[j], R_a @ (truth.p_n[j] - truth.p_n[j - 1]))
        found.append(float(e @ np.linalg.solve(increment.cov, e)))
    return np.array(found)


@pytest.fixture(scope="module")
def mission() -> Mission:
    return harbour(3.2)


@pytest.fixture(scope="module")
def track(mission: Mission) -> CloudTrack:
    found = cloud_odometry(mission, KissSettings(), no_progress)
    assert found is not None
    return found


def clouds_of(mission: Mission) -> tuple[Sensor, CloudSeries]:
    sensor = mission.sensors["lidar"]
    assert isinstance(sensor.series, CloudSeries)
    return sensor, sensor.series


def with_clouds(mission: Mission, clouds: tuple[Cloud, ...]) -> Mission:
    sensor, series = clouds_of(mission)
    kept = series.select(slice(0, len(clouds)))
    return mission.with_sensor(replace(sensor, series=replace(kept, clouds=clouds)))


@pytest.mark.slow
def test_it_follows_a_moving_vessel(track: CloudTrack, mission: Mission) -> None:
    truth = truth_of(mission).interpolate(track.t)
    R_0 = truth.R_nb[0].T
    p_true = (truth.p_n - truth.p_n[0]) @ R_0.T
    assert np.linalg.norm(p_true[-1]) > 4.0
    assert np.abs((track.p_o - track.p_o[0]) - p_true).max() < 0.08
    turn = Rotation.from_matrix(np.swapaxes(R_0 @ truth.R_nb, 1, 2) @ track.R_ob)
    assert np.degrees(turn.magnitude()).max() < 0.5


def test_poses_stand_at_the_last_point_of_each_cloud(track: CloudTrack, mission: Mission) -> None:
    _, series = clouds_of(mission)
    first = series.clouds[0]
    assert isinstance(first, Cloud)
    assert first.offset_s is not None
    assert track.t[0] == pytest.approx(series.t[0] + first.offset_s.max())
    assert len(track.t) == len(series)
    assert np.diff([cloud.t for cloud in track.key]).min() >= 1.0 - 1e-9


@pytest.mark.slow
def test_without_times_in_the_sweep_it_drifts_more(track: CloudTrack, mission: Mission) -> None:
    _, series = clouds_of(mission)
    bare = tuple(Cloud(c.points_s) for c in series.clouds if isinstance(c, Cloud))
    skewed = cloud_odometry(with_clouds(mission, bare), KissSettings(), no_progress)
    assert skewed is not None
    truth = truth_of(mission)

    def off(found: CloudTrack, t: np.ndarray) -> float:
        there = truth.interpolate(t)
        p_true = (there.p_n - there.p_n[0]) @ there.R_nb[0]
        return float(np.sqrt(np.mean((found.p_o - found.p_o[0] - p_true) ** 2)))

    assert off(skewed, track.t) > 2 * off(track, track.t)


@pytest.mark.slow
def test_points_of_one_time_are_a_cloud_without_times_and_said(mission: Mission) -> None:
    _, series = clouds_of(mission)
    clouds = [c for c in series.clouds if isinstance(c, Cloud)][:6]
    bare = tuple(Cloud(c.points_s) for c in clouds)
    equal = tuple(Cloud(c.points_s, np.zeros(len(c.points_s))) for c in clouds)
    # an unguarded KISS-ICP ends the whole process here
    found = cloud_odometry(with_clouds(mission, equal), KissSettings(), no_progress)
    expected = cloud_odometry(with_clouds(mission, bare), KissSettings(), no_progress)
    assert found is not None
    assert expected is not None
    np.testing.assert_array_equal(found.p_o, expected.p_o)
    assert expected.warnings == ()
    assert "in 6 clouds" in found.warnings[0]


@pytest.mark.slow
def test_the_same_clouds_give_the_same_track(track: CloudTrack, mission: Mission) -> None:
    _, series = clouds_of(mission)
    last = track.key[1].index
    few = with_clouds(mission, tuple(c for c in series.clouds[: last + 1] if isinstance(c, Cloud)))
    again = cloud_odometry(few, KissSettings(), no_progress)
    assert again is not None
    np.testing.assert_array_equal(again.p_o, track.p_o[: last + 1])
    np.testing.assert_array_equal(again.key[1].pose.cov, track.key[1].pose.cov)


def test_small_clouds_are_left_out_and_said(mission: Mission) -> None:
    _, series = clouds_of(mission)
    clouds = [c for c in series.clouds if isinstance(c, Cloud)][:7]
    clouds[3] = Cloud(clouds[3].points_s[:10])
    found = cloud_odometry(with_clouds(mission, tuple(clouds)), KissSettings(), no_progress)
    assert found is not None
    assert len(found.t) == 6
    assert [(r.sensor, r.index) for r in found.rejections] == [("lidar", 3)]
    assert "too few points" in found.rejections[0].reason


@pytest.mark.slow
def test_clouds_out_of_range_are_left_out_and_said(mission: Mission) -> None:
    """They say nothing of the motion: the vehicle moves all the same."""
    _, series = clouds_of(mission)
    clouds = [c for c in series.clouds if isinstance(c, Cloud)]
    far = [Cloud(200.0 + c.points_s, c.offset_s) for c in clouds[:4]]
    clouds[:2], clouds[6:8] = far[:2], far[2:]
    found = cloud_odometry(with_clouds(mission, tuple(clouds)), KissSettings(), no_progress)
    assert found is not None
    assert [r.index for r in found.rejections] == [0, 1, 6, 7]
    assert "too few points in range" in found.rejections[0].reason
    assert len(found.t) == len(clouds) - 4
    assert nees_of(found, mission).max() < chi2.ppf(0.9999, 6)


@pytest.mark.slow
def test_sweeps_with_a_pause_between_them_are_deskewed_by_their_own_span() -> None:
    outing = harbour(10.0).crop(2.0)
    sensor, series = clouds_of(outing)
    some = outing.with_sensor(replace(sensor, series=series.select(slice(None, None, 5))))
    found = cloud_odometry(some, KissSettings(), no_progress)
    assert found is not None
    assert np.diff(found.t).min() > 0.9
    truth = truth_of(outing).interpolate(found.t)
    steps, true = (np.linalg.norm(np.diff(p, axis=0), axis=1) for p in (found.p_o, truth.p_n))
    assert np.abs(steps - true).max() < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("gap_s", [1.6, 8.0])
def test_a_gap_is_bridged_or_known_for_a_guess(gap_s: float) -> None:
    outing = harbour(14.0)
    sensor, series = clouds_of(outing)
    kept = series.select((series.t < 4.0) | (series.t >= 4.0 + gap_s))
    found = cloud_odometry(
        outing.with_sensor(replace(sensor, series=kept)), KissSettings(), no_progress
    )
    assert found is not None
    assert nees_of(found, outing).mean() / 6 < 4.0
    assert found.warnings == () or "after 1 of its gaps" in found.warnings[0]
    assert (found.warnings == ()) == (gap_s < 2.0)


@pytest.mark.slow
@pytest.mark.parametrize("late_s", [0.0, 0.14, 0.19, 0.199])
def test_stamps_that_come_in_pairs_do_no_harm(mission: Mission, late_s: float) -> None:
    sensor, series = clouds_of(mission)
    bare = tuple(Cloud(c.points_s) for c in series.clouds if isinstance(c, Cloud))
    stamps = series.t + np.where(np.arange(len(bare)) % 2, late_s, 0.0)
    paired = mission.with_sensor(replace(sensor, series=CloudSeries(t=stamps, clouds=bare)))
    found = cloud_odometry(paired, KissSettings(), no_progress)
    assert found is not None
    assert found.warnings == ()
    there = truth_of(mission).interpolate(series.t[1:] + 0.1)  # the middle of a sweep, about
    far, true = (np.linalg.norm(p[-1] - p[0]) for p in (found.p_o[1:], there.p_n))
    assert abs(far - true) < 0.3


@pytest.mark.slow
def test_over_an_hour_at_rest_it_stays(mission: Mission) -> None:
    """The noise of a motion does not go on through it."""
    sensor, series = clouds_of(mission)
    rng = np.random.default_rng(0)
    still = series.clouds[0]
    assert isinstance(still, Cloud)
    clouds = tuple(
        Cloud(still.points_s + rng.normal(0, 0.02, still.points_s.shape)) for _ in "12345678"
    )
    t = np.r_[0.1 * np.arange(4), 3600.0 + 0.1 * np.arange(4)]
    found = cloud_odometry(
        mission.with_sensor(replace(sensor, series=CloudSeries(t=t, clouds=clouds))),
        KissSettings(keyframe_interval_s=0.1),
        no_progress,
    )
    assert found is not None
    assert found.warnings == ()
    assert np.abs(found.p_o).max() < 0.05


@pytest.mark.slow
def test_a_misfit_without_a_gap_is_said(mission: Mission, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kiss, "LEAST_FITNESS", 2.0)  # no match is good enough
    found = cloud_odometry(mission.crop(0.0, 1.4), KissSettings(), no_progress)
    assert found is not None
    assert f"no fit of {len(found.t) - 1} of its clouds" in found.warnings[0]
    assert "gaps" not in found.warnings[0]


def test_a_small_tank_is_enough() -> None:
    rng = np.random.default_rng(0)
    wall = rng.uniform(-3.0, 3.0, (600, 3)) * [1.0, 1.0, 0.5]
    wall[:300, 0], wall[300:, 1] = 3.0, -3.0
    odometry = KissOdometry(KissSettings())
    assert odometry.has_enough(wall)
    assert not odometry.has_enough(wall[:40])
    assert not odometry.has_enough(2.0 + 0.1 * rng.uniform(size=(600, 3)))
    assert not odometry.has_enough(wall + 200.0)


@pytest.mark.slow
def test_another_pace_is_a_gap_once(mission: Mission, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kiss, "SURE_FITNESS", 2.0)  # no match is good enough
    sensor, series = clouds_of(mission)
    kept = series.select(np.array([0, 1, 2, 6, 10, 14]))
    slower = mission.with_sensor(replace(sensor, series=kept))
    found = cloud_odometry(slower, KissSettings(), no_progress)
    assert found is not None
    assert [cloud.map for cloud in found.key][-2:] == [1, 1]


def test_a_cloud_that_cannot_be_read_is_left_out_and_said(mission: Mission, tmp_path: Path) -> None:
    broken = tmp_path / "broken.npy"
    broken.write_bytes(b"not numpy")
    sensor, series = clouds_of(mission)
    clouds = (*series.clouds[:2], broken, *series.clouds[3:7])
    few = replace(series.select(slice(0, 7)), clouds=clouds)
    found = cloud_odometry(
        mission.with_sensor(replace(sensor, series=few)), KissSettings(), no_progress
    )
    assert found is not None
    assert len(found.t) == 6
    assert [r.index for r in found.rejections] == [2]
    assert "cannot read the cloud" in found.rejections[0].reason


def test_a_second_scanner_is_left_out_and_said(mission: Mission) -> None:
    sensor, _ = clouds_of(mission)
    two = mission.with_sensor(replace(sensor, name="stern")).crop(0.0, 1.6)
    found = cloud_odometry(two, KissSettings(), no_progress)
    assert found is not None
    assert found.sensor == "lidar"
    assert ["'stern' is left out" in said for said in found.warnings] == [True]


def test_clouds_without_points_are_no_odometry(mission: Mission) -> None:
    empty = tuple(Cloud(np.zeros((0, 3))) for _ in range(5))
    why = "sensor 'lidar': fewer than two clouds can be used: a cloud of too few points"
    with pytest.raises(EstimationError, match=why):
        cloud_odometry(with_clouds(mission, empty), KissSettings(), no_progress)


def test_clouds_within_one_keyframe_interval_are_said_to_be(mission: Mission) -> None:
    with pytest.raises(EstimationError, match=r"3 clouds end within 0\.4 s: shorter"):
        cloud_odometry(mission.crop(0.0, 0.55), KissSettings(), no_progress)


def test_a_mission_without_clouds_has_none(mission: Mission) -> None:
    assert cloud_odometry(mission.without("lidar"), KissSettings(), no_progress) is None
    assert cloud_odometry(mission, KissSettings(use=False), no_progress) is None


@pytest.mark.slow
def test_a_track_that_begins_under_way_begins_well(mission: Mission) -> None:
    """Its first cloud is bent by a motion that only the second tells."""
    moving = mission.crop(1.6)
    track = cloud_odometry(moving, KissSettings(), no_progress)
    assert track is not None
    assert nees_of(track, mission)[0] < chi2.ppf(0.9999, 6)


@pytest.mark.slow
def test_increments_are_as_uncertain_as_they_say() -> None:
    """Over simulated runs the mean normalised squared error is near one a degree of freedom."""
    means = []
    # how well the surroundings fix a pose differs by the place: one run goes further
    for outing in (harbour(20.0, seed=11), harbour(34.0, seed=12)):
        track = cloud_odometry(outing, KissSettings(), no_progress)
        assert track is not None
        means.append(nees_of(track, outing).mean() / 6)
    assert 0.5 < np.mean(means) < 1.5, means
