"""The method ``kiss``: where the start says, as certain as the increments add up to."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gtsam_nav.mission import InitialState, Mission, Sensor
from gtsam_nav.odometry.cloud_track import CloudTrack, KeyCloud
from gtsam_nav.odometry.dead_reckoning import placed, start_at, with_compass_errors
from gtsam_nav.preprocess.alignment import Alignment
from gtsam_nav.registration.result import RelativePose
from gtsam_nav.series import DepthSeries, GnssSeries, HeadingSeries

STEP_COV = np.diag([1e-6] * 3 + [1e-4] * 3)
START = Alignment(
    t=0.0,
    p_n=np.array([10.0, -5.0, 0.2]),
    sigma_p=np.array([0.5, 0.6, 0.7]),
    rpy=np.array([0.0, 0.0, 0.5]),
    sigma_rpy=np.array([1e-4, 1e-4, 1e-2]),
    georeferenced=True,
)


@pytest.fixture
def track() -> CloudTrack:
    """Ten metres straight ahead at 1 m/s, in a frame that is turned against the body's."""
    t = np.arange(0.0, 10.5, 0.5)
    R = Rotation.from_rotvec([0.0, 0.0, 0.3]).as_matrix()
    p_o = t[:, None] * R[:, 0]
    poses = [RelativePose(R, p, STEP_COV / 2) for p in p_o]
    key = [KeyCloud(float(t[k]), poses[k], np.zeros((1, 3)), k) for k in range(0, 21, 2)]
    return CloudTrack("lidar", t, np.tile(R, (21, 1, 1)), p_o, key, ())


def test_it_starts_where_the_alignment_says(track: CloudTrack) -> None:
    trajectory = placed(track, START, 10.0)
    ahead = np.array([np.cos(0.5), np.sin(0.5), 0.0])
    np.testing.assert_allclose(trajectory.p_n, START.p_n + trajectory.t[:, None] * ahead, atol=1e-9)
    np.testing.assert_allclose(trajectory.rpy[:, 2], 0.5, atol=1e-12)
    assert np.diff(trajectory.t).max() <= 0.1 + 1e-9


def test_its_uncertainty_grows_as_the_increments_say(track: CloudTrack) -> None:
    cov = placed(track, START, 10.0).cov_pose_n
    assert cov is not None
    R_nb = START.R_nb
    along = np.array([R_nb[:, 0] @ c[:3, :3] @ R_nb[:, 0] for c in cov[[0, -1]]])
    # ten increments of 1e-4 m^2 each
    assert along[1] - along[0] == pytest.approx(10e-4, rel=1e-3)
    across = R_nb[:, 1] @ cov[-1][:3, :3] @ R_nb[:, 1] - R_nb[:, 1] @ cov[0][:3, :3] @ R_nb[:, 1]
    # the start's heading error, over ten metres, and that of each increment over the rest
    expected = 10.0**2 * 1e-4 + 10e-4 + 1e-6 * sum(d**2 for d in range(10))
    assert across == pytest.approx(expected, rel=0.02)


def test_a_start_by_the_compass_is_as_wrong_as_the_compass() -> None:
    t = np.arange(0.0, 5.0)
    heading = HeadingSeries(t=t, heading=np.full(5, 0.5), sigma=np.full(5, 0.01))
    noise = {"bias_sigma_deg": 3.0, "disturbance_sigma_deg": 4.0}
    compass = {"heading": Sensor("heading", "heading", heading, noise=noise)}
    found = with_compass_errors(START, Mission("by compass", compass))
    assert found.sigma_rpy[2] == pytest.approx(np.hypot(0.01, np.radians(5.0)))
    np.testing.assert_array_equal(found.sigma_rpy[:2], START.sigma_rpy[:2])
    stated = Mission("stated", compass, initial=InitialState(heading=0.5, sigma_heading=0.01))
    assert with_compass_errors(START, stated) is START
    assert with_compass_errors(START, Mission("none", {})) is START


def underway(initial: InitialState | None = None) -> Mission:
    """Twenty metres north a second, turning: fixes, a compass and a depth sensor."""
    t = np.arange(0.0, 60.0)
    columns = {"t": t, "sigma": np.full(60, 0.02)}
    series = {
        "gnss": GnssSeries(t=t, p_n=t[:, None] * [20.0, 0.0, 0.0], sigma=np.full((60, 3), 0.5)),
        "heading": HeadingSeries(**columns, heading=0.01 * t),
        "depth": DepthSeries(**columns, depth_m=0.1 * t),
    }
    sensors = {name: Sensor(name, name, one) for name, one in series.items()}
    return Mission("under way", sensors, initial=initial or InitialState())


def test_it_starts_where_the_vehicle_is_at_the_first_cloud() -> None:
    start, warnings = start_at(underway(), 30.0)
    np.testing.assert_allclose(start.p_n, [600.0, 0.0, 3.0], atol=1e-9)
    np.testing.assert_array_equal(start.sigma_p, [0.5, 0.5, 0.02])
    assert start.rpy[2] == pytest.approx(0.3)
    assert warnings == ()


def test_a_start_that_nothing_tells_later_is_carried_and_said() -> None:
    stated = InitialState(np.zeros(3), 0.5, 0.2, 0.03)
    start, warnings = start_at(underway(stated).without("gnss", "heading"), 30.0)
    assert start.georeferenced
    assert start.heading_known
    np.testing.assert_allclose(start.p_n, [0.0, 0.0, 3.0], atol=1e-9)
    np.testing.assert_allclose(start.sigma_p, [np.hypot(0.5, 28.0)] * 2 + [0.02])
    assert start.rpy[2] == 0.2
    assert start.sigma_rpy[2] == pytest.approx(np.hypot(0.03, 2.8))
    assert "begin 30 s after the other sensors" in warnings[0]
    assert "the position and the heading" in warnings[0]


def test_what_is_carried_grows_from_the_start_on() -> None:
    stated = InitialState(np.zeros(3), 0.1, 0.2, 0.01)
    alone = underway(stated).without("gnss", "heading")
    within, beyond = (start_at(alone, t)[0] for t in (1.99, 2.01))
    np.testing.assert_allclose(beyond.sigma_p, within.sigma_p, rtol=0.01)
    np.testing.assert_allclose(beyond.sigma_rpy, within.sigma_rpy, rtol=0.01)


def test_clouds_from_the_beginning_take_the_stated_start() -> None:
    stated = InitialState(np.ones(3), 0.1, 0.2, 0.03)
    start, warnings = start_at(underway(stated), 0.2)
    np.testing.assert_array_equal(start.p_n[:2], [1.0, 1.0])
    assert start.rpy[2] == 0.2
    assert warnings == ()
