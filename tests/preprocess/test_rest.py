"""When an IMU is quiet, and the rest that a record begins with."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.mission import Sensor
from gtsam_nav.preprocess.rest import initial_rest, spells_of
from gtsam_nav.series import ImuSeries
from gtsam_nav.simulation import simulate

G_N = np.array([0.0, 0.0, -9.8])


def imu(rest_s: float, moving_s: float, R_bs: Array | None = None) -> Sensor:
    rng = np.random.default_rng(0)
    t = np.arange(0.0, rest_s + moving_s, 0.01)
    shake = np.where(t < rest_s, 0.01, 0.5)[:, None]
    force_b = rotation_from_rpy([0.1, -0.05, 0.0]).T @ G_N
    rotation = np.eye(3) if R_bs is None else R_bs
    series = ImuSeries(
        t=t,
        gyro_i=np.array([0.01, 0.0, -0.002]) + 0.002 * rng.normal(size=(len(t), 3)),
        accel_i=(force_b + shake * rng.normal(size=(len(t), 3))) @ rotation,
    )
    noise = {"gyro_noise_density_rad_s_sqrt_hz": 2e-4, "accel_noise_density_m_s2_sqrt_hz": 1e-3}
    return Sensor("imu", "imu", series, R_bs=rotation, noise=noise)


def test_spells_are_quiet_until_the_vehicle_shakes() -> None:
    spells = spells_of(imu(10.0, 5.0))
    np.testing.assert_array_equal(spells.quiet, spells.t < 10.005)
    np.testing.assert_allclose(np.diff(spells.t), 1.0)


def test_a_rest_is_averaged_along_body_axes() -> None:
    found = initial_rest(imu(10.0, 5.0, rotation_from_rpy([np.pi, 0.0, 0.3])))
    assert found is not None
    np.testing.assert_allclose(
        found.force_b, rotation_from_rpy([0.1, -0.05, 0.0]).T @ G_N, atol=2e-3
    )
    assert np.all(found.sigma_force < 2e-3)
    assert found.spells.t[-1] <= 10.0


@pytest.mark.parametrize("rest_s", [0.0, 1.0])
def test_what_moves_or_hardly_rests_has_no_rest(rest_s: float) -> None:
    assert initial_rest(imu(rest_s, 5.0)) is None


def test_a_single_reading_says_nothing() -> None:
    lone = imu(5.0, 0.0)
    one = Sensor("imu", "imu", lone.series.select(slice(1)))
    assert len(spells_of(one).t) == 0
    assert initial_rest(one) is None


def test_a_smooth_start_ends_the_rest_before_it_shows() -> None:
    submarine = simulate("submarine", seed=0, duration_s=120.0)
    found = initial_rest(submarine.sensors["imu"])
    assert found is not None
    assert 20.0 < found.spells.t[-1] <= 60.0  # it leaves at 60 s
