"""Messages that came twice under two stamps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtsam_nav.audit import audit
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.lagged_products import Signal
from gtsam_nav.audit.repeats import frozen_findings, repeat_findings, stuck_findings
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.repeats import REPEATED, repeats_of, without_repeats
from gtsam_nav.series import DepthSeries, DvlSeries, HeadingSeries, ImuSeries
from gtsam_nav.simulation import simulate

N = 2000
RNG = np.random.default_rng(2)
TURNING = np.sin(np.arange(N) / 50.0)


@pytest.fixture(autouse=True)
def same_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever tests ran before."""
    monkeypatch.setitem(globals(), "RNG", np.random.default_rng(2))


def compass(heading: Array) -> Sensor:
    series = HeadingSeries(t=np.arange(N) * 0.1, heading=heading, sigma=np.full(N, 0.01))
    return Sensor("heading", "heading", series)


def sent_again(values: Array, every: int) -> Array:
    k = np.arange(len(values))
    return values[k - (k % every == every - 1)]


@pytest.mark.parametrize("by", ["imu", "nothing", "a steady turn"])
def test_a_compass_that_froze_while_the_vehicle_turns(by: str) -> None:
    frozen = TURNING + RNG.normal(0.0, 0.001, N)
    frozen[1200:] = frozen[1199]
    sensor, t = compass(frozen), np.arange(N) * 0.1
    swings = {"imu": Signal(t, TURNING + 0.01 * t)}
    seen = {"imu": swings, "nothing": {}, "a steady turn": {"imu": Signal(t, 0.02 * t)}}[by]
    findings = list(frozen_findings(sensor, seen))
    if by != "imu":
        assert findings == []
        return
    assert findings[0].fix == "drop_repeats: true"
    assert (
        "from 119.9 to 199.9 s, while by imu the vehicle turns to and fro by" in findings[0].message
    )


def found(sensor: Sensor) -> list[Finding]:
    return list(repeat_findings(sensor))


def test_noise_does_not_repeat() -> None:
    assert found(compass(TURNING + RNG.normal(0, 0.01, N))) == []


def test_a_message_that_is_sent_again_is_found() -> None:
    (finding,) = found(compass(sent_again(TURNING + RNG.normal(0, 0.01, N), 10)))
    assert (finding.check, finding.severity) == ("stale messages", "warning")
    assert "200 of 2000 samples" in finding.message
    assert finding.fix == "drop_repeats: true"


def test_a_driver_twice_as_fast_as_its_sensor_is_found() -> None:
    assert len(found(compass(sent_again(TURNING + RNG.normal(0, 0.01, N), 2)))) == 1


@pytest.mark.parametrize(("every", "severity"), [(50, "ok"), (2, "warning")])
def test_a_few_held_readings_of_an_imu_are_to_be_kept(every: int, severity: str) -> None:
    """They are integrated: a gap would be no better."""
    rates, force = RNG.normal(size=(N, 3)), np.tile([0.0, 0.0, -9.8], (N, 1))
    series = ImuSeries(
        t=np.arange(N) * 0.01,
        gyro_i=sent_again(rates, every),
        accel_i=sent_again(force + rates, every),
    )
    (finding,) = found(Sensor("imu", "imu", series))
    assert finding.severity == severity
    assert (finding.fix == "") == (severity == "ok")


def test_repeats_that_the_resolution_explains_are_not_told() -> None:
    for step in (1e-4, 1e-3, 0.05, 1.0):
        noisy = TURNING + RNG.normal(0, 0.01, N)
        assert found(compass(np.round(noisy / step) * step)) == [], step


def test_an_output_that_is_held_at_rest_is_one_place() -> None:
    held = TURNING + RNG.normal(0, 0.01, N)
    held[300:900] = held[300]
    assert found(compass(held)) == []


def test_coarse_gauges_are_not_judged() -> None:
    depth = DepthSeries(t=np.arange(N) * 1.0, depth_m=np.zeros(N), sigma=np.full(N, 0.1))
    assert repeats_of(depth) is None
    assert found(Sensor("depth", "depth", depth)) == []


def test_a_dvl_without_lock_repeats_nothing() -> None:
    valid = np.arange(N) % 4 != 0
    v_d = np.where(valid[:, None], RNG.normal(size=(N, 3)), 0.0)
    series = DvlSeries(
        t=np.arange(N) * 0.2, v_d=v_d, sigma=np.full(N, 0.02), valid=valid, bottom_lock=valid
    )
    assert found(Sensor("dvl", "dvl", series)) == []
    none = replace(series, valid=np.zeros(N, dtype=bool))
    assert found(Sensor("dvl", "dvl", none)) == []


def test_repeats_are_dropped_with_their_reason() -> None:
    sensor = compass(sent_again(TURNING + RNG.normal(0, 0.01, N), 10))
    series, rejections = without_repeats("heading", sensor.series)
    assert len(series) == N - 200
    assert {r.reason for r in rejections} == {REPEATED}
    assert [r.index for r in rejections[:2]] == [9, 19]
    assert found(replace(sensor, series=series)) == []


def test_a_sensor_that_reads_the_same_throughout_is_stuck() -> None:
    dead = compass(np.full(N, 1.5))
    (finding,) = stuck_findings(Mission("dead", {"heading": dead}))
    assert (finding.check, finding.sensor, finding.severity) == ("stuck", "heading", "warning")
    assert not list(stuck_findings(Mission("alive", {"heading": compass(TURNING)})))


def test_what_a_stuck_sensor_says_of_others_is_not_told() -> None:
    mission = simulate("laps", 2, 100.0)
    dead = mission.with_sensor(compass(np.full(N, 1.5)))
    warned = [
        f.check for f in audit(dead).findings if f.severity == "warning" and f.check != "span"
    ]
    assert warned == ["stuck"]
