"""From a mission's sonars to scans and the map: which sonar is used, and where echoes land."""

from __future__ import annotations

import numpy as np
import pytest

from gtsam_nav.frames import Array, quaternion_from_rpy
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import BeamSeries, ScanSeries
from gtsam_nav.sonar.defects import WHOLE_SENSOR
from gtsam_nav.sonar.echoes import Echoes, segment
from gtsam_nav.sonar.motion import PlanarMotion
from gtsam_nav.sonar.preparation import (
    AT_ONCE_S,
    deskewed,
    leave_out_defective_sonar,
    registered_scans,
    scans_at_once,
    sonar_map,
    sonar_turns,
)
from gtsam_nav.sonar.scans import Turns
from gtsam_nav.sonar.settings import ScanSettings, SonarSettings
from gtsam_nav.trajectory import Trajectory


def beams(name: str = "sonar", bright_bin: int | None = 200) -> Sensor:
    """Eight seconds of a head that takes four for a turn, and sees something at one range."""
    intensity = np.full((80, 300), 5, np.uint8)
    if bright_bin is not None:
        intensity[:, bright_bin - 1 : bright_bin + 2] = 200
    angle = np.arange(80) * 2 * np.pi / 40 % (2 * np.pi)
    series = BeamSeries(
        t=1.0 + 0.1 * np.arange(80), angle=angle, intensity=intensity, resolution_m=0.1
    )
    return Sensor(name=name, type="beams", series=series)


def scans(name: str = "scans", counts: tuple[int, ...] = (2, 0, 1)) -> Sensor:
    first = np.concatenate([[0], np.cumsum(counts)])
    points = np.arange(2.0 * first[-1]).reshape(-1, 2) + 1.0
    series = ScanSeries(t=np.array([1.0, 2.0, 6.0]), first=first, points_b=points)
    return Sensor(name=name, type="scans", series=series)


def mission_of(*sensors: Sensor) -> Mission:
    return Mission("sonars", {sensor.name: sensor for sensor in sensors})


def test_a_good_sonar_stays_with_its_echoes() -> None:
    mission, echoes, rejections, warnings = leave_out_defective_sonar(
        mission_of(beams()), SonarSettings()
    )
    assert list(mission.sensors) == ["sonar"]
    assert rejections == warnings == ()
    assert echoes is not None
    np.testing.assert_array_equal(echoes.beam, segment(beams(), SonarSettings().segmentation).beam)
    assert len(echoes) == 80


@pytest.mark.parametrize(
    ("sonar", "use", "reason"),
    [
        (beams(), False, "switched off by sonar.use"),
        (beams(bright_bin=None), True, "no echo stands out of its noise"),
        (scans(counts=(0, 0, 0)), True, "the scans hold no points"),
    ],
)
def test_a_sonar_that_is_no_use_is_left_out_and_said(sonar: Sensor, use: bool, reason: str) -> None:
    mission, echoes, (rejection,), (warning,) = leave_out_defective_sonar(
        mission_of(sonar), SonarSettings(use=use)
    )
    assert not mission.sensors
    assert echoes is None
    assert (rejection.t, rejection.sensor, rejection.reason) == (1.0, sonar.name, reason)
    assert rejection.index == WHOLE_SENSOR == -1
    assert warning == f"sonar '{sonar.name}' is not used: {reason}"


def test_one_sonar_is_used_the_first_without_a_defect() -> None:
    given = mission_of(scans(), beams("dull", bright_bin=None), beams("good"), beams("spare"))
    mission, echoes, rejections, _ = leave_out_defective_sonar(given, SonarSettings())
    assert list(mission.sensors) == ["good"]
    assert echoes is not None
    assert len(echoes) == 80
    assert [(each.sensor, each.reason) for each in rejections] == [
        ("dull", "no echo stands out of its noise"),
        ("spare", "the sonar 'good' is used"),
        ("scans", "the sonar 'good' is used"),
    ]


def test_scans_extracted_elsewhere_are_used_as_they_are() -> None:
    _, echoes, rejections, _ = leave_out_defective_sonar(mission_of(scans()), SonarSettings())
    assert rejections == ()
    assert echoes is not None
    np.testing.assert_array_equal(echoes.beam, [0, 0, 2])


def test_points_at_the_scanner_itself_are_none_and_said() -> None:
    points = np.array([[3.0, 4.0], [0.0, 0.0], [6.0, -8.0]])
    series = ScanSeries(t=np.array([1.0, 2.0]), first=np.array([0, 2, 3]), points_b=points)
    given = mission_of(Sensor(name="laser", type="scans", series=series))
    mission, echoes, rejections, (warning,) = leave_out_defective_sonar(given, SonarSettings())
    assert rejections == ()
    assert echoes is not None
    np.testing.assert_array_equal(echoes.xy_b, points[[0, 2]])
    np.testing.assert_array_equal(echoes.beam, [0, 1])
    used = mission.sensors["laser"].series
    assert isinstance(used, ScanSeries)
    np.testing.assert_array_equal(used.first, [0, 1, 2])
    assert warning == "sensor 'laser': 1 points at the scanner itself are left out"


def test_scans_without_any_point_but_at_the_scanner_are_no_use() -> None:
    series = ScanSeries(t=np.array([1.0]), first=np.array([0, 2]), points_b=np.zeros((2, 2)))
    given = mission_of(Sensor(name="laser", type="scans", series=series))
    _, echoes, _, warnings = leave_out_defective_sonar(given, SonarSettings())
    assert echoes is None
    assert warnings == ("sonar 'laser' is not used: the scans hold no points",)


def test_turns_are_thinned() -> None:
    turns = sonar_turns(mission_of(beams()), SonarSettings())
    assert turns is not None
    np.testing.assert_array_equal(turns.first, [0, 40])
    np.testing.assert_array_equal(turns.last, [40, 80])
    np.testing.assert_allclose(turns.t_ref, [3.0, 7.0])
    sparse = SonarSettings(scans=ScanSettings(min_interval_s=4.5))
    thinned = sonar_turns(mission_of(beams()), sparse)
    assert thinned is not None
    assert (thinned.first, thinned.last, thinned.t_ref) == (0, 40, 3.0)


def test_turns_of_scans_and_of_nothing() -> None:
    turns = sonar_turns(mission_of(scans()), SonarSettings())
    assert turns is not None
    np.testing.assert_array_equal(turns.t_ref, [1.0, 6.0])
    assert sonar_turns(mission_of(), SonarSettings()) is None
    two_beams = Sensor("s", "beams", beams().series.select(slice(2)))
    assert sonar_turns(mission_of(two_beams), SonarSettings()) is None


def scanner(period_s: float, n: int = 9) -> Sensor:
    series = ScanSeries(t=period_s * np.arange(n), first=np.arange(n + 1), points_b=np.ones((n, 2)))
    return Sensor("scans", "scans", series)


def test_a_scanner_takes_its_scans_at_once() -> None:
    assert scans_at_once(mission_of(scanner(0.9 * AT_ONCE_S)))
    assert not scans_at_once(mission_of(scanner(1.1 * AT_ONCE_S)))
    assert scans_at_once(mission_of(scanner(0.9 * AT_ONCE_S, 2)))
    assert not scans_at_once(mission_of(scanner(0.9 * AT_ONCE_S, 1)))
    assert not scans_at_once(mission_of(scanner(0.9 * AT_ONCE_S), beams()))
    assert not scans_at_once(mission_of())


def test_scans_at_once_are_thinned_by_the_motion() -> None:
    mission, t = mission_of(scanner(0.1)), 0.1 * np.arange(9)
    motion = PlanarMotion(t, np.column_stack([t, 0 * t]), 0 * t, 0.0, 0.0)
    settings = SonarSettings(
        scans=ScanSettings(min_move_m=0.35, min_turn_deg=5.0, min_interval_s=0.19)
    )
    by_motion, by_time = sonar_turns(mission, settings, motion), sonar_turns(mission, settings)
    assert by_motion is not None
    assert by_time is not None
    np.testing.assert_array_equal(by_motion.first, [0, 4, 8])
    np.testing.assert_array_equal(by_time.first, [0, 2, 4, 6, 8])
    turning = PlanarMotion(t, np.zeros((9, 2)), np.radians(20.0) * t, 0.0, 0.0)
    turned = sonar_turns(mission, settings, turning)
    assert turned is not None
    np.testing.assert_array_equal(turned.first, [0, 3, 6])
    slow = mission_of(beams())
    np.testing.assert_array_equal(sonar_turns(slow, settings, motion).first, [0, 40])


def still() -> PlanarMotion:
    return PlanarMotion(np.array([0.0, 9.0]), np.zeros((2, 2)), np.zeros(2), 0.0, 0.0)


def echoes_at(beam: list[int], xy_b: Array | None = None) -> Echoes:
    k = len(beam)
    points = np.column_stack([np.arange(k), np.arange(k)]) + 1.0 if xy_b is None else xy_b
    return Echoes(
        t=np.array(beam, dtype=float),
        beam=np.array(beam),
        xy_b=points,
        cov_b=np.tile(np.eye(2), (k, 1, 1)),
        strength=100.0 + np.arange(k),
    )


TURNS = Turns(np.array([2, 5]), np.array([4, 8]), np.array([3.0, 6.0]))


def test_a_turn_holds_its_first_beam_and_not_its_last() -> None:
    held = TURNS.hold(np.array([0, 1, 2, 3, 4, 5, 7, 8, 9]))
    np.testing.assert_array_equal(held, [0, 0, 1, 1, 0, 1, 1, 0, 0])


def test_echoes_outside_of_the_turns_are_dropped() -> None:
    data = deskewed(echoes_at([0, 2, 3, 4, 7, 8]), TURNS, still())
    np.testing.assert_array_equal(data.echoes.beam, [2, 3, 7])
    np.testing.assert_array_equal(data.echoes.strength, [101.0, 102.0, 104.0])
    assert [len(scan) for scan in data.scans] == [2, 1]


def test_scans_of_fewer_points_can_be_left_out() -> None:
    data = deskewed(echoes_at([2, 3, 5, 5, 7]), TURNS, still())
    enough = data.of_least(3)
    assert enough is not None
    np.testing.assert_array_equal(enough.turns.t_ref, [6.0])
    np.testing.assert_array_equal(enough.echoes.beam, [5, 5, 7])
    assert [scan.t_ref for scan in enough.scans] == [6.0]
    assert data.of_least(4) is None


def test_the_record_of_scans_is_the_scans() -> None:
    data = deskewed(echoes_at([2, 3, 7]), TURNS, still())
    record = registered_scans(mission_of(beams()), data)
    assert record is not None
    assert record.sensor == "sonar"
    np.testing.assert_array_equal(record.first, [0, 2, 3])
    np.testing.assert_array_equal(record.t, TURNS.t_ref)
    np.testing.assert_array_equal(record.first_beam, TURNS.first)
    np.testing.assert_array_equal(record.last_beam, TURNS.last)
    np.testing.assert_allclose(record.xy, [[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]])
    assert registered_scans(mission_of(scans()), data) is not None
    assert registered_scans(mission_of(), data) is None


def moving() -> Trajectory:
    """Two seconds along (3, 4, 1) while the heading crosses south; roll and pitch are no matter."""
    yaw = np.array([3.0, 3.4])
    return Trajectory(
        t=np.array([2.0, 4.0]),
        p_n=np.array([[10.0, 20.0, 1.0], [13.0, 24.0, 2.0]]),
        q_nb_wxyz=quaternion_from_rpy(np.column_stack([[0.1, 0.2], [-0.1, 0.1], yaw])),
    )


def test_the_map_has_echoes_where_the_trajectory_puts_them() -> None:
    sonar = sonar_map(echoes_at([1, 2, 3, 4, 5], np.tile([5.0, 2.0], (5, 1))), moving())
    np.testing.assert_array_equal(sonar.t, [2.0, 3.0, 4.0])
    np.testing.assert_array_equal(sonar.strength, [101.0, 102.0, 103.0])
    yaw = 3.2
    ahead, starboard = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    placed = np.array([11.5, 22.0]) + 5.0 * ahead + 2.0 * starboard
    np.testing.assert_allclose(sonar.points_n[1], [*placed, 1.5])


def test_planar_motion_is_that_of_the_trajectory() -> None:
    motion = PlanarMotion.of(moving(), 0.5, 0.25)
    np.testing.assert_allclose(motion.yaw, [3.0, 3.4])
    assert (motion.position_variance_m2_s, motion.yaw_variance_rad2_s) == (0.5, 0.25)
    ne, yaw = motion.at(np.array([0.0, 3.0, 9.0]))
    np.testing.assert_allclose(ne, [[10.0, 20.0], [11.5, 22.0], [13.0, 24.0]])
    np.testing.assert_allclose(yaw, [3.0, 3.2, 3.4])
