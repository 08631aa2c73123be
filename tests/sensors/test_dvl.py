"""Which DVL samples count, and what velocity they state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.mission import Sensor
from gtsam_nav.sensors.dvl import body_velocities, water_spells
from gtsam_nav.series import BoolArray, DvlSeries

STILL = np.zeros(3)
LIMIT_S = 10.0


def dvl(
    bottom: BoolArray, water: BoolArray | None = None, v_d: Array | None = None, **mounting: Array
) -> Sensor:
    """One sample a second; what has neither lock is invalid."""
    n = len(bottom)
    series = DvlSeries(
        t=np.arange(float(n)),
        v_d=np.zeros((n, 3)) if v_d is None else v_d,
        sigma=np.full(n, 0.03),
        valid=bottom | (~bottom if water is None else water),
        bottom_lock=bottom,
    )
    return Sensor("dvl", "dvl", series, noise={"water_sigma_m_s": 0.4}, **mounting)


def lost(n: int, *spells: tuple[int, int]) -> BoolArray:
    """Bottom lock but in the spells from a to b, b not included."""
    bottom = np.ones(n, dtype=bool)
    for a, b in spells:
        bottom[a:b] = False
    return bottom


def test_mounting_and_lever_arm_lead_to_the_bodys_origin() -> None:
    R_bd, xyz_b = rotation_from_rpy([np.pi, 0.0, 0.7]), np.array([1.0, 0.2, 0.4])
    v_b, omega_b = np.array([0.5, -0.1, 0.05]), np.array([0.1, -0.2, 0.3])
    v_d = R_bd.T @ (v_b + np.cross(omega_b, xyz_b))
    sensor = dvl(lost(4), v_d=np.tile(v_d, (4, 1)), xyz_b=xyz_b, R_bs=R_bd)
    found = body_velocities(sensor, np.tile(omega_b, (4, 1)), LIMIT_S)
    np.testing.assert_allclose(found.v_b, np.tile(v_b, (4, 1)), atol=1e-15)
    assert found.sensor == "dvl"
    assert not found.by_wheels
    assert found.rejections == ()


def test_a_short_gap_is_left_to_the_motion_model() -> None:
    bottom = lost(30, (10, 15))
    found = body_velocities(dvl(bottom), np.tile(STILL, (30, 1)), LIMIT_S)
    np.testing.assert_array_equal(found.row, np.flatnonzero(bottom))
    np.testing.assert_array_equal(found.sigma, 0.03)
    assert [(r.index, r.reason) for r in found.rejections] == [
        (k, "water lock in a short gap") for k in range(10, 15)
    ]


def test_water_lock_counts_where_bottom_lock_stays_away() -> None:
    bottom = lost(60, (10, 30), (40, 42))
    found = body_velocities(dvl(bottom), np.tile(STILL, (60, 1)), LIMIT_S)
    np.testing.assert_array_equal(found.row, np.setdiff1d(np.arange(60), [40, 41]))
    water = np.isin(found.row, np.arange(10, 30))
    np.testing.assert_allclose(found.sigma[water], np.hypot(0.03, 0.4))
    np.testing.assert_array_equal(found.sigma[~water], 0.03)


@pytest.mark.parametrize(("gap_s", "bridged"), [(10, True), (11, False)])
def test_the_limit_is_the_time_between_bottom_locks(gap_s: int, bridged: bool) -> None:
    bottom = lost(40, (10, 10 + gap_s - 1))
    found = body_velocities(dvl(bottom), np.tile(STILL, (40, 1)), LIMIT_S)
    assert len(found) == (40 - gap_s + 1 if bridged else 40)


def test_a_log_that_begins_or_ends_without_bottom_lock_uses_the_water() -> None:
    bottom = lost(30, (0, 3), (27, 30))
    found = body_velocities(dvl(bottom), np.tile(STILL, (30, 1)), LIMIT_S)
    assert len(found) == 30
    all_water = body_velocities(dvl(lost(30, (0, 30))), np.tile(STILL, (30, 1)), LIMIT_S)
    assert len(all_water) == 30


def test_without_any_lock_nothing_is_measured() -> None:
    bottom = lost(30, (10, 30))
    found = body_velocities(dvl(bottom, water=bottom), np.tile(STILL, (30, 1)), LIMIT_S)
    np.testing.assert_array_equal(found.row, np.arange(10))
    assert {r.reason for r in found.rejections} == {"no lock"}
    assert [r.index for r in found.rejections] == list(range(10, 30))
    assert [r.t for r in found.rejections] == list(range(10, 30))


def test_a_wrong_sound_speed_is_put_right() -> None:
    """Doppler shifts are of speeds as fractions of the sound's."""
    bottom = np.ones(3, dtype=bool)
    plain = dvl(bottom, v_d=np.full((3, 3), 1.5), xyz_b=np.array([1.0, 0.0, 0.0]))
    sounds = {"assumed_sound_speed_m_s": 1500.0, "sound_speed_m_s": 1530.0}
    corrected = replace(plain, noise={**plain.noise, **sounds})
    omega_b = np.tile([0.0, 0.0, 0.2], (3, 1))
    before, after = (body_velocities(d, omega_b, LIMIT_S).v_b for d in (plain, corrected))
    np.testing.assert_allclose(after - before, 0.02 * 1.5)


def test_spells_of_water_lock_last_until_the_bottom_is_back() -> None:
    bottom = lost(60, (5, 9), (20, 35), (40, 60))
    spells = water_spells([dvl(bottom)], LIMIT_S)
    np.testing.assert_array_equal(spells, [[20.0, 34.0], [40.0, 59.0]])
    assert water_spells([dvl(np.ones(9, dtype=bool))], LIMIT_S).shape == (0, 2)
    np.testing.assert_array_equal(water_spells([dvl(lost(60, (1, 60)))], LIMIT_S), [[1.0, 59.0]])
