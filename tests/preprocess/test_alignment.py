"""How the estimate begins: what each sensor gives, and what stands in where one is missing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, rotation_from_rpy
from gtsam_nav.mission import InitialState, Mission, Sensor
from gtsam_nav.preprocess.alignment import UNKNOWN_SIGMA_M, align, at_rest, level_at_rest
from gtsam_nav.sensors.depth import DIVING_M_S
from gtsam_nav.sensors.orientation import UNMEASURED_TILT_SIGMA_RAD
from gtsam_nav.series import (
    AttitudeSeries,
    DepthSeries,
    GnssSeries,
    HeadingSeries,
    ImuSeries,
    ReferenceSeries,
    Series,
)

T = np.arange(100.0, 110.0, 0.1)
RPY = np.array([0.1, -0.05, 0.8])
G_M_S2 = 9.8


def same(value: Any) -> Array:
    return np.tile(value, (len(T), 1)) if np.ndim(value) else np.full(len(T), value)


def imu(rpy: Array = RPY, R_bi: Array | None = None, t: Array = T, shake: float = 0.0) -> Sensor:
    """An IMU at rest in an attitude, or one whose readings shake."""
    R_bi = rotation_from_rpy([0.2, 0.3, -2.0]) if R_bi is None else R_bi
    rng = np.random.default_rng(0)
    force_i = R_bi.T @ rotation_from_rpy(rpy).T @ [0.0, 0.0, -G_M_S2]
    noise = rng.normal(size=(len(t), 3))
    series = ImuSeries(
        t=t, gyro_i=np.array([0.01, -0.02, 0.011]) + 1e-3 * noise, accel_i=force_i + shake * noise
    )
    return Sensor("imu", "imu", series, R_bs=R_bi)


def sensors() -> dict[str, Sensor]:
    series: Mapping[str, Series] = {
        "heading": HeadingSeries(t=T, heading=same(RPY[2] + 2 * np.pi), sigma=same(0.02)),
        "attitude": AttitudeSeries(t=T, roll=same(RPY[0]), pitch=same(RPY[1]), sigma=same(0.01)),
        "depth": DepthSeries(t=T, depth_m=same(2.0), sigma=same(0.05)),
        "gnss": GnssSeries(t=T, p_n=same([10.0, 20.0, -30.0]), sigma=same([1.0, 1.5, 4.0])),
    }
    levers = {"depth": [0.5, 0.2, 0.4], "gnss": [-0.4, 0.1, -2.3]}
    return {
        name: Sensor(name, name, one, xyz_b=np.array(levers.get(name, [0.0, 0.0, 0.0])))
        for name, one in series.items()
    }


def mission(*left_out: str, initial: InitialState | None = None) -> Mission:
    return Mission("m", sensors(), initial=initial or InitialState()).without(*left_out)


def test_every_sensor_says_what_it_knows() -> None:
    start = align(mission())
    R_nb = rotation_from_rpy(RPY)
    assert start.t == 100.0
    assert start.georeferenced
    np.testing.assert_allclose(start.rpy, RPY, atol=1e-12)
    np.testing.assert_allclose(start.R_nb, R_nb, atol=1e-12)
    np.testing.assert_allclose(start.sigma_rpy, [0.01, 0.01, 0.02])
    antenna_n, gauge_n = R_nb @ [-0.4, 0.1, -2.3], R_nb @ [0.5, 0.2, 0.4]
    np.testing.assert_allclose(start.p_n[:2], [10.0, 20.0] - antenna_n[:2])
    assert start.p_n[2] == pytest.approx(2.0 - gauge_n[2])
    np.testing.assert_allclose(start.sigma_p, [1.0, 1.5, 0.05])


def test_what_the_mission_states_comes_first() -> None:
    stated = InitialState(np.array([1.0, 2.0, 3.0]), 0.3, heading=-1.0, sigma_heading=0.2)
    start = align(mission("depth", initial=stated))
    np.testing.assert_array_equal(start.p_n, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(start.sigma_p, [0.3] * 3)
    assert (start.rpy[2], start.sigma_rpy[2]) == (-1.0, 0.2)
    assert start.georeferenced
    start.p_n[0] = 99.0  # a copy
    assert stated.p_n is not None
    assert stated.p_n[0] == 1.0


def test_without_fixes_the_frame_is_local() -> None:
    start = align(mission("gnss", "depth"))
    assert not start.georeferenced
    np.testing.assert_array_equal(start.p_n, np.zeros(3))
    np.testing.assert_array_equal(start.sigma_p, [UNKNOWN_SIGMA_M] * 3)


def velocities_alone() -> Sensor:
    """A receiver that states its positions to be useless."""
    series = GnssSeries(t=T, p_n=same([0.0] * 3), sigma=same([2e4] * 3), v_n=same([0.0] * 3))
    return Sensor("doppler", "gnss", series)


def test_a_receiver_of_velocities_alone_tells_no_place() -> None:
    alone = mission("gnss", "depth").with_sensor(velocities_alone())
    assert not align(alone).georeferenced
    np.testing.assert_array_equal(align(alone).sigma_p, [UNKNOWN_SIGMA_M] * 3)
    beside = alone.with_sensor(sensors()["gnss"])
    assert align(beside).georeferenced
    np.testing.assert_array_equal(align(beside).p_n, align(mission("depth")).p_n)


def test_without_depth_the_fix_has_the_height() -> None:
    start = align(mission("depth"))
    R_nb = rotation_from_rpy(RPY)
    np.testing.assert_allclose(start.p_n, [10.0, 20.0, -30.0] - R_nb @ [-0.4, 0.1, -2.3])
    np.testing.assert_allclose(start.sigma_p, [1.0, 1.5, 4.0])


def test_a_late_first_fix_is_only_near_the_start() -> None:
    whole = mission()
    late = whole.with_sensor(
        replace(whole.sensors["gnss"], series=whole.sensors["gnss"].series.crop(107.0, 200.0))
    )
    start = align(late)
    assert start.t == 100.0
    assert np.all(start.sigma_p[:2] > 4.0)
    punctual = whole.with_sensor(
        replace(whole.sensors["gnss"], series=whole.sensors["gnss"].series.crop(101.0, 200.0))
    )
    np.testing.assert_allclose(align(punctual).sigma_p[:2], [1.0, 1.5])


def test_without_a_compass_the_local_frame_is_the_vehicles_own() -> None:
    start = align(mission("heading"))
    assert start.rpy[2] == 0.0
    assert start.sigma_rpy[2] == pytest.approx(1e-3)


def test_declination_is_applied() -> None:
    whole = mission()
    magnetic = replace(whole.sensors["heading"], noise={"declination_deg": -3.0})
    assert align(whole.with_sensor(magnetic)).rpy[2] == pytest.approx(RPY[2] - np.radians(3.0))


def test_empty_sensors_are_as_good_as_none() -> None:
    whole = mission()
    hollow = Mission(
        "m",
        {name: replace(s, series=s.series.select(slice(0))) for name, s in sensors().items()}
        | {"imu": imu()},
    )
    start = align(hollow)
    assert not start.georeferenced
    np.testing.assert_allclose(start.rpy[:2], RPY[:2], atol=0.002)  # levelled by the IMU
    for name in sensors():
        one = whole.with_sensor(hollow.sensors[name])
        np.testing.assert_array_equal(align(one).p_n, align(whole.without(name)).p_n)


def test_one_sample_each_is_enough() -> None:
    brief = Mission(
        "m",
        {name: replace(s, series=s.series.select(slice(1))) for name, s in sensors().items()}
        | {"imu": imu()},
    )
    np.testing.assert_allclose(align(brief).p_n, align(mission()).p_n)
    np.testing.assert_allclose(align(brief).rpy, align(mission()).rpy)


@pytest.mark.parametrize("samples", [0, 1])
def test_a_mission_without_a_span_is_refused(samples: int) -> None:
    depth = sensors()["depth"]
    one = replace(depth, series=depth.series.select(slice(samples)))
    with pytest.raises(DataError, match="mission 'm' has no span in time to estimate over"):
        align(Mission("m", {"depth": one}))


def test_the_reference_is_never_read() -> None:
    truth = ReferenceSeries(t=T - 50.0, p_n=same([7.0, 7.0, 7.0]), rpy=same([1.0, 1.0, 1.0]))
    seen = align(mission("gnss", "heading").with_sensor(Sensor("truth", "reference", truth)))
    unseen = align(mission("gnss", "heading"))
    assert seen.t == unseen.t
    np.testing.assert_array_equal(seen.p_n, unseen.p_n)
    np.testing.assert_array_equal(seen.rpy, unseen.rpy)


def test_a_depth_gauge_that_wakes_late_tells_little_of_the_start() -> None:
    late = sensors()
    gauge = late["depth"]
    late["depth"] = replace(gauge, series=gauge.series.crop(104.0, 110.0))
    start = align(Mission("late", late))
    assert start.sigma_p[2] == pytest.approx(DIVING_M_S * 4.0, rel=0.05)


@pytest.mark.parametrize("rpy", [RPY, np.zeros(3), np.array([-0.4, 0.3, 2.0])])
def test_a_vehicle_at_rest_is_levelled_by_gravity(rpy: Array) -> None:
    one = Mission("m", {"imu": imu(rpy)})
    assert at_rest(one, 100.0)
    levelled = level_at_rest(one, 100.0)
    assert levelled is not None
    np.testing.assert_allclose(levelled, rpy[:2], atol=1e-9)
    start = align(one)
    np.testing.assert_allclose(start.rpy[:2], rpy[:2], atol=1e-9)
    np.testing.assert_allclose(start.sigma_rpy[:2], np.radians(1.0))


def test_an_ahrs_beats_levelling() -> None:
    one = mission().with_sensor(imu(np.array([0.5, 0.5, 0.0])))
    np.testing.assert_allclose(align(one).rpy[:2], RPY[:2], atol=1e-12)


def turning() -> Sensor:
    still = imu()
    assert isinstance(still.series, ImuSeries)
    swing = 0.2 * np.sin(2 * np.pi * T)[:, None]
    return replace(still, series=replace(still.series, gyro_i=still.series.gyro_i + swing))


def falling() -> Sensor:
    still = imu()
    assert isinstance(still.series, ImuSeries)
    return replace(still, series=replace(still.series, accel_i=0.9 * still.series.accel_i))


@pytest.mark.parametrize(
    "restless",
    [imu(shake=0.5), turning(), falling(), imu(t=T[:4]), imu(t=T + 50.0)],
    ids=["shaken", "turning", "wrong force", "too few samples", "too late"],
)
def test_a_vehicle_that_may_move_is_not_levelled(restless: Sensor) -> None:
    one = Mission("m", {"imu": restless, "depth": sensors()["depth"]})
    assert not at_rest(one, 100.0)
    assert level_at_rest(one, 100.0) is None
    start = align(one)
    np.testing.assert_array_equal(start.rpy, np.zeros(3))
    np.testing.assert_allclose(start.sigma_rpy[:2], UNMEASURED_TILT_SIGMA_RAD)


def test_without_an_imu_nothing_is_known_of_rest() -> None:
    assert not at_rest(mission(), 100.0)
    assert level_at_rest(mission(), 100.0) is None
