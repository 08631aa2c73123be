"""Which way velocities go, and who is wrong about it."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
import pytest

from gtsam_nav.audit.courses import BOW, Baselines, Velocity
from gtsam_nav.audit.directions import (
    AXES,
    TRACK,
    DirectionPair,
    direction_blame,
    direction_findings,
    direction_pairs,
)
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.heading import CONVENTIONS, heading_against_course
from gtsam_nav.audit.heading import heading_findings as judged
from gtsam_nav.audit.receiver import velocity_findings
from gtsam_nav.frames import Array, rotation_from_rpy, wrap_angle
from gtsam_nav.mission import Sensor
from gtsam_nav.series import GnssSeries, HeadingSeries

T = np.arange(0.0, 600.0)
HEADING = 0.4 + 0.03 * T + 0.3 * np.sin(T / 8.0)
RNG = np.random.default_rng(3)
V_N = np.column_stack([np.cos(HEADING), np.sin(HEADING), 0.0 * T])
P_N = np.cumsum(V_N, axis=0)
R_BD = rotation_from_rpy([0.0, 0.0, np.radians(45.0)])
STATED = {BOW: 0.0, TRACK: 0.5, "dvl": 0.2, "odometry": 0.5}


@pytest.fixture(autouse=True)
def same_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever tests ran before."""
    monkeypatch.setitem(globals(), "RNG", np.random.default_rng(3))


def receiver(p_n: Array = P_N, v_n: Array | None = None) -> Sensor:
    noisy = p_n + RNG.normal(0.0, 0.2, p_n.shape)
    series = GnssSeries(t=T, p_n=noisy, sigma=np.full(p_n.shape, 0.3), v_n=v_n)
    return Sensor("gnss", "gnss", series)


def ways(p_n: Array = P_N, heading: Array = HEADING) -> Baselines:
    fixes = receiver(p_n).series
    assert isinstance(fixes, GnssSeries)
    compass = HeadingSeries(
        t=T, heading=wrap_angle(heading + RNG.normal(0, 0.02, len(T))), sigma=np.full(len(T), 0.02)
    )
    k = np.arange(0, len(T), 15)
    return Baselines(receiver(p_n), compass, k[:-1], k[1:], fixes, 15.0)


def velocity(name: str = "dvl", turned_deg: float = 0.0, axes: Array | None = None) -> Velocity:
    """Ahead at 1 m/s, through an instrument that stands at 45 deg (+ an error) to the bow."""
    if name == BOW:
        return Velocity(BOW, T, np.tile([1.0, 0.0, 0.0], (len(T), 1)), np.eye(3))
    ahead = rotation_from_rpy([0.0, 0.0, np.radians(turned_deg)]) @ [1.0, 0.0, 0.0]
    v_s = np.tile(R_BD.T @ ahead, (len(T), 1)) + RNG.normal(0, 0.03, (len(T), 3))
    return Velocity(name, T, v_s if axes is None else v_s @ axes.T, R_BD)


def warned(
    *sources: Velocity,
    where: Baselines | None,
    heave: Mapping[str, str] | None = None,
    untold: Collection[str] = (),
) -> dict[str, Finding]:
    pairs = direction_pairs(sources, where, STATED)
    found = direction_findings(sources, where, pairs, direction_blame(pairs), heave or {}, untold)
    return {str(f.sensor): f for f in found if f.severity == "warning"}


def test_sources_that_agree_are_not_warned_of() -> None:
    assert warned(velocity(), velocity("odometry"), velocity(BOW), where=ways()) == {}


@pytest.mark.parametrize("k", range(1, 8))
def test_each_reading_of_the_axes_is_recognised(k: int) -> None:
    """Inverse of what the fix does to the columns; some cannot be told while going straight."""
    axes = np.linalg.inv(AXES[k][2])
    found = warned(velocity(axes=axes), velocity("odometry"), velocity(BOW), where=ways())
    if np.allclose(R_BD @ axes @ R_BD.T @ [1, 0, 0], [1, 0, 0]):
        assert found == {}
        return
    assert list(found) == ["dvl"]
    assert AXES[k][1] in found["dvl"].fix


def test_axes_are_judged_against_odometry_too() -> None:
    reversed_ = velocity(axes=np.diag([-1.0, -1.0, 1.0]))
    found = warned(reversed_, velocity("odometry"), velocity(BOW), where=None)
    assert "scale: {vx: -1, vy: -1}" in found["dvl"].fix


UP = {"dvl": "goes up where imu goes down"}


@pytest.mark.parametrize("with_fixes", [True, False])
def test_an_instrument_that_lies_on_its_back_is_turned(with_fixes: bool) -> None:
    where = ways() if with_fixes else None
    on_its_back = velocity(axes=np.diag([1.0, -1.0, -1.0]))
    found = warned(on_its_back, velocity("odometry"), velocity(BOW), where=where, heave=UP)
    assert found["dvl"].fix == "rpy_deg: [180, 0, 45]"
    assert "goes up where imu goes down: mounted upside down" in found["dvl"].message


def test_without_heave_an_instrument_on_its_back_is_offered_too() -> None:
    on_its_back = velocity(axes=np.diag([1.0, -1.0, -1.0]))
    found = warned(
        on_its_back, velocity("odometry"), velocity(BOW), where=ways(), untold=("dvl", "odometry")
    )
    assert "vy reversed" in found["dvl"].message
    assert "or mounted upside down" in found["dvl"].message
    assert "scale: {vy: -1}" in found["dvl"].fix
    assert "rpy_deg: [180, 0, 45]" in found["dvl"].fix


def test_a_reversed_z_alone_may_be_either() -> None:
    found = warned(velocity(), velocity("odometry"), velocity(BOW), where=ways(), heave=UP)
    assert found["dvl"].fix == "scale: {vz: -1}, or rpy_deg: [180, 0, -45]"


def test_a_vehicle_that_drifts_is_nobodys_fault() -> None:
    sideways = 0.4
    track = ways(heading=HEADING - sideways)
    drifting = velocity(turned_deg=np.degrees(sideways))
    assert warned(drifting, velocity(BOW), where=track) == {}
    assert warned(drifting, velocity(BOW), where=None) == {}


def test_misalignment_is_measured_and_mended() -> None:
    found = warned(velocity(turned_deg=8.0), velocity("odometry"), velocity(BOW), where=ways())
    assert list(found) == ["dvl"]
    assert found["dvl"].check == "velocity alignment"
    yaw_deg = float(found["dvl"].fix.split(",")[-1].strip(" ]"))
    assert yaw_deg == pytest.approx(37.0, abs=1.5)


def test_what_the_cards_allow_is_not_warned_of() -> None:
    errors = np.radians(RNG.normal(6.0, 1.0, 40))
    assert abs(DirectionPair("dvl", TRACK, errors, 3.0).offset_deg) == pytest.approx(6.0, abs=1.0)
    assert DirectionPair("dvl", TRACK, errors, 3.0).limit_deg > 6.5
    assert DirectionPair("dvl", TRACK, errors, 0.2).limit_deg < 2.0


def course(where: Baselines, source: Velocity | None = None) -> str:
    found = heading_against_course("heading", where, source or velocity(BOW))
    assert found is not None
    return found.convention.fix


@pytest.mark.parametrize("k", range(len(CONVENTIONS)))
def test_conventions_of_a_compass(k: int) -> None:
    meant = CONVENTIONS[k]
    written = meant.sign * (HEADING - np.radians(meant.turn_deg))
    assert course(ways(heading=written)) == meant.fix


def test_a_magnetic_compass_has_its_declination_already() -> None:
    off = heading_against_course("heading", ways(heading=HEADING + 0.3), velocity(BOW))
    assert off is not None
    (stated,), (magnetic,) = judged(off, 1.0, ()), judged(off, 1.0, (), is_magnetic=True)
    assert stated.fix.startswith("noise: {declination_deg: -1")
    assert magnetic.fix.startswith("rpy_deg: [0, 0, 1")


def test_a_compass_that_has_nothing_to_do_with_the_course() -> None:
    lost = ways(heading=RNG.uniform(-np.pi, np.pi) + 0.31 * T)
    found = heading_against_course("heading", lost, velocity(BOW))
    assert found is not None
    (finding,) = judged(found, 5.0, ())
    assert finding.severity == "warning"
    assert "does not follow" in finding.message


@pytest.mark.parametrize(
    ("order", "signs", "fix"),
    [
        ([1, 0, 2], (1, 1, -1), "columns: {vn: ve, ve: vn}, scale: {vd: -1}"),
        ([0, 1, 2], (-1, 1, 1), "scale: {vn: -1}"),
        ([0, 1, 2], (1, -1, 1), "scale: {ve: -1}"),
        ([0, 1, 2], (-1, -1, 1), "scale: {vn: -1, ve: -1}"),
    ],
)
def test_velocities_of_a_receiver(order: list[int], signs: tuple[int, ...], fix: str) -> None:
    noisy = V_N + RNG.normal(0, 0.1, V_N.shape)
    (fine,) = velocity_findings(receiver(v_n=noisy))
    assert fine.severity == "ok"
    (found,) = velocity_findings(receiver(v_n=noisy[:, order] * np.array(signs)))
    assert found.fix == fix
