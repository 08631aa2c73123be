"""Series refuse what no estimator can use; missions hand out copies."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from missions import every_sensor_mission, every_series

from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.series import (
    SERIES_TYPES,
    BeamSeries,
    CloudSeries,
    DepthSeries,
    GnssSeries,
    LandmarkSeries,
    ScanSeries,
    Series,
)

TYPES = sorted(SERIES_TYPES)
COLUMNS = [(kind, name) for kind in TYPES for name in SERIES_TYPES[kind].column_specs()]
FLOAT_COLUMNS = [
    (kind, name)
    for kind, name in COLUMNS
    if SERIES_TYPES[kind].column_specs()[name]["dtype"] is float
]


@pytest.fixture(scope="module")
def series(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Series]:
    found = every_series(tmp_path_factory.mktemp("clouds"))
    fixes = found["gnss"]
    assert isinstance(fixes, GnssSeries)
    # no file holds this column
    return {**found, "gnss": replace(fixes, offset_sigma=np.zeros(len(fixes)))}


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Mission:
    return every_sensor_mission(tmp_path_factory.mktemp("clouds"))


def columns(one: Series) -> dict[str, Any]:
    return {
        name: getattr(one, name) for name in one.column_specs() if getattr(one, name) is not None
    }


def depths(n: int = 10) -> DepthSeries:
    return DepthSeries(t=np.arange(float(n)), depth_m=np.arange(n) / 10, sigma=np.full(n, 0.1))


def test_there_is_a_series_of_every_type(series: dict[str, Series]) -> None:
    assert sorted(series) == TYPES
    assert [one.TYPE for one in series.values()] == list(series)
    for kind, one in series.items():
        assert type(one) is SERIES_TYPES[kind]


@pytest.mark.parametrize(("kind", "name"), COLUMNS)
def test_every_column_has_an_entry_a_sample(
    series: dict[str, Series], kind: str, name: str
) -> None:
    one = series[kind]
    short = getattr(one, name)[:-1]
    with pytest.raises(ValueError, match=r"has shape .* is needed"):
        replace(one, **{name: short})


@pytest.mark.parametrize(("kind", "name"), COLUMNS)
def test_every_column_has_its_width(series: dict[str, Series], kind: str, name: str) -> None:
    one = series[kind]
    wider = np.stack([getattr(one, name)] * 2, axis=-1)
    with pytest.raises(ValueError, match=rf"{type(one).__name__}\.{name} has shape .* is needed"):
        replace(one, **{name: wider})


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(("kind", "name"), FLOAT_COLUMNS)
def test_every_number_is_finite(
    series: dict[str, Series], kind: str, name: str, bad: float
) -> None:
    one = series[kind]
    values = getattr(one, name).copy()
    values[-1] = bad
    with pytest.raises(ValueError, match=rf"{type(one).__name__}\.{name} holds NaN or infinity"):
        replace(one, **{name: values})


@pytest.mark.parametrize("kind", TYPES)
def test_time_never_goes_back(series: dict[str, Series], kind: str) -> None:
    one = series[kind]
    with pytest.raises(ValueError, match=rf"{type(one).__name__}\.t does not strictly increase"):
        replace(one, t=one.t[::-1])


@pytest.mark.parametrize("kind", TYPES)
def test_only_landmarks_share_a_stamp(series: dict[str, Series], kind: str) -> None:
    one = series[kind]
    t = np.arange(float(len(one)))
    t[1] = t[0]
    if kind == "landmarks":
        assert replace(one, t=t).t[1] == t[0]
    else:
        with pytest.raises(ValueError, match="does not strictly increase"):
            replace(one, t=t)


@pytest.mark.parametrize("kind", TYPES)
def test_optional_columns_may_stay_away(series: dict[str, Series], kind: str) -> None:
    one = series[kind]
    optional = [name for name, spec in one.column_specs().items() if spec["optional"]]
    if isinstance(one, LandmarkSeries):
        # of these one or the other must stay, with its sigma
        optional = [name for name in optional if name not in ("range_m", "sigma_range")]
    bare = replace(one, **dict.fromkeys(optional))
    np.testing.assert_array_equal(bare.row, np.arange(len(one)))
    for name in set(optional) - {"row"}:
        assert getattr(bare, name) is None
        assert getattr(bare.select(slice(0, 2)), name) is None


@pytest.mark.parametrize(
    ("away", "message"),
    [
        (("range_m", "bearing", "sigma_range", "sigma_bearing", "elevation"), "range_m or bearing"),
        (("range_m",), "go with their sigma"),
        (("sigma_bearing",), "go with their sigma"),
        (("bearing", "sigma_bearing"), "elevation goes with bearing"),
    ],
)
def test_sightings_measure_something(
    series: dict[str, Series], away: tuple[str, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        replace(series["landmarks"], **dict.fromkeys(away))


def test_columns_take_their_type() -> None:
    lists = LandmarkSeries(
        t=[0, 1],
        id=[3, -1],
        range_m=[5, 6],
        bearing=[0, 1],
        sigma_range=[1, 1],
        sigma_bearing=[1, 1],
    )
    assert lists.id.dtype == np.int64
    assert lists.t.dtype == lists.range_m.dtype == np.float64


@pytest.mark.parametrize("resolution_m", [0.0, -0.1, np.nan, np.inf])
def test_bins_have_a_size(series: dict[str, Series], resolution_m: float) -> None:
    with pytest.raises(ValueError, match=r"resolution_m is .*; it must be positive"):
        replace(series["beams"], resolution_m=resolution_m)


def test_beams_have_any_number_of_bins() -> None:
    for bins in (0, 1, 500):
        beams = BeamSeries(t=[0.0], angle=[0.0], intensity=np.zeros((1, bins)))
        assert beams.intensity.dtype == np.uint8


@pytest.mark.parametrize(
    ("first", "points_b", "complaint"),
    [
        ([0, 2], np.zeros((2, 2)), "one rising offset a scan"),  # an offset is missing
        ([0, 3, 2], np.zeros((2, 2)), "one rising offset a scan"),
        ([1, 1, 2], np.zeros((2, 2)), "one rising offset a scan"),
        ([0, 1, 3], np.zeros((2, 2)), "points_b has shape"),  # more are promised
        ([0, 1, 2], np.zeros((2, 4)), "points_b has shape"),
        ([0, 1, 2], np.zeros(2), "points_b has shape"),
        ([0, 1, 2], np.array([[0, 1], [np.nan, 0]]), "points_b holds NaN"),
    ],
)
def test_scans_own_their_points(first: list[int], points_b: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        ScanSeries(t=[0.0, 1.0], first=np.array(first), points_b=points_b)


def test_every_stamp_has_a_cloud() -> None:
    with pytest.raises(ValueError, match="2 stamps and 1 clouds"):
        CloudSeries(t=[0.0, 1.0], clouds=(Path("a.npy"),))


@pytest.mark.parametrize("kind", TYPES)
def test_select_takes_masks_indices_and_slices(series: dict[str, Series], kind: str) -> None:
    one = series[kind]
    mask = np.zeros(len(one), dtype=bool)
    mask[1:3] = True
    picks = [one.select(mask), one.select(np.array([1, 2])), one.select(slice(1, 3))]
    for picked in picks:
        assert type(picked) is type(one)
        assert columns(picked).keys() == columns(one).keys()
        for name, values in columns(one).items():
            np.testing.assert_array_equal(getattr(picked, name), values[1:3])
    np.testing.assert_array_equal(picks[0].row, [1, 2])  # the place in the source, not here


def test_selected_scans_keep_their_points(series: dict[str, Series]) -> None:
    scans = series["scans"]
    assert isinstance(scans, ScanSeries)
    last = scans.select(np.array([False, True, True]))  # an empty scan, and one of five points
    np.testing.assert_array_equal(last.first, [0, 0, 5])
    np.testing.assert_array_equal(last.points_b, scans.points_b[4:])
    assert len(scans.select(slice(0, 0)).points_b) == 0


def test_selected_stamps_keep_their_clouds(series: dict[str, Series]) -> None:
    clouds = series["clouds"]
    assert isinstance(clouds, CloudSeries)
    assert clouds.crop(1.0, 9.0).clouds == clouds.clouds[1:]


@given(st.floats(-2, 12), st.floats(-2, 12))
def test_crop_is_half_open(start_s: float, stop_s: float) -> None:
    t = depths().t
    wanted = t[(t >= start_s) & (t < stop_s)]
    np.testing.assert_array_equal(depths().crop(start_s, stop_s).t, wanted)


@pytest.mark.parametrize("kind", TYPES)
def test_shift_moves_time_alone(series: dict[str, Series], kind: str) -> None:
    one = series[kind]
    moved = one.shift(-100.5)
    np.testing.assert_allclose(moved.t, one.t - 100.5)
    for name, values in columns(one).items():
        if name != "t":
            np.testing.assert_array_equal(getattr(moved, name), values)


def test_a_sensor_holds_its_own_type_of_series() -> None:
    with pytest.raises(ValueError, match="sensor 'bow' of type gnss holds a DepthSeries"):
        Sensor("bow", "gnss", depths())


def test_a_mission_finds_sensors_that_have_samples(mission: Mission) -> None:
    assert [s.name for s in mission.of_type("gnss")] == ["gnss", "stern / gnss"]
    empty = replace(mission.sensors["gnss"], series=mission.sensors["gnss"].series.select(slice(0)))
    first = mission.with_sensor(empty).first("gnss")
    assert first is not None
    assert first.name == "stern / gnss"
    assert mission.without("gnss", "stern / gnss").first("gnss") is None
    assert mission.first("no such type") is None


def test_changed_missions_are_copies(mission: Mission) -> None:
    names = list(mission.sensors)
    assert "depth" not in mission.without("depth").sensors
    other = mission.with_sensor(Sensor("keel depth", "depth", depths()))
    assert list(other.sensors) == [*names, "keel depth"]
    assert list(mission.sensors) == names


def test_the_span_is_that_of_what_estimates() -> None:
    fixes = GnssSeries(t=[5.0, 20.0], p_n=np.zeros((2, 3)), sigma=np.ones((2, 3)))
    mission = Mission(
        "m", {"depth": Sensor("depth", "depth", depths()), "gnss": Sensor("gnss", "gnss", fixes)}
    )
    assert mission.span_s == (0.0, 20.0)
    assert mission.without("gnss").span_s == (0.0, 9.0)
    assert Mission("nothing", {}).span_s == (0.0, 0.0)


def test_the_reference_stretches_no_span(mission: Mission) -> None:
    assert mission.reference is not None
    late = replace(mission.reference, series=mission.reference.series.shift(1e6))
    assert mission.with_sensor(late).span_s == mission.span_s
    assert mission.without("reference").reference is None


def test_a_cropped_mission_keeps_its_zero(mission: Mission) -> None:
    cropped = mission.crop(2.0, 4.0)
    assert list(cropped.sensors) == list(mission.sensors)
    start, stop = cropped.span_s
    assert 2.0 <= start < stop < 4.0
    assert mission.crop().span_s == mission.span_s
    times = (1.9, 2.0, 4.0, np.nan)
    refused = tuple(Rejection(t, "depth", k, "no good") for k, t in enumerate(times))
    left = replace(mission, rejections=refused).crop(2.0, 4.0).rejections
    assert [r.index for r in left] == [1, 3]


@pytest.mark.parametrize(
    ("left_out", "kind"),
    [((), "simulated"), (("beams",), "recorded"), (("beams", "scans"), None)],
)
def test_simulated_sonar_is_known_as_such(
    mission: Mission, left_out: tuple[str, ...], kind: str | None
) -> None:
    assert mission.without(*left_out).sonar_kind == kind
