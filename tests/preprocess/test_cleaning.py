"""Every sample becomes part of a valid series or a rejection with a reason."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtsam_nav.mission import Rejection
from gtsam_nav.preprocess.cleaning import main_stretch, tidy
from gtsam_nav.series import (
    AttitudeSeries,
    BeamSeries,
    DepthSeries,
    DvlSeries,
    GnssSeries,
    HeadingSeries,
    ImuSeries,
    LandmarkSeries,
    OdometrySeries,
    ReferenceSeries,
    Series,
)

ROW_TYPES: list[type[Series]] = [
    ImuSeries,
    DvlSeries,
    OdometrySeries,
    GnssSeries,
    DepthSeries,
    HeadingSeries,
    AttitudeSeries,
    LandmarkSeries,
    ReferenceSeries,
]


def depths(t: Any, depth: Any = 1.0, sigma: Any = 0.1) -> dict[str, Any]:
    t = np.asarray(t, float)
    return {"t": t, "depth_m": np.broadcast_to(depth, t.shape), "sigma": np.full(t.shape, sigma)}


def dvl(n: int = 4, **changes: Any) -> dict[str, Any]:
    columns = {
        "t": np.arange(n, dtype=float),
        "v_d": np.tile([0.2, 0.1, 0.0], (n, 1)),
        "sigma": np.full(n, 0.05),
        "valid": np.ones(n),
        "bottom_lock": np.ones(n),
    }
    return columns | changes


def reasons(rejections: list[Rejection]) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {}
    for rejection in rejections:
        found.setdefault(rejection.reason, []).append(rejection.index)
    return found


def test_clean_columns_pass_untouched() -> None:
    series, rejections = tidy(DepthSeries, "depth", depths([0, 1, 2], [1.0, 2.0, 3.0]))
    assert series is not None
    assert rejections == []
    np.testing.assert_array_equal(series.depth_m, [1, 2, 3])
    np.testing.assert_array_equal(series.row, [0, 1, 2])


def test_samples_out_of_order_are_sorted_and_keep_their_row() -> None:
    series, rejections = tidy(DepthSeries, "depth", depths([0, 2, 1, 3], [0.0, 2.0, 1.0, 3.0]))
    assert series is not None
    assert rejections == []
    np.testing.assert_array_equal(series.t, [0, 1, 2, 3])
    np.testing.assert_array_equal(series.depth_m, [0, 1, 2, 3])
    np.testing.assert_array_equal(series.row, [0, 2, 1, 3])


def test_what_is_not_finite_is_dropped_by_column() -> None:
    columns = depths([0, np.nan, 2, 3, 4], [1.0, 1.0, np.inf, 1.0, 1.0])
    columns["sigma"] = np.array([0.1, 0.1, 0.1, np.nan, 0.1])
    series, rejections = tidy(DepthSeries, "depth", columns)
    assert series is not None
    np.testing.assert_array_equal(series.row, [0, 4])
    assert reasons(rejections) == {
        "non-finite t": [1],
        "non-finite depth_m": [2],
        "non-finite sigma": [3],
    }


def test_repeats_and_contradictions_are_told_apart() -> None:
    columns = depths([0, 1, 1, 1, 2], [0.0, 1.0, 1.0, 5.0, 2.0])
    series, rejections = tidy(DepthSeries, "depth", columns)
    assert series is not None
    np.testing.assert_array_equal(series.depth_m, [0, 1, 2])
    assert reasons(rejections) == {"repeated sample": [2], "duplicate stamp": [3]}


def test_landmarks_share_stamps_but_do_not_repeat() -> None:
    columns = {
        "t": np.array([0.0, 1.0, 1.0, 1.0]),
        "id": np.array([4.0, 4.0, 5.0, 4.0]),
        "range_m": np.array([9.0, 9.0, 3.0, 9.0]),
        "bearing": np.zeros(4),
        "sigma_range": np.full(4, 0.1),
        "sigma_bearing": np.full(4, 0.1),
    }
    series, rejections = tidy(LandmarkSeries, "landmarks", columns)
    assert series is not None
    np.testing.assert_array_equal(series.id, [4, 4, 5])
    assert reasons(rejections) == {"repeated sample": [3]}


@pytest.mark.parametrize(
    ("displaced", "jump_s"),
    [
        (slice(0, 3), 7200.0),
        (slice(40, 43), 7200.0),
        (slice(40, 43), -7200.0),
        (slice(97, 100), -7200.0),
    ],
)
def test_stamps_hours_away_are_dropped_even_inside_a_long_mission(
    displaced: slice, jump_s: float
) -> None:
    t = 20_000.0 + 600.0 * np.arange(100)
    t[displaced] += jump_s
    series, rejections = tidy(DepthSeries, "depth", depths(t))
    assert series is not None
    assert reasons(rejections) == {"clock jump": list(range(100))[displaced]}


def test_a_pause_is_no_clock_jump() -> None:
    t = np.concatenate([np.arange(50.0), 9000.0 + np.arange(10.0)])
    series, rejections = tidy(GnssSeries, "gnss", gnss(t))
    assert series is not None
    assert len(series) == 60
    assert rejections == []


def gnss(t: Any) -> dict[str, Any]:
    t = np.asarray(t, float)
    return {"t": t, "p_n": np.zeros((len(t), 3)), "sigma": np.ones((len(t), 3))}


def test_fixes_that_jump_are_left_to_the_estimators() -> None:
    columns = gnss([0, 1, 2])
    columns["p_n"][1] = [5000.0, 0.0, 0.0]
    series, rejections = tidy(GnssSeries, "gnss", columns)
    assert series is not None
    assert len(series) == 3
    assert rejections == []


@pytest.mark.parametrize(
    ("series_type", "columns", "reason"),
    [
        (DvlSeries, dvl(v_d=np.tile([0.1, 9.0, 0.0], (4, 1))), "implausible speed"),
        (DvlSeries, dvl(sigma=np.full(4, -0.1)), "implausible sigma"),
        (DepthSeries, depths([0, 1], 40_000.0), "implausible depth_m"),
        (DepthSeries, depths([0, 1], sigma=0.0), "implausible sigma"),
        (
            HeadingSeries,
            {"t": [0.0], "heading": [570.0], "sigma": [0.1]},
            "implausible heading",
        ),
    ],
)
def test_what_no_vehicle_does_is_dropped(
    series_type: type[Series], columns: dict[str, Any], reason: str
) -> None:
    series, rejections = tidy(series_type, "x", columns, max_speed_m_s=5.0)
    assert series is None
    assert {r.reason for r in rejections} == {reason}
    assert len(rejections) == len(columns["t"])


def test_an_exact_truth_may_state_no_error() -> None:
    columns = {"t": [0.0], "p_n": np.zeros((1, 3)), "sigma": [0.0]}
    series, rejections = tidy(ReferenceSeries, "truth", columns)
    assert series is not None
    assert rejections == []


def test_invalid_dvl_samples_stay_and_become_finite() -> None:
    columns = dvl(valid=np.array([1.0, 0.0, 0.0, 1.0]), altitude_m=[2.0, np.nan, 3.0, np.nan])
    columns["v_d"][1] = np.nan
    columns["v_d"][2] = [99.0, 0.0, 0.0]
    columns["sigma"][1:3] = [np.nan, -1.0]
    series, rejections = tidy(DvlSeries, "dvl", columns, max_speed_m_s=5.0)
    assert series is not None
    assert rejections == []
    np.testing.assert_array_equal(series.valid, [True, False, False, True])
    np.testing.assert_array_equal(series.v_d[1], 0.0)
    assert np.all(series.sigma > 0)
    assert series.altitude_m is not None
    np.testing.assert_array_equal(series.altitude_m, [2, 0, 3, 0])


def test_valid_dvl_samples_must_be_finite() -> None:
    columns = dvl()
    columns["v_d"][2, 1] = np.nan
    series, rejections = tidy(DvlSeries, "dvl", columns)
    assert series is not None
    assert reasons(rejections) == {"non-finite v_d": [2]}


def test_a_dvl_without_any_valid_sample_is_none() -> None:
    series, rejections = tidy(DvlSeries, "dvl", dvl(valid=np.zeros(4)))
    assert series is None
    assert reasons(rejections) == {"no valid sample": [0, 1, 2, 3]}


def test_an_optional_column_of_nothing_is_absent() -> None:
    columns = gnss([0, 1]) | {"v_n": np.full((2, 3), np.nan)}
    series, rejections = tidy(GnssSeries, "gnss", columns)
    assert series is not None
    assert series.v_n is None
    assert rejections == []


def test_reasons_of_the_format_come_first() -> None:
    columns = depths([0, 1, np.nan])
    refused = {"no reading": np.array([False, True, True])}
    series, rejections = tidy(DepthSeries, "depth", columns, refused=refused)
    assert series is not None
    assert reasons(rejections) == {"no reading": [1, 2]}


def test_beams_keep_their_profiles_together() -> None:
    columns = {
        "t": [1.0, 0.0, 0.0],
        "angle": [0.1, 0.0, 0.0],
        "intensity": np.array([[1, 2], [3, 4], [3, 5]], dtype=np.uint8),
    }
    series, rejections = tidy(BeamSeries, "sonar", columns, resolution_m=0.2)
    assert series is not None
    assert series.resolution_m == 0.2
    np.testing.assert_array_equal(series.intensity, [[3, 4], [1, 2]])
    assert reasons(rejections) == {"duplicate stamp": [2]}


def test_the_main_stretch_is_where_most_sensors_are() -> None:
    dive = np.arange(0.0, 10_000.0)
    surfacing = np.concatenate([np.arange(0.0, 60.0), np.arange(9900.0, 9960.0)])
    jumped = np.concatenate([np.arange(5.0), dive + 1e9])
    assert main_stretch([dive, surfacing, jumped]) == (0.0, 9999.0)


numbers = st.one_of(
    st.floats(-10, 10),
    st.sampled_from([np.nan, np.inf, -np.inf, 0.0, 1e300, -1e300, 1e9, 7200.0, 5e-324]),
)


@st.composite
def raw_columns(draw: st.DrawFn) -> tuple[type[Series], dict[str, Any]]:
    series_type = draw(st.sampled_from(ROW_TYPES))
    n = draw(st.integers(0, 12))
    columns = {}
    for name, spec in series_type.column_specs().items():
        # readers give every measurement its sigma
        is_sigma = name in ("sigma_range", "sigma_bearing")
        if name == "row" or (spec["optional"] and not is_sigma and draw(st.booleans())):
            continue
        size = int(np.prod((n, *spec["shape"])))
        values = draw(st.lists(numbers, min_size=size, max_size=size))
        columns[name] = np.array(values, dtype=float).reshape(n, *spec["shape"])
    return series_type, columns


@given(raw_columns())
def test_nothing_gets_lost_and_nothing_raises(raw: tuple[type[Series], dict[str, Any]]) -> None:
    series_type, columns = raw
    series, rejections = tidy(series_type, "x", columns, max_speed_m_s=5.0)
    kept = [] if series is None else series.row.tolist()
    counts = Counter([*kept, *(r.index for r in rejections)])
    assert counts == Counter(range(len(columns["t"])))
    assert all(r.reason and r.sensor == "x" for r in rejections)


@given(raw_columns())
def test_tidying_twice_changes_nothing(raw: tuple[type[Series], dict[str, Any]]) -> None:
    series_type, columns = raw
    once, _ = tidy(series_type, "x", columns, max_speed_m_s=5.0)
    if once is None:
        return
    names = [name for name in columns if getattr(once, name) is not None]
    twice, rejections = tidy(
        series_type, "x", {name: getattr(once, name) for name in names}, max_speed_m_s=5.0
    )
    assert rejections == []
    assert twice is not None
    for name in names:
        np.testing.assert_array_equal(getattr(twice, name), getattr(once, name))


def test_sightings_keep_only_what_belongs_to_a_measurement() -> None:
    nan = np.full(2, np.nan)
    columns = {"t": [0.0, 1.0], "id": [1, 2], "range_m": nan, "sigma_range": [1.0, 1.0]}
    columns |= {"bearing": [0.1, 0.2], "sigma_bearing": [0.1, np.nan], "elevation": nan}
    series, rejections = tidy(LandmarkSeries, "seen", columns)
    assert series is not None
    assert (series.range_m, series.sigma_range, series.elevation) == (None, None, None)
    np.testing.assert_array_equal(series.bearing, [0.1])
    assert reasons(rejections) == {"non-finite sigma_bearing": [1]}
    series, rejections = tidy(LandmarkSeries, "seen", columns | {"bearing": nan})
    assert series is None
    assert reasons(rejections) == {"no range, no bearing": [0, 1]}
    series, rejections = tidy(LandmarkSeries, "seen", columns | {"sigma_bearing": nan})
    assert series is None
    assert reasons(rejections) == {"non-finite sigma_bearing": [0, 1]}
