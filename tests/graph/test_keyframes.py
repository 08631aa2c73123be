"""Keyframe times: every scan's middle, never too far apart."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gtsam_nav.config import Config
from gtsam_nav.graph.keyframes import MIN_SPACING_S, keyframe_times, merged_anchors
from gtsam_nav.graph.measurements import build_problem
from gtsam_nav.graph.outset import mission_keyframes, start_and_motion
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import DvlSeries, GnssSeries, LandmarkSeries


@given(
    start=st.floats(-10, 10),
    length=st.floats(1.0, 100.0),
    scans=st.lists(st.floats(-20, 120), max_size=15),
    interval=st.floats(0.6, 20.0),
)
def test_scans_are_keyframes_and_no_spacing_is_too_long(
    start: float, length: float, scans: list[float], interval: float
) -> None:
    stop = start + length
    t_scans = np.unique(np.round(scans, 3))
    t = keyframe_times(start, stop, t_scans, interval)
    assert np.all(np.diff(t) > 0)
    assert np.all(np.diff(t) <= interval * (1 + 1e-9))
    inside = t_scans[(t_scans > start) & (t_scans < stop)]
    assert np.all(np.isin(inside, t))
    assert t[0] - start < MIN_SPACING_S
    assert stop - t[-1] < MIN_SPACING_S
    assert t[0] >= start
    assert t[-1] <= stop


def test_without_scans_the_span_is_divided_evenly() -> None:
    np.testing.assert_allclose(keyframe_times(0.0, 10.0, np.empty(0), 4.0), [0, 10 / 3, 20 / 3, 10])


def test_scan_beside_an_end_takes_its_place() -> None:
    beside = np.array([0.4 * MIN_SPACING_S, 10.0 - 0.4 * MIN_SPACING_S])
    np.testing.assert_allclose(keyframe_times(0.0, 10.0, beside, 20.0), beside)
    further = np.array([2 * MIN_SPACING_S, 5.0])
    np.testing.assert_allclose(keyframe_times(0.0, 10.0, further, 20.0), [0.0, *further, 10.0])


def test_what_is_measured_at_an_end_that_gave_way_stays() -> None:
    """A fix at the start and at the stop, beside a scan; the last sighting beside another."""
    t, one = np.arange(0.0, 10.01, 0.5), np.ones(2)
    known = np.ones(len(t), dtype=bool)
    dvl = DvlSeries(
        t=t, v_d=np.zeros((len(t), 3)), sigma=0.1 * known, valid=known, bottom_lock=known
    )
    seen = LandmarkSeries(
        t=[5.0, 9.99],
        id=[1, 1],
        range_m=10.0 * one,
        bearing=0.0 * one,
        sigma_range=0.1 * one,
        sigma_bearing=0.01 * one,
    )
    fixes = GnssSeries(t=[0.0, 10.0], p_n=np.zeros((2, 3)), sigma=np.ones((2, 3)))
    series = {"dvl": dvl, "gnss": fixes, "landmarks": seen}
    mission = Mission("ends", {name: Sensor(name, name, own) for name, own in series.items()})
    scans, config = np.array([0.03, 9.96]), Config()
    keyframes = mission_keyframes(mission, scans, np.empty(0), config)
    assert keyframes[0] == 0.03
    assert keyframes[-1] == 9.96
    problem = build_problem(mission, *start_and_motion(mission, config), keyframes, config)
    first, *_, last = ([reading.t for reading in own] for own in problem.readings)
    assert first == [0.0]
    assert last == [10.0, 9.99]


def test_scans_on_the_ends_change_nothing() -> None:
    t = keyframe_times(0.0, 10.0, np.array([0.0, 10.0]), 20.0)
    np.testing.assert_allclose(t, [0.0, 10.0])


def test_anchors_of_the_first_list_come_first() -> None:
    scans, fixes = np.array([1.0, 2.0]), np.array([0.5, 1.05, 1.98, 3.0])
    np.testing.assert_allclose(merged_anchors([scans, fixes], 0.1), [0.5, 1.0, 2.0, 3.0])
    np.testing.assert_allclose(merged_anchors([fixes, scans], 0.1), [0.5, 1.05, 1.98, 3.0])


@given(st.lists(st.lists(st.floats(0.0, 20.0), max_size=30), max_size=3))
def test_anchors_keep_their_distance_and_leave_out_nothing_else(groups: list[list[float]]) -> None:
    merged = merged_anchors([np.array(group) for group in groups], 0.1)
    assert np.all(np.diff(merged) >= 0.1 - 1e-12)
    for t in (t for group in groups for t in group):
        assert np.min(np.abs(merged - t)) < 0.1
