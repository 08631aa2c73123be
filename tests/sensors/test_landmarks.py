"""Sightings of landmarks: their geometry, their Jacobians, and what has no direction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, rotation_from_rpy, wrap_angle
from gtsam_nav.mission import Sensor
from gtsam_nav.sensors.landmarks import (
    LEAST_SIGMA_M,
    Sighting,
    level_points,
    measurements,
    observe,
    place,
    polar,
    predict,
    sighting,
    trusted_ids,
    variance_factors,
)
from gtsam_nav.sensors.noise import LandmarkNoise
from gtsam_nav.sensors.prediction import BodyState
from gtsam_nav.sensors.settings import LandmarkSettings
from gtsam_nav.series import LandmarkSeries

SERIES = LandmarkSeries(
    t=np.array([0.0, 0.0]),
    id=np.array([4, -1]),
    range_m=np.array([2.0, 3.0]),
    bearing=np.array([0.1, -0.2]),
    sigma_range=np.full(2, 0.1),
    sigma_bearing=np.full(2, 0.02),
)
LEVEL = BodyState(np.eye(3), np.zeros(3), np.zeros(3))
seeds = given(st.integers(0, 2**32 - 1))
both_kinds = pytest.mark.parametrize("elevation", [False, True], ids=["2-D", "3-D"])


def mounted(xyz_b: Array | None = None, rpy: Array | None = None) -> Sensor:
    xyz_b = np.zeros(3) if xyz_b is None else xyz_b
    R_bs = np.eye(3) if rpy is None else rotation_from_rpy(rpy)
    return Sensor("landmarks", "landmarks", SERIES, xyz_b, R_bs)


def drawn(seed: int, tilt: float = 3.0) -> tuple[BodyState, Sensor, np.random.Generator]:
    rng = np.random.default_rng(seed)
    rpy = np.append(rng.uniform(-tilt, tilt, 2), rng.uniform(-3, 3))
    state = BodyState(rotation_from_rpy(rpy), 20 * rng.normal(size=3), rng.normal(size=3))
    mount_rpy = np.append(rng.uniform(-tilt, tilt, 2), rng.uniform(-3, 3))
    return state, mounted(rng.normal(size=3), mount_rpy), rng


def moved(state: BodyState, error: Array) -> BodyState:
    return BodyState(
        state.R_nb @ Rotation.from_rotvec(error[:3]).as_matrix(),
        state.p_n + state.R_nb @ error[3:6],
        state.v_n + state.R_nb @ error[6:],
    )


def seen(rng: np.random.Generator, elevation: bool) -> Sighting:
    up = rng.uniform(-1.2, 1.2) if elevation else None
    return Sighting(rng.uniform(1.0, 30.0), rng.uniform(-3.1, 3.1), up, 0.1, 0.02)


@pytest.mark.parametrize(
    ("landmark_n", "expected"),
    [
        ([5.0, 0.0, 0.0], [5.0, 0.0, 0.0]),
        ([0.0, 5.0, 0.0], [5.0, 90.0, 0.0]),
        ([0.0, -2.0, 0.0], [2.0, -90.0, 0.0]),
        ([3.0, 0.0, -3.0], [np.sqrt(18), 0.0, 45.0]),
        ([0.0, 4.0, 3.0], [5.0, 90.0, -np.degrees(np.arctan2(3, 4))]),
    ],
)
def test_bearings_are_clockwise_from_the_bow_and_elevations_upward(
    landmark_n: list[float], expected: list[float]
) -> None:
    observed = observe(LEVEL, np.array([landmark_n]), mounted(), elevation=True)
    np.testing.assert_allclose(observed.values[0] * [1, *np.degrees([1, 1])], expected, atol=1e-12)


def test_the_planar_case_is_that_of_the_paper() -> None:
    course, p_n, landmark_n = 0.7, np.array([1.0, -2.0, 0.0]), np.array([[4.0, 3.0, 0.0]])
    state = BodyState(rotation_from_rpy([0.0, 0.0, course]), p_n, np.zeros(3))
    observed = observe(state, landmark_n, mounted(), elevation=False)
    dx, dy = (landmark_n[0] - p_n)[:2]
    np.testing.assert_allclose(
        observed.values[0], [np.hypot(dx, dy), np.arctan2(dy, dx) - course], atol=1e-12
    )


def test_the_mounting_counts() -> None:
    sensor = mounted(np.array([1.0, 0.0, 0.0]), np.radians([0.0, 0.0, 90.0]))
    observed = observe(LEVEL, np.array([[1.0, 3.0, 0.0]]), sensor, elevation=False)
    np.testing.assert_allclose(observed.values[0], [3.0, 0.0], atol=1e-12)


@both_kinds
@seeds
def test_jacobians_are_those_of_the_residual(elevation: bool, seed: int) -> None:
    state, sensor, rng = drawn(seed)
    # not so near that the angles have large second derivatives
    offset_s = rng.normal(size=3)
    offset_s *= rng.uniform(3.0, 30.0) / np.hypot(*offset_s[:2])
    landmark_n = state.p_n + state.R_nb @ (sensor.xyz_b + sensor.R_bs @ offset_s)
    measured = seen(rng, elevation)
    prediction = predict(state, landmark_n, measured, sensor)

    def difference(a: Array, b: Array) -> Array:
        change = a - b
        change[1:] = wrap_angle(change[1:])
        return change / 2e-5

    def by_body(error: Array) -> Array:
        return predict(moved(state, error), landmark_n, measured, sensor).residual

    def by_landmark(step: Array) -> Array:
        return predict(state, landmark_n + step, measured, sensor).residual

    numeric = [difference(by_body(e), by_body(-e)) for e in 1e-5 * np.eye(9)]
    np.testing.assert_allclose(prediction.jacobian, np.array(numeric).T, atol=1e-6)
    numeric = [difference(by_landmark(e), by_landmark(-e)) for e in 1e-5 * np.eye(3)]
    np.testing.assert_allclose(prediction.jacobian_landmark, np.array(numeric).T, atol=1e-6)


@seeds
def test_jacobians_of_what_lies_level_with_the_sensor(seed: int) -> None:
    state, sensor, rng = drawn(seed, tilt=0.5)
    angle = rng.uniform(-3, 3)
    landmark_n = state.p_n + 10.0 * np.array([np.cos(angle), np.sin(angle), rng.normal()])

    def values(error: Array, step: Array) -> Array:
        return observe(
            moved(state, error),
            (landmark_n + step)[None],
            sensor,
            elevation=False,
            level=np.array([True]),
        ).values[0]

    observed = observe(state, landmark_n[None], sensor, elevation=False, level=np.array([True]))
    still = np.zeros(9)
    numeric = [values(e, still[:3]) - values(-e, still[:3]) for e in 1e-5 * np.eye(9)]
    numeric = wrap_angle(numeric) / 2e-5
    np.testing.assert_allclose(observed.jacobian_body[0], numeric.T, atol=1e-6)
    numeric = wrap_angle([values(still, e) - values(still, -e) for e in 1e-5 * np.eye(3)]) / 2e-5
    np.testing.assert_allclose(observed.jacobian_landmark[0], numeric.T, atol=1e-6)
    assert not np.any(observed.jacobian_landmark[0, :, 2])


@both_kinds
@seeds
def test_a_placed_landmark_is_seen_where_it_was_seen(elevation: bool, seed: int) -> None:
    state, sensor, rng = drawn(seed, tilt=3.0 if elevation else 0.5)
    measured = seen(rng, elevation)
    placed = place(state, measured, sensor)
    residual = predict(state, placed.p_n, measured, sensor).residual
    np.testing.assert_allclose(residual, 0.0, atol=1e-9)


@both_kinds
@seeds
def test_jacobians_of_the_placement(elevation: bool, seed: int) -> None:
    state, sensor, rng = drawn(seed, tilt=3.0 if elevation else 0.5)
    measured = seen(rng, elevation)
    placed = place(state, measured, sensor)

    def again(values: Array) -> Array:
        up = values[2] if elevation else None
        other = replace(measured, range_m=values[0], bearing=values[1], elevation=up)
        return place(state, other, sensor).p_n

    numeric = [
        (
            place(moved(state, e), measured, sensor).p_n
            - place(moved(state, -e), measured, sensor).p_n
        )
        / 2e-5
        for e in 1e-5 * np.eye(9)
    ]
    np.testing.assert_allclose(placed.jacobian_body, np.array(numeric).T, atol=1e-6)
    values = measured.measured
    numeric = [(again(values + e) - again(values - e)) / 2e-5 for e in 1e-5 * np.eye(len(values))]
    np.testing.assert_allclose(placed.jacobian_sighting, np.array(numeric).T, atol=1e-6)


@both_kinds
@pytest.mark.parametrize("bearing", [np.pi - 0.01, -np.pi + 0.01])
def test_bearings_wrap_behind_the_vehicle(elevation: bool, bearing: float) -> None:
    up = 0.0 if elevation else None
    measured = Sighting(4.0, bearing, up, 0.1, 0.02)
    behind = 4.0 * np.array([-np.cos(0.02), -np.sin(0.02) * np.sign(bearing), 0.0])
    residual = predict(LEVEL, behind, measured, mounted()).residual
    assert abs(residual[1]) == pytest.approx(0.03)


@both_kinds
@pytest.mark.parametrize("distance_m", [0.0, 1e-9, 1e-4])
def test_a_landmark_at_no_distance_has_no_bearing(elevation: bool, distance_m: float) -> None:
    up = 0.3 if elevation else None
    measured = Sighting(0.5, 1.0, up, 0.1, 0.02)
    prediction = predict(LEVEL, np.array([distance_m, 0.0, 0.0]), measured, mounted())
    for values in (prediction.residual, prediction.jacobian, prediction.jacobian_landmark):
        np.testing.assert_array_equal(values[1:], 0.0)
        assert np.all(np.isfinite(values))


def test_a_centimetre_away_it_has_one() -> None:
    observed = observe(LEVEL, np.array([[0.0, 0.01, 0.0]]), mounted(), elevation=True)
    np.testing.assert_allclose(observed.values, [[0.01, np.pi / 2, 0.0]])
    np.testing.assert_allclose(
        observed.jacobian_landmark[0], [[0, 1, 0], [-100, 0, 0], [0, 0, -100]], atol=1e-12
    )


def test_a_landmark_overhead_has_range_and_elevation_but_no_bearing() -> None:
    measured = Sighting(5.0, 1.0, 1.5, 0.1, 0.02)
    prediction = predict(LEVEL, np.array([0.0, 0.0, -5.0]), measured, mounted())
    np.testing.assert_allclose(prediction.jacobian_landmark[0], [0, 0, -1])
    np.testing.assert_array_equal(prediction.jacobian_landmark[1:], 0.0)
    assert np.all(np.isfinite(prediction.residual))


@both_kinds
def test_a_sighting_at_zero_range_lies_at_the_sensor(elevation: bool) -> None:
    state, sensor, _ = drawn(3, tilt=0.3)
    measured = Sighting(0.0, 1.0, 0.2 if elevation else None, 0.1, 0.02)
    placed = place(state, measured, sensor)
    np.testing.assert_allclose(placed.p_n, state.p_n + state.R_nb @ sensor.xyz_b)
    np.testing.assert_array_equal(placed.jacobian_sighting[:, 1:], 0.0)
    assert np.linalg.norm(placed.jacobian_sighting[:, 0]) == pytest.approx(1.0)


def test_a_sample_of_a_series_is_a_sighting() -> None:
    first = sighting(SERIES, 0)
    assert (first.range_m, first.bearing, first.elevation) == (2.0, 0.1, None)
    np.testing.assert_allclose(first.cov, np.diag([0.1**2, 0.02**2]))
    with_elevation = sighting(replace(SERIES, elevation=np.array([0.3, 0.0])), 0)
    np.testing.assert_allclose(with_elevation.measured, [2.0, 0.1, 0.3])
    np.testing.assert_allclose(with_elevation.cov, np.diag([0.1**2, 0.02**2, 0.02**2]))


@seeds
def test_ranges_of_a_wrong_scale_are_longer_by_their_share(seed: int) -> None:
    state, sensor, rng = drawn(seed)
    landmark_n, measured = state.p_n + 10 * rng.normal(size=3), seen(rng, elevation=True)
    plain = predict(state, landmark_n, measured, sensor)
    long = predict(state, landmark_n, measured, sensor, range_scale=0.02)
    distance_m = plain.residual[0] + measured.measured[0]
    np.testing.assert_allclose(long.residual - plain.residual, [0.02 * distance_m, 0, 0], atol=1e-9)
    np.testing.assert_allclose(long.jacobian_scale, [distance_m, 0, 0])
    np.testing.assert_allclose(plain.jacobian_scale, [distance_m, 0, 0])
    stretch = np.array([[1.02], [1.0], [1.0]])
    np.testing.assert_allclose(long.jacobian, stretch * plain.jacobian)
    np.testing.assert_allclose(long.jacobian_landmark, stretch * plain.jacobian_landmark)


@pytest.mark.parametrize(
    ("range_m", "bearing", "elevation", "rows"),
    [
        (5.0, None, None, [0]),
        (None, 0.4, None, [1]),
        (None, 0.4, 0.2, [1, 2]),
        (5.0, None, 0.2, [0, 2]),
        (5.0, 0.4, 0.2, [0, 1, 2]),
    ],
)
def test_a_sighting_says_only_what_it_measured(
    range_m: float | None, bearing: float | None, elevation: float | None, rows: list[int]
) -> None:
    measured = Sighting(range_m, bearing, elevation, 0.3, 0.05)
    whole = predict(LEVEL, np.array([3.0, 4.0, 1.0]), Sighting(5.0, 0.4, 0.2, 0.3, 0.05), mounted())
    some = predict(LEVEL, np.array([3.0, 4.0, 1.0]), measured, mounted())
    np.testing.assert_array_equal(measured.rows, rows)
    np.testing.assert_allclose(measured.measured, np.array([5.0, 0.4, 0.2])[rows])
    np.testing.assert_allclose(some.residual, whole.residual[rows])
    np.testing.assert_allclose(some.jacobian, whole.jacobian[rows])
    np.testing.assert_allclose(np.diag(some.cov), np.square([0.3, 0.05, 0.05])[rows])


@pytest.mark.parametrize(("range_m", "bearing"), [(None, 0.4), (5.0, None)])
def test_a_range_or_a_bearing_alone_places_nothing(
    range_m: float | None, bearing: float | None
) -> None:
    with pytest.raises(DataError, match="does not tell where"):
        place(LEVEL, Sighting(range_m, bearing, None, 0.1, 0.02), mounted())


@pytest.mark.parametrize(
    ("column", "lacking"), [("range_m", "range"), ("bearing", "bearing")], ids=["range", "bearing"]
)
def test_a_series_of_one_kind_has_no_polar_columns(column: str, lacking: str) -> None:
    sigma = {"range_m": "sigma_range", "bearing": "sigma_bearing"}[column]
    with pytest.raises(DataError, match=f"without a {lacking} cannot"):
        polar(replace(SERIES, **{column: None, sigma: None}))


@both_kinds
def test_the_measurements_of_a_series_are_those_of_its_sightings(elevation: bool) -> None:
    series = replace(SERIES, elevation=np.array([0.3, 0.7])) if elevation else SERIES
    values, cov = measurements(series)
    for k in range(2):
        np.testing.assert_allclose(values[k], sighting(series, k).measured)
        np.testing.assert_allclose(cov[k], sighting(series, k).cov)


@both_kinds
def test_level_points_lie_below_what_was_seen(elevation: bool) -> None:
    sensor = mounted(np.array([0.5, -0.3, 0.2]), np.array([0.2, -0.3, 2.0]))
    series = replace(SERIES, elevation=np.array([0.3, -0.7])) if elevation else SERIES
    points, cov = level_points(series, sensor)
    for k in range(2):
        up, bearing, range_m = (0.3, -0.7)[k] * elevation, SERIES.bearing[k], SERIES.range_m[k]
        p_s = range_m * np.array(
            [np.cos(up) * np.cos(bearing), np.cos(up) * np.sin(bearing), -np.sin(up)]
        )
        offset_b = (sensor.R_bs @ p_s)[:2]
        np.testing.assert_allclose(points[k], sensor.xyz_b[:2] + offset_b)
        along = offset_b / np.linalg.norm(offset_b)
        aside = np.array([-along[1], along[0]])
        wanted = 0.1**2 * np.outer(along, along) + (0.02 * range_m) ** 2 * np.outer(aside, aside)
        np.testing.assert_allclose(cov[k], wanted)


def test_a_level_point_at_the_sensor_still_has_a_spread() -> None:
    points, cov = level_points(replace(SERIES, range_m=np.zeros(2)), mounted())
    np.testing.assert_array_equal(points, 0.0)
    np.testing.assert_allclose(np.linalg.eigvalsh(cov), [[LEAST_SIGMA_M**2, 0.1**2]] * 2)
    overhead = replace(SERIES, elevation=np.full(2, np.pi / 2), bearing=np.zeros(2))
    assert np.all(np.isfinite(level_points(overhead, mounted())[1]))


def test_ids_are_trusted_where_the_association_goes_by_them() -> None:
    np.testing.assert_array_equal(trusted_ids(SERIES, LandmarkSettings()), [4, -1])
    np.testing.assert_array_equal(
        trusted_ids(SERIES, LandmarkSettings(association="nearest")), [-1, -1]
    )


def test_the_gate_of_a_new_landmark_is_the_wider_one() -> None:
    settings = LandmarkSettings()
    assert 0.5 < settings.gate_probability < settings.new_probability < 1.0
    assert settings.use_map
    for gate in ("gate_probability", "new_probability"):
        for impossible in (0.0, 1.0):
            with pytest.raises(ValidationError, match=gate):
                LandmarkSettings.model_validate({gate: impossible})
        LandmarkSettings.model_validate({gate: 1e-9})


def test_variance_grows_as_that_of_a_mean_of_correlated_values() -> None:
    """The factors are rows of the correlation matrix: one plus twice the sum before each."""
    t = np.array([0.0, 0.5, 2.0, 2.0, 9.0])
    noise = LandmarkNoise(correlated_share=0.4, correlation_time_s=2.5)
    correlation = 0.4 * np.exp(-np.abs(t[:, None] - t) / 2.5)
    wanted = [1.0 + 2.0 * correlation[k, :k].sum() for k in range(5)]
    np.testing.assert_allclose(variance_factors(t, noise), wanted)
    np.testing.assert_array_equal(variance_factors(t, LandmarkNoise()), 1.0)
    assert len(variance_factors(np.empty(0), noise)) == 0
