"""What is drawn against time, as numbers: lines, baselines, words and units."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import solutions

from gtsam_nav.evaluation.histories import (
    HeadingBaseline,
    compass_readings,
    error_history,
    for_people,
    heading_baseline,
    line_starts,
    ranked,
    reference_heading,
    slow_names,
)
from gtsam_nav.evaluation.tracks import map_name, track_of
from gtsam_nav.frames import rotation_from_rpy
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import CloudSeries, HeadingSeries
from gtsam_nav.solution import SlowStates, Solution
from gtsam_nav.trajectory import Trajectory

STILL = Trajectory(
    t=np.array([0.0, 10.0]),
    p_n=np.array([[1.0, 2.0, 3.0], [5.0, 12.0, 3.0]]),
    q_nb_wxyz=np.array([[1.0, 0.0, 0.0, 0.0]] * 2),
)


def solved(method: str, **more: object) -> Solution:
    return replace(Solution(method, STILL, Mission("m", {})), **more)


def test_the_graph_goes_before_filters_and_these_before_dead_reckoning() -> None:
    names = ("dr", "ins-ekf", "landmark-ekf", "graph", "scan-match", "pose-ekf")
    order = [each.method for each in ranked([solved(name) for name in names])]
    assert order == ["graph", "pose-ekf", "landmark-ekf", "ins-ekf", "dr", "scan-match"]


@pytest.mark.parametrize(
    ("t", "starts"),
    [
        ([0.0, 1.0, 2.0, 7.0, 12.1, 13.0, 14.0], [4]),
        ([0.0, 2.0, 4.0, 10.0, 12.0], []),
        ([0.0, 2.0, 4.0, 10.1, 12.1], [3]),
        ([0.0], []),
        ([], []),
    ],
    ids=["over 5 s", "three periods", "over three periods", "one sample", "none"],
)
def test_a_line_breaks_over_five_seconds_and_three_periods(
    t: list[float], starts: list[int]
) -> None:
    np.testing.assert_array_equal(line_starts(np.array(t)), starts)


def test_errors_have_the_sigma_of_estimate_and_reference_together() -> None:
    solution = solutions.graph_solution()
    history = error_history(solution)
    assert history is not None
    assert history.sigma_m is not None
    np.testing.assert_allclose(np.hypot(*history.error_m[:, :2].T), history.error_m[:, 2])
    np.testing.assert_allclose(np.hypot(*history.sigma_m[:, :2].T), history.sigma_m[:, 2])
    # the walk's own variance, the reference's, and what the heading does to the lever arm
    own = 0.02**2 * (history.t + 1.0) + 0.05**2
    arm = 0.01**2 * float(np.sum(solutions.ANTENNA_B**2))
    assert np.all(history.sigma_m[:, 0] ** 2 >= own - 1e-12)
    assert np.all(history.sigma_m[:, 0] ** 2 <= own + arm + 1e-12)
    assert history.note == ""


def test_without_an_absolute_place_errors_are_those_after_alignment() -> None:
    history = error_history(replace(solutions.graph_solution(), georeferenced=False))
    assert history is not None
    assert history.sigma_m is None
    assert history.note == " (SE(2)-aligned)"
    assert abs(history.error_m[:, 0].mean()) < 1e-9
    assert error_history(replace(solutions.graph_solution(), reference=None)) is None


def test_a_heading_less_the_baseline_is_wrapped_and_inside_its_span() -> None:
    baseline = HeadingBaseline("b", np.array([0.0, 10.0]), np.array([3.0, -3.0]))
    t, less_deg = baseline.less(np.array([-1.0, 0.0, 5.0, 10.0, 11.0]), np.full(5, np.pi))
    np.testing.assert_array_equal(t, [0.0, 5.0, 10.0])
    np.testing.assert_allclose(less_deg, np.degrees([np.pi - 3.0, 0.0, 3.0 - np.pi]), atol=1e-9)


def test_the_baseline_is_the_reference_or_the_foremost() -> None:
    with_attitude = [solved("dr", reference=solutions.reference()), solved("graph")]
    baseline, others = heading_baseline(with_attitude)
    assert (baseline.name, others) == ("reference", with_attitude)
    np.testing.assert_allclose(baseline.yaw, solutions.true_pose(baseline.t)[1][:, 2])
    without = [solved("dr", reference=solutions.reference(attitude=False)), solved("graph")]
    assert reference_heading(without[0]) is None
    baseline, others = heading_baseline(without)
    assert (baseline.name, [each.method for each in others]) == ("graph", ["dr"])


def test_compass_readings_are_headings_of_the_body() -> None:
    series = HeadingSeries(t=np.arange(2.0), heading=np.array([0.5, 0.7]), sigma=np.ones(2))
    compass = Sensor("heading", "heading", series, R_bs=rotation_from_rpy([0.0, 0.0, 0.2]))
    readings = compass_readings(Mission("m", {"heading": compass}))
    assert readings is not None
    np.testing.assert_array_equal(readings[0], series.t)
    np.testing.assert_allclose(readings[1], [0.3, 0.5])
    assert compass_readings(Mission("m", {})) is None


def test_slow_states_that_are_zero_are_not_drawn() -> None:
    ones = (np.full(1, 1e-8), np.zeros(1))
    columns = {"b_m": ones, "a_m": ones, "zero_m": (np.full(1, 1e-10), np.zeros(1))}
    assert slow_names(solved("graph", slow_states=SlowStates(np.zeros(1), columns))) == [
        "a_m",
        "b_m",
    ]
    assert slow_names(solved("graph")) == []
    empty = SlowStates(np.zeros(0), {"a_m": (np.zeros(0), np.zeros(0))})
    assert slow_names(solved("graph", slow_states=empty)) == []


@pytest.mark.parametrize(
    ("name", "words", "unit", "value"),
    [
        ("gyro_x_rad_s", "gyro x", "deg/s", np.pi),
        ("heading_bias_rad", "heading bias", "deg", np.pi),
        ("accel_x_m_s2", "accel x", "m/s²", 180.0),
        ("current_n_m_s", "current n", "m/s", 180.0),
        ("offset_m", "offset", "m", 180.0),
        ("clock_s", "clock", "s", 180.0),
        ("dvl_scale", "dvl scale", "", 180.0),
    ],
)
def test_slow_states_have_words_and_units(name: str, words: str, unit: str, value: float) -> None:
    assert for_people(name)[:2] == (words, unit)
    assert value * for_people(name)[2] == pytest.approx(180.0)


def test_a_track_is_the_path_of_the_antenna() -> None:
    track = track_of(solved("graph", reference=solutions.reference()))
    np.testing.assert_allclose(track.path_n, STILL.p_n + solutions.ANTENNA_B)
    np.testing.assert_allclose(track.path_of(STILL), track.path_n)
    east, north = track.at(np.array([0.0, 5.0]))
    np.testing.assert_allclose(east, [2.1, 7.1])
    np.testing.assert_allclose(north, [1.3, 3.3])
    assert track.note == ""
    np.testing.assert_allclose(track_of(solved("graph")).path_n, STILL.p_n)


def test_a_map_is_named_for_what_it_is_made_of() -> None:
    beams = solutions.mission().sensors["beams"]
    clouds = Sensor("clouds", "clouds", CloudSeries(t=np.zeros(1), clouds=(Path("0.npy"),)))
    assert map_name(Mission("m", {"clouds": clouds, "beams": beams})) == "sonar map"
    assert map_name(Mission("m", {"clouds": clouds})) == "map of the clouds"
    assert map_name(Mission("m", {})) == "map of the scans"
