"""The audit on missions whose faults are known."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gtsam_nav.audit import Audit, audit
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.timing import TIMING_CHECKS
from gtsam_nav.errors import DataError
from gtsam_nav.frames import (
    Array,
    Origin,
    geodetic_from_ned,
    ned_from_geodetic,
    rotation_from_rpy,
    wrap_angle,
)
from gtsam_nav.methods import estimate, methods
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.readers import open_mission
from gtsam_nav.series import (
    BeamSeries,
    DepthSeries,
    DvlSeries,
    GnssSeries,
    HeadingSeries,
    ImuSeries,
)

REST_S = 20.0
SPEED_M_S = 0.5
GRAVITY_M_S2 = 9.8


def true_heading(t: Array) -> Array:
    """Wobbling circles that begin after the rest."""
    moving = np.maximum(t - REST_S, 0.0)
    return 0.4 + 0.03 * moving + 0.3 * np.sin(moving / 8.0)


def true_position(t: Array) -> Array:
    fine = np.arange(0.0, t[-1] + 0.2, 0.1)
    speed = np.where(fine < REST_S, 0.0, SPEED_M_S)
    way = np.cumsum(speed * np.exp(1j * true_heading(fine))) * 0.1
    return np.stack([np.interp(t, fine, way.real), np.interp(t, fine, way.imag)], axis=1)


def room_ranges(p_n: Array, bearing: Array) -> Array:
    """Ranges to the walls of a lopsided room around the circles."""
    c, s = np.cos(bearing), np.sin(bearing)
    with np.errstate(divide="ignore"):
        north_south = np.where(c > 0, 45.0 - p_n[:, 0], p_n[:, 0] + 40.0) / abs(c)
        east_west = np.where(s > 0, 50.0 - p_n[:, 1], p_n[:, 1] + 30.0) / abs(s)
    return np.minimum(north_south, east_west)


@pytest.fixture
def mission() -> Mission:
    """A mission without faults: rest, then 10 min of circling."""
    rng = np.random.default_rng(3)
    t_imu, t_ahrs, t_dvl = np.arange(0, 620, 0.05), np.arange(0, 620, 0.1), np.arange(0, 620, 0.4)
    t_gnss, t_beam = np.arange(0.0, 620.0), np.arange(0, 620, 0.1)
    yaw_rate = np.gradient(true_heading(t_imu), t_imu)
    gyro_b = np.stack([0 * t_imu, 0 * t_imu, yaw_rate], axis=1)
    accel_b = np.tile([0.0, 0.0, -GRAVITY_M_S2], (len(t_imu), 1))
    R_bi = rotation_from_rpy([0.0, 0.0, 0.7])
    v_b = np.where(t_dvl[:, None] < REST_S, 0.0, [[SPEED_M_S, 0.0, 0.0]])
    angle = np.radians(3.0) * np.arange(len(t_beam))
    ranges = room_ranges(true_position(t_beam), true_heading(t_beam) + np.pi + angle)
    intensity = np.zeros((len(t_beam), 200), dtype=np.uint8)
    intensity[np.arange(len(t_beam)), (ranges / 0.5).astype(int)] = 200
    p_n = np.column_stack([true_position(t_gnss), np.zeros(len(t_gnss))])
    sensors = [
        Sensor(
            "imu",
            "imu",
            ImuSeries(
                t=t_imu,
                gyro_i=gyro_b @ R_bi + rng.normal(0, 1e-3, gyro_b.shape),
                accel_i=accel_b @ R_bi + rng.normal(0, 1e-2, accel_b.shape),
            ),
            R_bs=R_bi,
        ),
        Sensor(
            "dvl",
            "dvl",
            DvlSeries(
                t=t_dvl,
                v_d=v_b + rng.normal(0, 0.02, v_b.shape),
                sigma=np.full(len(t_dvl), 0.02),
                valid=np.ones(len(t_dvl), dtype=bool),
                bottom_lock=np.ones(len(t_dvl), dtype=bool),
            ),
        ),
        Sensor(
            "heading",
            "heading",
            HeadingSeries(
                t=t_ahrs, heading=true_heading(t_ahrs), sigma=np.full(len(t_ahrs), np.radians(0.5))
            ),
        ),
        Sensor(
            "gnss",
            "gnss",
            GnssSeries(
                t=t_gnss,
                p_n=p_n + rng.normal(0, 0.3, p_n.shape),
                sigma=np.full((len(t_gnss), 3), 0.5),
            ),
        ),
        Sensor(
            "beams",
            "beams",
            BeamSeries(
                t=t_beam, angle=wrap_angle(angle), intensity=intensity, resolution_m=0.5
            ),
            R_bs=rotation_from_rpy([0.0, 0.0, np.pi]),
        ),
    ]  # fmt: skip
    return Mission("circles", {s.name: s for s in sensors})


def altered(mission: Mission, name: str, change: Callable[..., object], column: str) -> Mission:
    """The mission with one column of one sensor changed."""
    sensor = mission.sensors[name]
    series = replace(sensor.series, **{column: change(getattr(sensor.series, column))})
    return mission.with_sensor(replace(sensor, series=series))


def finding(found: Audit, check: str) -> Finding:
    return next(f for f in found.findings if f.check == check)


def test_a_healthy_mission_has_no_warning(mission: Mission) -> None:
    found = audit(mission)
    assert [f for f in found.findings if f.severity == "warning"] == []
    checks = {f.check for f in found.findings}
    assert checks >= {
        "accelerometer unit",
        "gravity sign",
        "gyro unit",
        "heading against course",
        "bottom lock",
        "sonar head",
        "sonar handedness",
    }


def test_timing_counts_rates_and_spans(mission: Mission) -> None:
    timing = {s.name: s for s in audit(mission).sensors}
    assert timing["imu"].rate_hz == pytest.approx(20.0)
    assert timing["gnss"].n_samples == 620
    assert (timing["gnss"].start_s, timing["gnss"].stop_s) == (0.0, 619.0)
    assert timing["dvl"].gaps == ()


def test_gaps_are_found_where_they_are(mission: Mission) -> None:
    gnss = mission.sensors["gnss"]
    t = gnss.series.t
    holed = replace(gnss, series=gnss.series.select((t <= 100.0) | (t >= 130.0)))
    found = audit(mission.with_sensor(holed))
    gaps = next(s for s in found.sensors if s.name == "gnss").gaps
    assert [(g.start_s, g.length_s) for g in gaps] == [(100.0, 30.0)]
    assert "30.0 s at 100.0 s" in finding(found, "gaps").message


def test_a_sensor_that_ends_early_is_named(mission: Mission) -> None:
    half_s = sum(mission.span_s) / 2
    dvl = mission.sensors["dvl"]
    short = mission.with_sensor(replace(dvl, series=dvl.series.crop(0.0, half_s)))
    (found,) = [f for f in audit(short).findings if f.check == "span"]
    assert found.sensor == "dvl"
    assert found.message.startswith("ends at ")


@pytest.mark.parametrize(("depth_m", "dives"), [(0.1, False), (6.0, True), (None, False)])
def test_so_is_a_receiver_unless_it_dives(
    mission: Mission, depth_m: float | None, dives: bool
) -> None:
    half_s = sum(mission.span_s) / 2
    gnss = mission.sensors["gnss"]
    short = mission.with_sensor(replace(gnss, series=gnss.series.crop(0.0, half_s))).without(
        "depth"
    )
    if depth_m is not None:
        t = np.arange(*mission.span_s)
        down = np.where(t > half_s, depth_m, 0.0)
        series = DepthSeries(t=t, depth_m=down, sigma=np.full(len(t), 0.1))
        short = short.with_sensor(Sensor("depth", "depth", series))
    found = [f.sensor for f in audit(short).findings if f.check == "span"]
    assert found == ([] if dives else ["gnss"])


def test_dropped_samples_are_counted_by_reason(mission: Mission) -> None:
    dropped = [Rejection(float(k), "dvl", k, "time goes back") for k in range(3)]
    found = audit(replace(mission, rejections=(*dropped, Rejection(9.0, "dvl", 9, "not finite"))))
    counted = next(s for s in found.sensors if s.name == "dvl").dropped
    assert [(d.reason, d.n_samples) for d in counted] == [("not finite", 1), ("time goes back", 3)]
    assert sum(f.check == "dropped" and f.severity == "warning" for f in found.findings) == 2
    assert not any(f.check == "mostly dropped" for f in found.findings)


def test_a_sensor_most_of_which_is_dropped_is_told_of_at_once(mission: Mission) -> None:
    n = len(mission.sensors["dvl"].series)
    dropped = [Rejection(float(k), "dvl", k, "not finite") for k in range(n + 1)]
    found = audit(replace(mission, rejections=(*dropped, Rejection(9.0, "dvl", 9, "too fast"))))
    (alert,) = (alert for alert in found.alerts if "dvl: mostly dropped" in alert)
    assert f"{n + 2} of {2 * n + 2} samples" in alert
    assert alert.endswith("not finite")


@pytest.mark.parametrize(
    ("column", "scale", "check", "words"),
    [
        ("gyro_i", 180 / np.pi, "gyro unit", "in deg/s"),
        ("gyro_i", -1.0, "gyro sign", "sign of body z"),
        ("accel_i", 1 / GRAVITY_M_S2, "accelerometer unit", "in g"),
        ("accel_i", 1000 / GRAVITY_M_S2, "accelerometer unit", "in mg"),
        ("accel_i", 0.2, "accelerometer unit", "no known unit"),
        ("accel_i", -1.0, "gravity sign", "gravity is counted as a force"),
    ],
)
def test_imu_in_the_wrong_unit_or_sign(
    mission: Mission, column: str, scale: float, check: str, words: str
) -> None:
    found = finding(audit(altered(mission, "imu", lambda v: v * scale, column)), check)
    assert found.severity == "warning"
    assert words in found.message


def test_gyro_unit_is_judged_without_a_compass(mission: Mission) -> None:
    fast = altered(mission, "imu", lambda v: v * 180 / np.pi + 20.0, "gyro_i").without("heading")
    assert finding(audit(fast), "gyro unit").severity == "warning"
    assert finding(audit(mission.without("heading")), "gyro unit").severity == "ok"


def test_imu_on_its_side(mission: Mission) -> None:
    imu = mission.sensors["imu"]
    on_side = replace(imu, R_bs=rotation_from_rpy([np.pi / 2, 0.0, 0.0]) @ imu.R_bs)
    found = finding(audit(mission.with_sensor(on_side)), "gravity sign")
    assert found.severity == "warning"
    assert "along y" in found.message


def test_heading_offset_is_measured(mission: Mission) -> None:
    turned = altered(mission, "heading", lambda h: wrap_angle(h + np.radians(25.0)), "heading")
    found = audit(turned)
    assert found.headings[0].median_deg == pytest.approx(25.0, abs=2.0)
    assert found.headings[0].n_baselines >= 10
    assert finding(found, "heading against course").severity == "warning"


def test_counter_clockwise_heading_is_recognised(mission: Mission) -> None:
    mirrored = altered(mission, "heading", lambda h: wrap_angle(np.pi / 2 - h), "heading")
    assert "counter-clockwise" in finding(audit(mirrored), "heading against course").message


@pytest.mark.slow
def test_drift_angle_is_taken_out(mission: Mission) -> None:
    """A vehicle that moves sideways: compass 90 deg off the course, and nothing wrong."""
    sideways = altered(mission, "heading", lambda h: wrap_angle(h - np.pi / 2), "heading")
    sideways = altered(sideways, "dvl", lambda v: v[:, [1, 0, 2]], "v_d")
    assert abs(audit(sideways).headings[0].median_deg) < 2.0
    assert audit(sideways).headings[0].convention.is_stated
    assert audit(sideways.without("dvl")).headings[0].convention.turn_deg == 90.0


def test_lever_arm_of_the_antenna_is_taken_out(mission: Mission) -> None:
    gnss = mission.sensors["gnss"]
    lever_b = np.array([0.0, 6.0, 0.0])
    heading = true_heading(gnss.series.t)
    arm_n = np.stack([-6.0 * np.sin(heading), 6.0 * np.cos(heading), 0 * heading], axis=1)
    moved = altered(mission, "gnss", lambda p: p + arm_n, "p_n")
    moved = moved.with_sensor(replace(moved.sensors["gnss"], xyz_b=lever_b))
    assert audit(moved).headings[0].spread_deg < 1.5 * audit(mission).headings[0].spread_deg


def test_lost_bottom_lock(mission: Mission) -> None:
    lost = altered(mission, "dvl", lambda v: v & (np.arange(len(v)) % 2 == 0), "bottom_lock")
    found = audit(lost)
    assert found.dvls[0].bottom_share == pytest.approx(0.5, abs=0.01)
    assert found.dvls[0].water_share == pytest.approx(0.5, abs=0.01)
    assert found.dvls[0].longest_outage_s == pytest.approx(0.8)
    assert finding(found, "bottom lock").severity == "warning"


def test_sonar_head(mission: Mission) -> None:
    head = audit(mission).sonars[0]
    assert head.step_deg == pytest.approx(3.0)
    assert head.beams_per_sweep == 120
    assert (head.sector_deg, head.clockwise_share, head.n_reversals) == (360.0, 1.0, 0)
    assert head.n_sweeps == pytest.approx(6200 / 120)
    assert head.silent_share == 0.0


@pytest.mark.parametrize(("unit", "a_turn"), [("degrees", 360.0), ("gradians", 400.0)])
def test_head_angles_in_another_unit(mission: Mission, unit: str, a_turn: float) -> None:
    def read(angle: Array) -> Array:
        return np.asarray(a_turn * (angle / (2 * np.pi) % 1.0))

    found = audit(altered(mission, "beams", read, "angle"))
    assert f"in {unit}, not in rad" in finding(found, "sonar angle unit").message
    assert not [f for f in found.findings if f.check in ("sonar handedness", "sonar head offset")]


def test_bins_that_reach_too_far(mission: Mission) -> None:
    sonar = mission.of_type("beams")[0]
    assert isinstance(sonar.series, BeamSeries)
    assert audit(mission).sonars[0].range_m == pytest.approx(100.0)
    in_cm = replace(sonar, series=replace(sonar.series, resolution_m=50.0))
    assert "not in m" in finding(audit(mission.with_sensor(in_cm)), "sonar range").message


def test_sector_that_is_swept_back_and_forth(mission: Mission) -> None:
    def swing(angle: Array) -> Array:
        k = np.arange(len(angle)) % 80
        return np.radians(3.0) * np.where(k < 40, k, 80 - k)

    head = audit(altered(mission, "beams", swing, "angle")).sonars[0]
    assert head.sector_deg == pytest.approx(123.0)
    assert head.n_reversals == pytest.approx(2 * 6200 / 80, abs=2)
    assert head.clockwise_share == pytest.approx(0.5, abs=0.02)


def test_mirrored_head_angle_is_recognised(mission: Mission) -> None:
    found = audit(altered(mission, "beams", lambda a: -a, "angle"))
    assert found.sonars[0].clockwise_share == 0.0
    assert finding(found, "sonar handedness").severity == "warning"


def test_frozen_head_and_silent_sonar(mission: Mission) -> None:
    frozen = audit(altered(mission, "beams", np.zeros_like, "angle"))
    assert frozen.sonars == ()
    assert finding(frozen, "sonar head").severity == "warning"
    silent = audit(altered(mission, "beams", np.zeros_like, "intensity"))
    assert silent.sonars[0].silent_share == 1.0
    assert finding(silent, "sonar echoes").severity == "warning"


def test_rest_ends_when_the_vehicle_moves(mission: Mission) -> None:
    assert audit(mission).rest_s == pytest.approx(REST_S, abs=5.0)
    assert audit(mission.without("imu")).rest_s == pytest.approx(REST_S, abs=5.0)
    assert audit(mission.without("imu", "dvl")).rest_s is None


@pytest.mark.slow
@pytest.mark.parametrize("lacking", [(), ("dvl",), ("heading",), ("gnss",), ("beams", "imu")])
def test_methods_that_are_said_to_run_do_run(mission: Mission, lacking: tuple[str, ...]) -> None:
    part = mission.without(*lacking).crop(0.0, 60.0)
    runnable = audit(part).methods
    for method in methods():
        if method in runnable:
            assert len(estimate(part, method).trajectory) > 0
        else:
            with pytest.raises(DataError):
                estimate(part, method)


@pytest.mark.slow
@pytest.mark.realdata
def test_st_pere_marina(stpere_folder: Path) -> None:
    """What the logs are known for: a disturbed compass, a sonar gap, a rest at the surface."""
    found = audit(open_mission(stpere_folder))
    course = found.headings[0]
    assert abs(course.median_deg) < 10.0
    assert 1.0 < course.spread_deg < 10.0
    assert found.dvls[0].bottom_share == pytest.approx(1 - 84 / 5045)
    assert found.sonars[0].beams_per_sweep == 200
    assert found.sonars[0].clockwise_share > 0.99
    assert {f.check for f in found.findings if f.severity == "warning"} == {"gaps"}
    assert "10.6 s at 3009" in finding(found, "gaps").message
    mirrored = altered(open_mission(stpere_folder), "sonar", lambda angle: -angle, "angle")
    assert finding(audit(mirrored), "sonar handedness").severity == "warning"


def test_sensors_without_samples_do_not_stop_the_audit(mission: Mission) -> None:
    found = audit(mission.crop(1e6))
    assert {s.n_samples for s in found.sensors} == {0}
    assert found.methods == ()


@pytest.mark.parametrize("n", [1, 30])
def test_thin_sensors_do_not_stop_the_audit(mission: Mission, n: int) -> None:
    for sensor in mission.sensors.values():
        thin = replace(sensor, series=sensor.series.select(slice(600, 600 + n)))
        audit(mission.with_sensor(thin))


def test_an_absurd_way_does_not_stop_the_audit(mission: Mission) -> None:
    assert audit(altered(mission, "dvl", lambda v: v * 1e6, "v_d")).methods


def test_json_document_is_plain(mission: Mission) -> None:
    document = json.loads(json.dumps(audit(mission).to_json(), allow_nan=False))
    assert document["sensors"][0]["name"] == "imu"
    assert document["headings"][0]["velocity"] == "dvl"
    assert document["headings"][0]["convention"]["name"] == "clockwise from north"
    spoilt = altered(mission, "imu", lambda a: a / GRAVITY_M_S2, "accel_i")
    fixes = {f["check"]: f["fix"] for f in audit(spoilt).to_json()["findings"]}
    assert fixes["accelerometer unit"] == "accel_unit: g"
    assert fixes["gyro unit"] == ""


def test_a_dvl_without_a_valid_sample_measures_no_velocity(mission: Mission) -> None:
    found = audit(altered(mission, "dvl", np.zeros_like, "valid"))
    assert set(found.methods) == {"ins-ekf", "graph"}


def test_fixes_far_from_the_origin_are_named_with_the_likely_cause(mission: Mission) -> None:
    mission = replace(mission, origin=Origin(latitude_deg=42.2, longitude_deg=3.1))
    assert mission.origin is not None
    assert finding(audit(mission), "fixes against origin").severity == "ok"
    gnss = mission.sensors["gnss"].series
    assert isinstance(gnss, GnssSeries)
    latitude_deg, longitude_deg, height_m = geodetic_from_ned(gnss.p_n, mission.origin)
    exchanged_n = ned_from_geodetic(longitude_deg, latitude_deg, height_m, mission.origin)
    found = audit(altered(mission, "gnss", lambda _: exchanged_n, "p_n"))
    assert "latitude and longitude are exchanged" in finding(found, "fixes against origin").message
    assert any("exchanged" in alert for alert in found.alerts)
    warnings = [f for f in found.findings if f.severity == "warning"]
    (only,) = [f for f in warnings if f.check not in TIMING_CHECKS]
    assert only.fix == "columns: {lat_deg: lon_deg, lon_deg: lat_deg}"
    assert not found.headings
    elsewhere = audit(altered(mission, "gnss", lambda p_n: p_n + 1e6, "p_n"))
    assert "the origin or the fixes are wrong" in finding(elsewhere, "fixes against origin").message


def test_stamps_in_nanoseconds_do_not_stop_the_audit(mission: Mission) -> None:
    found = audit(altered(mission, "imu", lambda t: 1e9 * t, "t"))
    assert finding(found, "stamp unit").fix == "scale: {t: 1e-09}"
    assert found.rest_s == pytest.approx(REST_S, abs=10.0)


def test_misplaced_fixes_may_be_all_there_is(mission: Mission) -> None:
    names = [name for name in mission.sensors if name != "gnss"]
    alone = replace(mission.without(*names), origin=Origin(latitude_deg=42.2, longitude_deg=3.1))
    found = audit(altered(alone, "gnss", lambda p_n: p_n + 1e6, "p_n"))
    assert finding(found, "fixes against origin").severity == "warning"


def test_alerts_leave_gaps_to_the_timeline(mission: Mission) -> None:
    silent = altered(mission, "imu", lambda gyro: gyro * np.degrees(1.0), "gyro_i")
    series = silent.sensors["dvl"].series
    late = replace(silent.sensors["dvl"], series=series.select((series.t < 50) | (series.t > 90)))
    found = audit(silent.with_sensor(late))
    assert finding(found, "gaps").severity == "warning"
    assert len(found.alerts) == 1
    assert found.alerts[0].startswith("imu: gyro unit:")
    assert found.alerts[0].endswith("in the card: gyro_unit: deg/s")
