"""Sign and zero of a head angle, by the map that it draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.audit.courses import Velocity
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.sonar_map import map_findings, map_likeness, sweeps_of
from gtsam_nav.frames import Array, rotation_from_rpy, wrap_angle
from gtsam_nav.mission import Sensor
from gtsam_nav.series import BeamSeries, HeadingSeries

T = np.arange(0.0, 400.0, 0.1)
YAW = 0.02 * T + 0.4 * np.sin(T / 20.0)
V_N = 0.5 * np.column_stack([np.cos(YAW), np.sin(YAW)])
P_N = np.cumsum(V_N, axis=0) * 0.1
ANGLE = np.radians(3.0) * np.arange(len(T))
MOUNTING = rotation_from_rpy([0.0, 0.0, np.pi])


def ranges(p_n: Array) -> Array:
    """To the walls of a lopsided room."""
    bearing = YAW + np.pi + ANGLE
    c, s = np.cos(bearing), np.sin(bearing)
    with np.errstate(divide="ignore"):
        along = np.where(c > 0, 50.0 - p_n[:, 0], p_n[:, 0] + 35.0) / abs(c)
        across = np.where(s > 0, 60.0 - p_n[:, 1], p_n[:, 1] + 25.0) / abs(s)
    return np.minimum(along, across)


def sonar(angle: Array = ANGLE, R_bs: Array = MOUNTING, p_n: Array = P_N) -> Sensor:
    intensity = np.zeros((len(T), 220), dtype=np.uint8)
    intensity[np.arange(len(T)), np.minimum((ranges(p_n) / 0.5).astype(int), 219)] = 200
    series = BeamSeries(t=T, angle=wrap_angle(angle), intensity=intensity, resolution_m=0.5)
    return Sensor("sonar", "beams", series, R_bs=R_bs)


COMPASS = HeadingSeries(t=T, heading=wrap_angle(YAW), sigma=np.full(len(T), 0.01))
LOG = Velocity("dvl", T, np.tile([0.5, 0.0, 0.0], (len(T), 1)), np.eye(3))


def judged(sensor: Sensor, velocity: Velocity | None = LOG) -> Finding:
    sweeps = sweeps_of(sensor, COMPASS, velocity, 120)
    assert sweeps is not None
    like = map_likeness(sweeps, knows_way=velocity is not None)
    (finding,) = map_findings(sensor, like, ())
    return finding


def test_a_sonar_as_stated_is_fine() -> None:
    assert judged(sonar()).severity == "ok"
    # turned upside down, and its angle counting the other way: the same sonar
    upside_down = MOUNTING @ np.diag([1.0, -1.0, -1.0])
    assert judged(sonar(-ANGLE, upside_down)).severity == "ok"


def test_a_mirrored_sonar_is_mounted_upside_down() -> None:
    found = judged(sonar(-ANGLE))
    assert (found.check, found.severity) == ("sonar handedness", "warning")
    assert found.fix.startswith("rpy_deg: [180, 0, ")


@pytest.mark.parametrize("offset_deg", [-30.0, 90.0, 180.0])
def test_a_wrong_zero_is_measured(offset_deg: float) -> None:
    found = judged(sonar(R_bs=rotation_from_rpy([0, 0, np.radians(offset_deg)]) @ MOUNTING))
    assert found.check == "sonar head offset"
    yaw_deg = float(found.fix.split(",")[-1].strip(" ]"))
    assert abs(np.degrees(wrap_angle(np.radians(yaw_deg - 180.0)))) < 4.0


def test_a_sonar_at_rest_shows_neither() -> None:
    still = HeadingSeries(t=T, heading=0 * T, sigma=np.full(len(T), 0.01))
    resting = replace(LOG, v_s=0 * LOG.v_s)
    assert sweeps_of(sonar(), still, resting, 120) is None


def test_turns_alone_show_the_sign_and_not_the_zero() -> None:
    on_the_spot = 0.0 * P_N
    offset = rotation_from_rpy([0, 0, np.radians(90.0)]) @ MOUNTING
    assert judged(sonar(R_bs=offset, p_n=on_the_spot), None).severity == "ok"
    found = judged(sonar(-ANGLE, p_n=on_the_spot), None)
    assert (found.check, found.severity) == ("sonar handedness", "warning")
