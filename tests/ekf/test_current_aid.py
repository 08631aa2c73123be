"""A current under a DVL that has only the water left, in the inertial filter."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.config import Config
from gtsam_nav.ekf.aid import Aid, laid_out
from gtsam_nav.ekf.aiding import aids_of
from gtsam_nav.ekf.inertial_start import InertialStart, inertial_start
from gtsam_nav.ekf.strapdown import SIZE, Strapdown
from gtsam_nav.frames import Array
from gtsam_nav.mission import InitialState, Mission, Sensor
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.series import DvlSeries, HeadingSeries, ImuSeries, Series

CURRENT_N = np.array([0.1, 0.4])
LOST_S, END_S = 30.0, 120.0


@cache
def carried_off(lost_s: float = LOST_S) -> Mission:
    """Northward at 1 m/s over ground, with bottom lock at first and then over a current."""
    rng = np.random.default_rng(0)
    t = np.arange(0.0, END_S, 0.02)
    n, t_dvl = len(t), t[::10]
    m, on_bottom = len(t_dvl), t_dvl < lost_s
    force = np.tile([0.0, 0.0, -9.80665], (n, 1)) + rng.normal(0.0, 0.05, (n, 3))
    v_d = np.tile([1.0, 0.0, 0.0], (m, 1)) + rng.normal(0.0, 0.02, (m, 3))
    v_d[~on_bottom, :2] -= CURRENT_N
    series: dict[str, Series] = {
        "imu": ImuSeries(t=t, gyro_i=rng.normal(0.0, 0.002, (n, 3)), accel_i=force),
        "dvl": DvlSeries(
            t=t_dvl,
            v_d=v_d,
            sigma=np.full(m, 0.02),
            valid=np.ones(m, dtype=bool),
            bottom_lock=on_bottom,
        ),
        "heading": HeadingSeries(t=t_dvl, heading=rng.normal(0.0, 0.01, m), sigma=np.full(m, 0.01)),
    }
    start = InitialState(p_n=np.zeros(3), sigma_p=0.1, heading=0.0, sigma_heading=0.01)
    aboard = {name: Sensor(name, name, one) for name, one in series.items()}
    return Mission("current", aboard, initial=start)


def test_a_current_that_was_seen_to_begin_is_taken_off() -> None:
    track = gn.estimate(carried_off(), "ins-ekf").trajectory
    error = track.p_n[-1, :2] - [track.t[-1], 0.0]
    assert np.hypot(*error) < 0.2 * np.hypot(*CURRENT_N) * (END_S - LOST_S)
    assert track.cov_pose_n is not None
    assert error @ np.linalg.solve(track.cov_pose_n[-1, :2, :2], error) < 6.0


def test_a_current_that_nothing_shows_carries_the_vehicle_along_for_all_the_filter_knows() -> None:
    track = gn.estimate(carried_off(0.0), "ins-ekf").trajectory
    sigma = track.sigma_p_n
    assert sigma is not None
    assert sigma[-1, :2] == pytest.approx(0.5 * END_S, rel=0.15)


def start_of(mission: Mission) -> InertialStart:
    return inertial_start(mission, mission.sensors["imu"], MotionSettings())


def aids_on(mission: Mission) -> list[Aid]:
    strapdown = Strapdown(mission.sensors["imu"], None)
    return aids_of(mission, strapdown, start_of(mission), Config())[0]


def test_the_jacobian_of_a_velocity_through_the_water_is_its_derivative() -> None:
    mission = carried_off()
    aid = next(aid for aid in aids_on(mission) if aid.name == "dvl")
    state, k = start_of(mission).state.corrected(np.linspace(-0.3, 0.4, SIZE)), len(aid.t) - 1
    shared = np.array([0.0, 0.0, *CURRENT_N])

    def residual(error: Array) -> Array:
        turned = state.corrected(error[:SIZE])
        return aid.predict(k, turned, shared + error[SIZE:]).residual

    prediction = aid.predict(k, state, shared)
    expected = np.zeros((3, SIZE + 4))
    expected[:, : prediction.jacobian.shape[1]] = prediction.jacobian
    expected[:, SIZE:] = aid.by_shared(k, state, shared)
    steps = 1e-6 * np.eye(SIZE + 4)
    found = np.array([(residual(step) - residual(-step)) / 2e-6 for step in steps]).T
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_several_dvls_are_carried_off_by_one_current() -> None:
    mission = carried_off(0.0)
    dvl = mission.sensors["dvl"]
    both = mission.with_sensor(replace(dvl, name="other"))
    alone, together = (gn.estimate(m, "ins-ekf").trajectory.sigma_p_n for m in (mission, both))
    assert alone is not None
    assert together is not None
    np.testing.assert_allclose(together[-1, :2], alone[-1, :2], rtol=0.02)


def test_what_aids_have_in_common_stands_once_among_the_shared_errors() -> None:
    mission = carried_off()
    aids = aids_on(mission.with_sensor(replace(mission.sensors["dvl"], name="other")))
    errors, places = laid_out(aids)
    by_name = {aid.name: place.tolist() for aid, place in zip(aids, places, strict=True)}
    assert by_name["dvl"][-2:] == by_name["other"][-2:]
    assert len(errors) == sum(len(aid.shared) for aid in aids) - 2
    assert sorted({k for place in places for k in place.tolist()}) == list(range(len(errors)))
    for aid, place in zip(aids, places, strict=True):
        np.testing.assert_array_equal(errors.sigma[place], aid.shared.sigma)
        np.testing.assert_array_equal(errors.time_s[place], aid.shared.time_s)


def test_scale_and_misalignment_are_of_the_way_through_the_water() -> None:
    mission = carried_off()
    aid = next(aid for aid in aids_on(mission) if aid.name == "dvl")
    state = replace(start_of(mission).state, v_n=np.array([1.0, 0.0, 0.0]))
    for k, current_n in ((0, [0.0, 0.0]), (len(aid.t) - 1, CURRENT_N)):
        by_shared = aid.by_shared(k, state, np.array([0.0, 0.0, *CURRENT_N]))
        forward, right, down = state.body.R_nb.T @ (state.v_n - [*current_n, 0.0])
        np.testing.assert_allclose(by_shared[:, 0], [forward, right, down], atol=1e-12)
        np.testing.assert_allclose(by_shared[:, 1], [-right, forward, 0.0], atol=1e-12)
