"""The first guess of a motion that no velocity sensor tells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtsam_nav as gn
from gtsam_nav.config import Config
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import InitialState, Mission
from gtsam_nav.preprocess.alignment import align
from gtsam_nav.preprocess.inertial_motion import inertial_motion
from gtsam_nav.preprocess.motion import VehicleMotion
from gtsam_nav.series import GnssSeries, ReferenceSeries


def blind(mission: Mission) -> Mission:
    return mission.without("reference")


def guess(mission: Mission) -> VehicleMotion:
    return inertial_motion(mission, align(mission), Config().motion)


def errors(motion: VehicleMotion, mission: Mission) -> tuple[Array, Array]:
    """Of positions, m, and of roll, pitch and yaw, rad, both (n, 3)."""
    assert mission.reference is not None
    truth = mission.reference.series
    assert isinstance(truth, ReferenceSeries)
    assert truth.rpy is not None
    p_n, rpy = motion.at(truth.t)
    return p_n - truth.p_n, wrap_angle(rpy - truth.rpy)


@pytest.fixture(scope="module")
def laps() -> Mission:
    return gn.simulate("laps", seed=2)


def test_with_fixes_and_a_compass_it_is_within_a_metre(laps: Mission) -> None:
    motion = guess(blind(laps))
    position, attitude = errors(motion, laps)
    assert np.sqrt(np.mean(position[:, :2] ** 2)) < 1.0
    assert np.all(np.degrees(np.sqrt(np.mean(attitude**2, axis=0))) < [2.5, 2.5, 0.5])
    assert motion.t[0] == pytest.approx(0.0)
    assert np.max(np.abs(motion.gyro_bias_b)) < 0.05


def test_without_a_compass_the_course_tells_the_heading(laps: Mission) -> None:
    _, attitude = errors(guess(blind(laps).without("heading")), laps)
    assert np.degrees(np.sqrt(np.mean(attitude[600:-400, 2] ** 2))) < 10.0


def test_a_stated_heading_goes_before_the_course(laps: Mission) -> None:
    """A vehicle that drifts sideways does not point where it goes."""
    stated = replace(blind(laps).without("heading"), initial=InitialState(heading=1.2))
    assert guess(stated).rpy[0, 2] == pytest.approx(1.2)


def test_positions_that_are_stated_to_be_useless_do_not_move_it(laps: Mission) -> None:
    """It begins at the local frame's zero, or follows another receiver."""
    gnss = laps.sensors["gnss"]
    series = gnss.series
    assert isinstance(series, GnssSeries)
    useless = replace(series, p_n=np.zeros((len(series), 3)), sigma=np.full((len(series), 3), 2e4))
    doppler = replace(gnss, name="doppler", series=useless)
    alone = blind(laps).without("gnss").with_sensor(doppler)
    np.testing.assert_allclose(guess(alone).p_n[0], 0.0, atol=0.1)
    both = guess(alone.with_sensor(gnss))
    np.testing.assert_array_equal(both.p_n, guess(blind(laps)).p_n)


def test_without_fixes_it_is_inertial_navigation() -> None:
    mission = gn.simulate("submarine", seed=1, duration_s=300.0)
    position, attitude = errors(guess(blind(mission)), mission)
    assert np.max(np.abs(position[:, :2])) < 60.0
    assert np.degrees(np.max(np.abs(attitude))) < 0.2


def test_without_an_imu_there_is_none(laps: Mission) -> None:
    with pytest.raises(DataError, match="the mission has: gnss, heading"):
        guess(blind(laps).without("imu"))
