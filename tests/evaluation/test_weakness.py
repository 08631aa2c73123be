"""Where a mission was weakly constrained."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.evaluation.plots import position_sigma
from gtsam_nav.evaluation.report_tables import weak_table
from gtsam_nav.evaluation.weakness import MajorAxis, weak_stretches
from gtsam_nav.frames import quaternion_from_rpy
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import DvlSeries, GnssSeries, OdometrySeries
from gtsam_nav.solution import LoopClosure, Solution
from gtsam_nav.trajectory import Trajectory

T = np.arange(0.0, 300.0, 0.5)
AZIMUTH_DEG = 30.0
BEGIN_S, END_S = 100.0, 160.0


def solution(loops: tuple[LoopClosure, ...] = ()) -> Solution:
    """Sure to 0.3 m, but for a minute that is unsure to 2 m along one direction."""
    inside = (BEGIN_S <= T) & (END_S >= T)
    c, s = np.cos(np.radians(AZIMUTH_DEG)), np.sin(np.radians(AZIMUTH_DEG))
    R = np.array([[c, -s], [s, c]])
    cov = np.tile(0.01 * np.eye(6), (len(T), 1, 1))
    for k, weak in enumerate(inside):
        cov[k, :2, :2] = R @ np.diag([2.0 if weak else 0.3, 0.2]) ** 2 @ R.T
    trajectory = Trajectory(
        t=T,
        p_n=np.zeros((len(T), 3)),
        q_nb_wxyz=quaternion_from_rpy(np.zeros((len(T), 3))),
        cov_pose_n=cov,
    )
    fixes = T[~inside]
    gnss = GnssSeries(t=fixes, p_n=np.zeros((len(fixes), 3)), sigma=np.ones((len(fixes), 3)))
    valid = (T < 120.0) | (T > 155.0)
    dvl = DvlSeries(
        t=T, v_d=np.zeros((len(T), 3)), sigma=np.ones(len(T)), valid=valid, bottom_lock=valid
    )
    sensors = {"gnss": Sensor("gnss", "gnss", gnss), "dvl": Sensor("dvl", "dvl", dvl)}
    return Solution("graph", trajectory, Mission(name="m", sensors=sensors), loops=loops)


def closure(t_a: float, sigma_x_m: float, verdict: str = "accepted") -> LoopClosure:
    assert verdict in ("accepted", "rejected")
    return LoopClosure(
        t_a, t_a + 100.0, 0.0, 0.0, 0.0, sigma_x_m, 0.1, 0.01, 0.9,
        "accepted" if verdict == "accepted" else "rejected", "",
    )  # fmt: skip


def test_the_longest_axis_is_that_of_the_ellipse() -> None:
    axis = MajorAxis.of(solution().trajectory)
    assert axis is not None
    assert axis.sigma_m.max() == pytest.approx(2.0)
    assert axis.sigma_m.min() == pytest.approx(0.3)
    np.testing.assert_allclose(np.degrees(axis.azimuth), AZIMUTH_DEG)
    assert axis.limit_m == pytest.approx(0.6)


def test_a_stretch_says_how_unsure_and_what_was_missing() -> None:
    (stretch,) = weak_stretches(solution())
    assert (stretch.begin_s, stretch.end_s) == (BEGIN_S, END_S)
    assert stretch.sigma_m == pytest.approx(2.0)
    assert stretch.azimuth_deg == pytest.approx(AZIMUTH_DEG)
    assert stretch.causes == ("no GNSS fix", "bottom lock lost")


@pytest.mark.parametrize(
    ("loops", "cause"),
    [
        ((closure(20.0, 0.2),), None),
        ((closure(250.0, 0.2),), "no loop closure"),
        ((closure(80.0, 0.2),), "no loop closure"),  # from before it to behind it
        ((closure(20.0, 0.2, "rejected"),), "no loop closure"),
        (
            (closure(20.0, 100.0), closure(110.0, 90.0), closure(130.0, 0.2)),
            "2 of 3 loop closures do not tell the way along them",
        ),
    ],
)
def test_closures_count_for_what_they_tell(
    loops: tuple[LoopClosure, ...], cause: str | None
) -> None:
    (stretch,) = weak_stretches(solution(loops))
    about_loops = [c for c in stretch.causes if "closure" in c]
    assert about_loops == ([cause] if cause else [])


def test_an_even_mission_has_no_weak_stretch() -> None:
    even = solution()
    cov = np.tile(0.09 * np.eye(6), (len(T), 1, 1))
    even = replace(even, trajectory=replace(even.trajectory, cov_pose_n=cov))
    assert weak_stretches(even) == ()
    assert "No stretch stands out" in weak_table([even])
    blind = replace(even, trajectory=replace(even.trajectory, cov_pose_n=None))
    assert weak_stretches(blind) == ()
    assert position_sigma([blind]) is None


def test_the_report_lists_and_draws_the_stretches() -> None:
    text = weak_table([solution()])
    assert "no GNSS fix; bottom lock lost" in text
    figure = position_sigma([solution()])
    assert figure is not None
    assert len(figure.axes[0].lines) == 1


@pytest.mark.parametrize(
    ("valid_share", "locked_share", "cause"),
    [
        (0.0, 1.0, "no velocity"),
        (0.4, 1.0, "bottom lock lost"),
        (1.0, 0.4, "bottom lock lost"),
        (0.6, 1.0, None),
        (1.0, 0.6, None),
    ],
)
def test_velocities_are_missed_where_less_than_half_are_locked(
    valid_share: float, locked_share: float, cause: str | None
) -> None:
    weak = solution()
    dvl = weak.mission.sensors["dvl"]
    assert isinstance(dvl.series, DvlSeries)
    # ten samples at a time, so that every stretch has its share
    tenth = np.arange(len(T)) % 10 / 10
    series = replace(dvl.series, valid=tenth < valid_share, bottom_lock=tenth < locked_share)
    mission = weak.mission.with_sensor(replace(dvl, series=series))
    (stretch,) = weak_stretches(replace(weak, mission=mission))
    assert [c for c in stretch.causes if c != "no GNSS fix"] == ([cause] if cause else [])


def test_without_a_dvl_none_is_missed() -> None:
    weak = solution()
    (stretch,) = weak_stretches(replace(weak, mission=weak.mission.without("dvl")))
    assert stretch.causes == ("no GNSS fix",)


@pytest.mark.parametrize(("apart_s", "stretches"), [(5.0, 1), (5.5, 2)])
def test_weak_stretches_that_nearly_touch_are_one(apart_s: float, stretches: int) -> None:
    weak = solution()
    cov = np.array(weak.trajectory.cov_pose_n)
    begin, end = np.searchsorted(T, [120.1, 120.0 + apart_s])
    cov[begin:end, :2, :2] = 0.09 * np.eye(2)
    found = weak_stretches(replace(weak, trajectory=replace(weak.trajectory, cov_pose_n=cov)))
    bounds = [(BEGIN_S, 120.0), (120.0 + apart_s, END_S)]
    assert [(s.begin_s, s.end_s) for s in found] == (
        bounds if stretches == 2 else [(BEGIN_S, END_S)]
    )


def silent_but_for(*others: Sensor) -> tuple[str, ...]:
    weak = solution()
    mission = weak.mission.with_sensor(weak.mission.sensors["dvl"])
    for other in others:
        mission = mission.with_sensor(other)
    (stretch,) = weak_stretches(replace(weak, mission=mission))
    return stretch.causes


def test_another_sensor_of_velocities_that_runs_on_is_no_silence() -> None:
    every, one = np.ones(len(T), dtype=bool), np.ones(len(T))
    still = np.zeros((len(T), 3))
    whole = DvlSeries(t=T, v_d=still, sigma=one, valid=every, bottom_lock=every)
    wheels = OdometrySeries(
        t=T, v_b=still[:, :2], yaw_rate=0.0 * T, sigma_v=one, sigma_yaw_rate=one
    )
    lost = "bottom lock lost"
    assert lost in silent_but_for()
    assert lost not in silent_but_for(Sensor("other", "dvl", whole))
    assert lost not in silent_but_for(Sensor("odometry", "odometry", wheels))
    ended = Sensor("other", "dvl", whole.select(T < 20.0))
    assert silent_but_for(ended) == silent_but_for()


def test_what_never_has_bottom_lock_loses_none() -> None:
    weak = solution()
    dvl = weak.mission.sensors["dvl"]
    assert isinstance(dvl.series, DvlSeries)
    never, always = np.zeros(len(T), dtype=bool), np.ones(len(T), dtype=bool)
    series = replace(dvl.series, valid=always, bottom_lock=never)
    mission = weak.mission.with_sensor(replace(dvl, series=series))
    (stretch,) = weak_stretches(replace(weak, mission=mission))
    assert stretch.causes == ("no GNSS fix",)
