"""Figures: what they show, that they don't need what is not there, and equal bytes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import solutions
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure

from gtsam_nav.evaluation import plots
from gtsam_nav.evaluation.histories import foremost
from gtsam_nav.evaluation.plots.style import broken, method_colour
from gtsam_nav.evaluation.plots.timeline import spans_without_gaps
from gtsam_nav.frames import quaternion_from_rotation, rotation_from_quaternion
from gtsam_nav.mission import LandmarkMap
from gtsam_nav.solution import Solution


@pytest.fixture(scope="module")
def both() -> list[Solution]:
    return [solutions.dr_solution(), solutions.graph_solution()]


def legend(ax: Axes) -> list[str]:
    return ax.get_legend_handles_labels()[1]


def test_plan_view_names_all_that_it_shows(both: list[Solution]) -> None:
    (ax,) = plots.plan_view(both).axes
    assert legend(ax) == [
        "sonar map (graph)", "loops rejected (25)", "loops accepted (35)", "GNSS used",
        "reference", "dr", "graph", "start", "landmarks, 3 sigma (3)",
    ]  # fmt: skip
    assert ax.get_aspect() == 1.0
    assert ax.get_xlabel().startswith("east")
    assert ax.get_ylabel().startswith("north")


def test_plan_view_draws_north_up_and_at_the_antenna(both: list[Solution]) -> None:
    graph = both[1]
    (ax,) = plots.plan_view([graph]).axes
    line = next(x for x in ax.lines if x.get_label() == "graph")
    antenna = graph.trajectory.at_lever_arm(solutions.ANTENNA_B).p_n
    np.testing.assert_allclose(np.asarray(line.get_ydata()), antenna[:, 0])
    np.testing.assert_allclose(np.asarray(line.get_xdata()), antenna[:, 1])


def test_plan_view_aligns_what_has_no_absolute_position(both: list[Solution]) -> None:
    graph = both[1]
    shifted = replace(graph.trajectory, p_n=graph.trajectory.p_n + 500.0)
    (ax,) = plots.plan_view([replace(graph, trajectory=shifted, georeferenced=False)]).axes
    assert "graph (SE(2)-aligned)" in legend(ax)
    assert max(ax.get_xlim()) < 200.0


def test_plan_view_shows_landmarks_with_three_sigma(both: list[Solution]) -> None:
    survey = LandmarkMap(np.array([7]), np.array([[90.0, 21.0, 0.0]]), np.array([0.1]))
    mission = replace(both[0].mission, landmark_map=survey)
    mapped = replace(both[0], landmarks=solutions.landmark_estimates(), mission=mission)
    (ax,) = plots.plan_view([mapped]).axes
    assert {"surveyed landmarks", "landmarks, 3 sigma (3)"} <= set(legend(ax))
    crosses = next(x for x in ax.lines if x.get_label() == "landmarks, 3 sigma (3)")
    np.testing.assert_array_equal(np.asarray(crosses.get_xdata()), [20.0, 5.0, -12.5])
    np.testing.assert_array_equal(np.asarray(crosses.get_ydata()), [10.0, -30.0, 0.0])
    (ellipses,) = (c for c in ax.collections if isinstance(c, EllipseCollection))
    # full axes are six sigma: 1 m eastwards and 0.1 m northwards of the second, drawn east to north
    np.testing.assert_allclose(ellipses.get_widths(), 6 * np.sqrt([0.04, 1.0, 0.45]))
    np.testing.assert_allclose(ellipses.get_heights(), 6 * np.sqrt([0.04, 0.01, 0.05]))
    np.testing.assert_allclose(ellipses.get_angles()[1:] % 180, [0.0, 45.0], atol=1e-9)
    assert {"7", "3", "12"} <= {text.get_text() for text in ax.texts}
    assert ax.get_ylim()[1] > 90


def test_landmarks_are_aligned_with_their_track(both: list[Solution]) -> None:
    graph, turn = both[1], np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    R_nb = turn @ rotation_from_quaternion(graph.trajectory.q_nb_wxyz)
    moved = replace(
        graph.trajectory,
        p_n=graph.trajectory.p_n @ turn.T + [50.0, 0.0, 0.0],
        q_nb_wxyz=quaternion_from_rotation(R_nb),
    )
    landmarks = solutions.landmark_estimates()
    turned = replace(
        landmarks,
        p_n=landmarks.p_n @ turn.T + [50.0, 0.0, 0.0],
        cov_n=turn @ landmarks.cov_n @ turn.T,
    )
    solution = replace(graph, georeferenced=False, trajectory=moved, landmarks=turned)
    (ax,) = plots.plan_view([solution]).axes
    (ellipses,) = (c for c in ax.collections if isinstance(c, EllipseCollection))
    along = np.radians(ellipses.get_angles()[1:])
    np.testing.assert_allclose(np.abs(np.cos(along - np.radians([0.0, 45.0]))), 1.0, atol=0.01)
    np.testing.assert_allclose(ellipses.get_offsets()[0], [20.0, 10.0], atol=2.0)


def test_position_errors_have_three_panels_with_bands(both: list[Solution]) -> None:
    figure = plots.position_errors(both[1], (60.0, 500.0))
    assert figure is not None
    assert [ax.get_ylabel() for ax in figure.axes] == ["north (m)", "east (m)", "horizontal (m)"]
    assert "±3 sigma of estimate and reference" in legend(figure.axes[0])
    assert [text.get_text() for text in figure.axes[0].texts] == ["not scored"] * 2


def test_heading_is_held_against_the_reference_or_the_graph(both: list[Solution]) -> None:
    figure = plots.heading_errors(both)
    assert figure is not None
    assert legend(figure.axes[0]) == ["compass", "dr", "graph"]
    blind = [replace(s, reference=solutions.reference(attitude=False)) for s in both]
    figure = plots.heading_errors(blind)
    assert figure is not None
    assert legend(figure.axes[0]) == ["compass", "dr"]
    assert "graph" in figure.axes[0].get_ylabel()


def test_compass_bias_is_in_degrees_before_its_true_error(both: list[Solution]) -> None:
    figure = plots.compass_bias(both[1])
    assert figure is not None
    (ax,) = figure.axes
    assert ax.get_ylabel() == "heading bias\n(deg)"
    assert legend(ax) == ["compass", "±3 sigma", "estimate"]
    slow = both[1].slow_states
    assert slow is not None
    line = next(x for x in ax.lines if x.get_label() == "estimate")
    expected = np.degrees(slow.columns["heading_bias_rad"][0])
    np.testing.assert_allclose(np.asarray(line.get_ydata()), expected)


def test_other_slow_states_have_their_own_panels(both: list[Solution]) -> None:
    figure = plots.slow_states(both[1])
    assert figure is not None
    assert [ax.get_ylabel() for ax in figure.axes] == ["gyro z\n(deg/s)"]


def test_timeline_shows_gaps_and_what_was_not_used(both: list[Solution]) -> None:
    (ax,) = plots.sensor_timeline(both[1]).axes
    names = [tick.get_text() for tick in ax.get_yticklabels()]
    assert names == [
        "dvl", "heading", "attitude", "depth", "beams\n(simulated)", "gnss",
        "reference\n(scored on)",
    ]  # fmt: skip
    notes = [text.get_text() for text in ax.texts]
    assert "1 gap" in notes[0]
    assert "unused" in notes[0]
    assert "gap" not in notes[1]


def test_spans_end_at_gaps() -> None:
    t = np.array([0.0, 1.0, 2.0, 9.0, 10.0, 11.0])
    assert spans_without_gaps(t) == [(0.0, 2.0), (9.0, 11.0)]
    assert spans_without_gaps(t[:1]) == [(0.0, 0.0)]
    assert spans_without_gaps(t[:0]) == []


def test_lines_break_in_silence() -> None:
    t, values = broken(np.array([0.0, 1.0, 2.0, 20.0]), np.array([5.0, 6.0, 7.0, 8.0]))
    np.testing.assert_array_equal(t, [0.0, 1.0, 2.0, np.nan, 20.0])
    np.testing.assert_array_equal(values, [5.0, 6.0, 7.0, np.nan, 8.0])


def test_lines_of_slow_samples_do_not_break() -> None:
    t = np.array([0.0, 7.0, 14.0, 21.0])
    np.testing.assert_array_equal(broken(t)[0], t)


def test_figures_without_data_are_none(both: list[Solution]) -> None:
    bare = replace(both[0], reference=None, mission=both[0].mission.without("heading"))
    assert plots.position_errors(bare) is None
    assert plots.horizontal_errors([bare]) is None
    assert plots.heading_errors([bare]) is None
    assert plots.compass_bias(bare) is None
    assert plots.slow_states(bare) is None
    assert plots.loop_verdicts(bare) is None
    assert isinstance(plots.plan_view([bare]), Figure)


def test_colours_are_the_methods_own(both: list[Solution]) -> None:
    assert method_colour("graph") != method_colour("dr")
    assert foremost(both).method == "graph"
    assert foremost(both[:1]).method == "dr"


def test_the_same_figure_is_the_same_bytes(both: list[Solution], tmp_path: Path) -> None:
    files = [
        plots.save_png(plots.plan_view(both), tmp_path / name).read_bytes()
        for name in ("a.png", "b.png")
    ]
    assert files[0] == files[1]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "b.png"]
