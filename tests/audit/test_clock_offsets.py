"""Whose clock it is that is off."""

from __future__ import annotations

import gtsam_nav as gn
from gtsam_nav.audit import audit
from gtsam_nav.audit.agreement import Lag
from gtsam_nav.audit.clocks import ClockPair, clock_findings
from gtsam_nav.audit.findings import Finding


def pair(y: str, x: str, lag_s: float, sigma_s: float = 0.01, stated_s: float = 0.0) -> ClockPair:
    return ClockPair(y, x, "turns", Lag(lag_s, sigma_s, 0.1, 40), stated_s)


def warned(*pairs: ClockPair) -> dict[str | None, Finding]:
    return {f.sensor: f for f in clock_findings(pairs) if f.severity == "warning"}


def test_clocks_that_agree() -> None:
    (finding,) = clock_findings([pair("heading", "imu", 0.02), pair("dvl", "imu", -0.04)])
    assert (finding.severity, finding.sensor) == ("ok", None)
    assert "dvl and imu to 0.04 s" in finding.message
    assert list(clock_findings([])) == []


def test_a_third_clock_tells_whose_is_off() -> None:
    found = warned(
        pair("heading", "imu", 0.5), pair("dvl", "imu", 0.52), pair("dvl", "heading", 0.01)
    )
    assert list(found) == ["imu"]
    assert found["imu"].fix == "time_offset_s: -0.51 (added to what it has)"
    assert "later than heading" in found["imu"].message


def test_what_is_added_is_of_the_sensor_itself() -> None:
    found = warned(pair("heading", "imu", -0.5), pair("odometry", "imu", 0.01))
    assert list(found) == ["heading"]
    assert found["heading"].fix == "time_offset_s: -0.50 (added to what it has)"


def test_two_alone_are_both_named() -> None:
    found = warned(pair("heading", "imu", -0.5))
    assert set(found) == {"heading", "imu"}
    assert "unless the clock of imu is wrong" in found["heading"].message


def test_a_clock_that_is_off_does_not_hide_one_that_nothing_tells() -> None:
    found = clock_findings([pair("heading", "imu", -0.5)], ("heading", "imu", "gnss"))
    (said,) = [f for f in found if f.severity == "ok"]
    assert said.message == "of the clock of gnss nothing tells"


def test_noise_and_stated_doubts_explain_an_offset() -> None:
    assert warned(pair("gnss", "dvl", 0.5, sigma_s=0.15)) == {}
    assert warned(pair("gnss", "dvl", 0.5, stated_s=0.3)) == {}
    assert warned(pair("gnss", "dvl", 0.09)) == {}


def test_a_pair_that_could_not_have_told_is_no_witness() -> None:
    vague = pair("depth", "dvl", 0.1, sigma_s=0.5)
    assert set(warned(pair("dvl", "imu", -0.5), vague)) == {"dvl", "imu"}


def test_what_the_data_cannot_tell_is_no_agreement() -> None:
    vague = pair("gnss", "imu", 0.85, sigma_s=1.0)
    (finding,) = clock_findings([pair("heading", "imu", 0.02), vague])
    assert "the clocks of heading, imu agree, heading and imu to 0.02 s" in finding.message
    assert "of gnss's the data do not tell (0.85 s against imu, sigma 1.00 s)" in finding.message
    (alone,) = clock_findings([vague])
    assert "agree" not in alone.message
    (doubted,) = clock_findings([pair("gnss", "imu", 0.02, stated_s=0.5)])
    assert "the clocks of gnss, imu agree" in doubted.message


def test_a_clock_that_nothing_tells_is_said() -> None:
    mission = gn.simulate("laps", 2, 100.0)
    (finding,) = [f for f in audit(mission).findings if f.check == "clock offset"]
    assert finding.severity == "ok"
    assert "of the clock of gnss nothing tells" in finding.message
