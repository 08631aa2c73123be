"""NMEA 0183: invented sentences with every fault, and a recorded surface vessel."""

from __future__ import annotations

from collections import Counter
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
import yaml

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Origin
from gtsam_nav.methods import estimate
from gtsam_nav.mission import Mission
from gtsam_nav.readers import open_mission
from gtsam_nav.sensors.orientation import headings_true
from gtsam_nav.series import DvlSeries, GnssSeries, HeadingSeries
from gtsam_nav.writers.mission_folder import write_mission

KNOT_M_S = 1852 / 3600


def sentence(body: str) -> str:
    checksum = 0
    for character in body:
        checksum ^= ord(character)
    return f"${body}*{checksum:02X}"


def gga(
    time: str, quality: int = 4, minutes: float = 30.0, hdop: float = 1.0, west: float = 15.0
) -> str:
    place = f"45{minutes:08.5f},N,003{west:08.5f},W"
    return sentence(f"GPGGA,{time},{place},{quality},12,{hdop},5.0,M,48.0,M,,")


def rmc(
    time: str, date: str, status: str = "A", speed: float = 2.0, course: float | str = 90.0
) -> str:
    place = "4530.00000,N,00315.00000,W"
    return sentence(f"GPRMC,{time},{status},{place},{speed},{course},{date},,,A")


def hdt(degrees: float | str) -> str:
    return sentence(f"GPHDT,{degrees},T")


def log(folder: Path, *lines: str, end: str = "\n") -> Mission:
    path = folder / "log.nmea"
    path.write_text("\n".join(lines) + end)
    return open_mission(path)


def fixes_of(mission: Mission) -> GnssSeries:
    series = mission.sensors["gnss"].series
    assert isinstance(series, GnssSeries)
    return series


def test_a_position_is_geodetic_and_its_height_is_above_the_ellipsoid(tmp_path: Path) -> None:
    read = log(tmp_path, rmc("120000.0", "010224"), gga("120000.0"), gga("120001.0", hdop=2.5))
    assert read.origin == Origin(45.5, -3.25, 53.0)
    assert read.start_utc == datetime(2024, 2, 1, 12, tzinfo=UTC).timestamp()
    series = fixes_of(read)
    np.testing.assert_allclose(series.t, [0.0, 1.0])
    # RTK fixed, 0.02 m, times HDOP; the vertical is twice as uncertain
    np.testing.assert_allclose(series.sigma, [[0.02, 0.02, 0.04], [0.05, 0.05, 0.1]])


def test_speed_and_course_go_with_the_fixes(tmp_path: Path) -> None:
    read = log(tmp_path, *(line for k in range(3) for line in (
        rmc(f"12000{k}.0", "010224"), gga(f"12000{k}.0"))))  # fmt: skip
    v_n = fixes_of(read).v_n
    assert v_n is not None
    np.testing.assert_allclose(v_n, np.tile([0, 2 * KNOT_M_S, 0], (3, 1)), atol=1e-12)


def test_vtg_is_finer_and_a_heading_makes_a_speed_sensor(tmp_path: Path) -> None:
    """Course 90 and heading 60 degrees: two thirds of a right angle to starboard is a third."""
    lines = []
    for k in range(3):
        vtg = sentence("GPVTG,90.0,T,,M,3.888,N,7.2,K,A")
        lines += [rmc(f"12000{k}.0", "010224"), gga(f"12000{k}.0"), vtg, hdt(60.0)]
    read = log(tmp_path, *lines)
    speed, heading = read.sensors["speed"].series, read.sensors["heading"].series
    assert any("what is scored on these is no independent check" in w for w in read.warnings)
    assert isinstance(speed, DvlSeries)
    assert isinstance(heading, HeadingSeries)
    np.testing.assert_allclose(np.degrees(heading.heading), 60.0)
    np.testing.assert_allclose(speed.v_d, np.tile([np.sqrt(3), 1, 0], (3, 1)), atol=1e-12)
    assert fixes_of(read).v_n is None, "the velocity is used once"


def test_where_vtg_is_rare_rmc_tells_the_velocities_between(tmp_path: Path) -> None:
    lines = []
    for k in range(6):
        lines += [rmc(f"12000{k}.0", "010224"), gga(f"12000{k}.0")]
        lines += [sentence("GPVTG,90.0,T,,M,3.888,N,7.2,K,A")] * (k == 3)
    v_n = fixes_of(log(tmp_path, *lines)).v_n
    assert v_n is not None
    east = np.full(6, 2 * KNOT_M_S)
    east[3] = 2.0
    np.testing.assert_allclose(v_n[:, 1], east)


def slow_log(folder: Path, speed: float, *, compass: bool = False) -> Mission:
    """Ten seconds, four of which state a speed (knots) and no course."""
    lines = []
    for k in range(10):
        slow = 3 <= k < 7
        stated = {"speed": speed, "course": ""} if slow else {}
        lines += [rmc(f"12000{k}.0", "010224", **stated), gga(f"12000{k}.0", minutes=30.0 + k)]
        lines += [hdt(90.0)] * compass
    return log(folder, *lines)


def test_what_is_too_slow_for_a_course_rests(tmp_path: Path) -> None:
    v_n = fixes_of(slow_log(tmp_path, 0.05)).v_n
    assert v_n is not None
    np.testing.assert_allclose(v_n[3:7], 0.0)
    np.testing.assert_allclose(v_n[[0, 2, 7, 9], 1], 2 * KNOT_M_S)


def test_fixes_without_a_velocity_near_cost_the_others_theirs_and_it_is_said(
    tmp_path: Path,
) -> None:
    read = slow_log(tmp_path, 1.0)
    assert len(fixes_of(read)) == 10
    assert fixes_of(read).v_n is None
    assert any("2 of 10 fixes have none within 1 s" in w for w in read.warnings)


def test_a_speed_sensor_keeps_the_velocities_that_there_are(tmp_path: Path) -> None:
    read = slow_log(tmp_path, 1.0, compass=True)
    np.testing.assert_allclose(read.sensors["speed"].series.t, [0, 1, 2, 3, 6, 7, 8, 9])
    dropped = Counter((r.sensor, r.reason) for r in read.rejections)
    assert dropped == {("speed", "no velocity near"): 2}


def by_card(folder: Path, sensors: dict[str, object], *lines: str) -> Mission:
    (folder / "card.yaml").write_text(yaml.safe_dump({"mission": {"sensors": sensors}}))
    log(folder, *lines)
    return open_mission(folder / "log.nmea", card=folder / "card.yaml")


def test_sigmas_are_those_of_a_card(tmp_path: Path) -> None:
    lines = [
        *(rmc("120000.0", "010224"), gga("120000.0", hdop=2.0), hdt(60.0)),
        *(gga("120001.0", minutes=31.0), hdt(61.0)),
    ]
    stated = {
        "gnss": {"noise": {"sigma_horizontal_m": 0.5}},
        "heading": {"noise": {"sigma_deg": 3.0}},
        "speed": {"type": "dvl", "noise": {"sigma_m_s": 0.07}},
    }
    read = by_card(tmp_path, stated, *lines)
    np.testing.assert_allclose(fixes_of(read).sigma, [[1.0, 1.0, 2.0], [0.5, 0.5, 1.0]])
    heading, speed = read.sensors["heading"].series, read.sensors["speed"].series
    assert isinstance(heading, HeadingSeries)
    assert isinstance(speed, DvlSeries)
    np.testing.assert_allclose(np.degrees(heading.sigma), 3.0)
    np.testing.assert_allclose(speed.sigma, 0.07)
    vertical = by_card(tmp_path, {"gnss": {"noise": {"sigma_vertical_m": 9.0}}}, *lines)
    np.testing.assert_allclose(fixes_of(vertical).sigma, [[0.04, 0.04, 18.0], [0.02, 0.02, 9.0]])


def test_an_offset_moves_the_zero_and_what_was_dropped(tmp_path: Path) -> None:
    lines = []
    for k in range(5):
        lines += [rmc(f"12000{k}.0", "010224"), gga(f"12000{k}.0"), hdt("" if k == 3 else 60.0 + k)]
    read = by_card(tmp_path, {"heading": {"time_offset_s": -20.0}}, *lines)
    assert read.start_utc == datetime(2024, 2, 1, 11, 59, 40, tzinfo=UTC).timestamp()
    np.testing.assert_allclose(read.sensors["heading"].series.t, [0.0, 1.0, 2.0, 4.0])
    np.testing.assert_allclose(fixes_of(read).t, 20.0 + np.arange(5.0))
    assert {r.t for r in read.rejections if r.sensor == "heading"} == {3.0}
    assert len(read.warnings) == len({*read.warnings})


def test_repeats_are_dropped_on_demand(tmp_path: Path) -> None:
    lines = []
    for k in range(6):
        lines += [gga(f"12000{k}.0", minutes=30.0 + k), hdt(60.0 + k // 2)]
    read = by_card(tmp_path, {"heading": {"drop_repeats": True}}, *lines)
    np.testing.assert_allclose(read.sensors["heading"].series.t, [0.0, 2.0, 4.0])
    assert Counter(r.reason for r in read.rejections) == {"repeats the sample before": 3}


def test_times_pass_midnight_whichever_sentence_comes_first(tmp_path: Path) -> None:
    read = log(
        tmp_path,
        gga("235958.0"),
        rmc("235958.0", "311223"),
        gga("235959.5"),
        gga("000000.5"),
        rmc("000000.5", "010124"),
        gga("000001.0"),
    )
    np.testing.assert_allclose(fixes_of(read).t, [0.0, 1.5, 2.5, 3.0])
    assert read.start_utc == datetime(2023, 12, 31, 23, 59, 58, tzinfo=UTC).timestamp()


def test_without_a_date_there_is_no_utc(tmp_path: Path) -> None:
    read = log(tmp_path, gga("235959.0"), gga("000001.0"))
    np.testing.assert_allclose(fixes_of(read).t, [0.0, 2.0])
    assert read.start_utc is None
    assert any("no RMC sentence tells the date" in w for w in read.warnings)


def test_everything_that_is_dropped_is_counted(tmp_path: Path) -> None:
    good = gga("120001.0")
    read = log(
        tmp_path,
        hdt(1.0),
        gga("120000.0"),
        good[:-2] + "00" if not good.endswith("00") else good[:-2] + "11",
        gga("120002.0", quality=0),
        sentence("GPGGA,1200xx,4530.0,N,00315.0,W,4,12,1.0,5.0,M,48.0,M,,"),
        sentence("GPGGA,126100,4530.0,N,00315.0,W,4,12,1.0,5.0,M,48.0,M,,"),
        "$GPGGA,120004.0,4530.00000,N,00315.00000,W,4,12,1.0,5.0,M,48.0,M,,",
        hdt(""),
        hdt(3.0),
        sentence("GPGSV,1,1,00"),
        "noise",
        gga("120005.0")[:20],
        end="",
    )
    assert Counter((r.sensor, r.reason) for r in read.rejections) == {
        ("heading", "before the first time of day"): 1,
        ("heading", "no heading"): 1,
        ("gnss", "wrong checksum"): 1,
        ("gnss", "no fix"): 1,
        ("gnss", "malformed sentence"): 2,
        ("gnss", "no checksum"): 2,
    }
    assert len(fixes_of(read)) == 1
    assert any("GSV (1)" in w for w in read.warnings)
    assert any("1 lines are no whole sentence" in w for w in read.warnings)


def test_positions_of_rmc_alone(tmp_path: Path) -> None:
    read = log(
        tmp_path, rmc("120000.0", "010224"), rmc("120001.0", "010224", "V"),
        rmc("120002.0", "010224"),
    )  # fmt: skip
    assert len(fixes_of(read)) == 2
    assert Counter(r.reason for r in read.rejections) == {"no fix": 1}


def hdg(degrees: float | str, deviation: str = ",") -> str:
    return sentence(f"HCHDG,{degrees},{deviation},7.1,W")


def vhw(knots: float | str, km_h: float | str = "") -> str:
    return sentence(f"VWVHW,,T,,M,{knots},N,{km_h},K")


def sailed(folder: Path, *others: str, dated: bool = True, seconds: int = 6) -> Mission:
    """A log of fixes and velocities, with other sentences at each of them."""
    lines = []
    for k in range(seconds):
        lines += [rmc(f"12000{k}.0", "010224")] * dated
        lines += [gga(f"12000{k}.0", minutes=30.0 + k), *others]
    return log(folder, *lines)


def test_a_magnetic_heading_is_put_right_by_place_and_date(tmp_path: Path) -> None:
    read = sailed(tmp_path, hdg(60.0, "2.5,W"), sentence("HCHDM,11.0,M"))
    compass = read.sensors["heading"]
    assert isinstance(compass.series, HeadingSeries)
    np.testing.assert_allclose(np.degrees(compass.series.heading), 57.5)
    true = headings_true(read)
    assert true is not None
    # France's Atlantic coast in 2024: about half a degree east
    np.testing.assert_allclose(np.degrees(true.heading), 57.5 + 0.6, atol=0.5)


def test_an_easterly_deviation_is_added_and_hdm_serves_alone(tmp_path: Path) -> None:
    for line, degrees in ((hdg(60.0, "2.5,E"), 62.5), (sentence("HCHDM,11.0,M"), 11.0)):
        series = sailed(tmp_path, line).sensors["heading"].series
        assert isinstance(series, HeadingSeries)
        np.testing.assert_allclose(np.degrees(series.heading), degrees)


def degrees_of(mission: Mission) -> list[float]:
    series = mission.sensors["heading"].series
    assert isinstance(series, HeadingSeries)
    return np.degrees(series.heading).round(6).tolist()  # type: ignore[no-any-return]


def test_a_true_heading_comes_before_a_magnetic_one_and_it_is_said(tmp_path: Path) -> None:
    read = sailed(tmp_path, hdg(60.0), hdt(66.0))
    assert degrees_of(read) == [66.0] * 6
    assert not read.sensors["heading"].noise
    assert any("HCHDG (6) are left out: GPHDT is taken" in w for w in read.warnings)
    instead = sailed(tmp_path, hdg(60.0), hdt("")).sensors
    assert instead["heading"].noise == {"magnetic": True}
    assert "speed" not in instead


def test_of_two_compasses_the_one_that_tells_most_is_taken(tmp_path: Path) -> None:
    rare = [*(gga("115959.0"), hdt(10.0)), *(rmc("120000.0", "010224"), gga("120000.0"), hdt(10.0))]
    rest = [rmc("120000.0", "010224")]
    for k in range(1, 8):
        rest += [gga(f"12000{k}.0", minutes=30.0 + k), hdg(60.0)]
    assert degrees_of(log(tmp_path, *rare, *rest)) == [60.0] * 7
    other = sentence("HEHDT,80.0,T")
    both = []
    for k in range(6):
        both += [rmc(f"12000{k}.0", "010224"), gga(f"12000{k}.0"), other, hdt(66.0) if k else ""]
    assert degrees_of(log(tmp_path, *both)) == [80.0] * 6


def test_before_the_first_time_a_heading_tells_nothing(tmp_path: Path) -> None:
    lines = [hdt(10.0)]
    for k in range(6):
        lines += [rmc(f"12000{k}.0", "010224"), gga(f"12000{k}.0", minutes=30.0 + k), hdg(60.0)]
    assert degrees_of(log(tmp_path, *lines)) == [60.0] * 6


def test_of_headings_without_a_time_of_their_own_one_is_taken(tmp_path: Path) -> None:
    read = sailed(tmp_path, *(hdt(60.0 + k) for k in range(10)))
    assert degrees_of(read) == [60.0] * 6
    assert not read.rejections
    assert any("54 headings have no time of their own" in w for w in read.warnings)


@pytest.mark.parametrize("line", ["HCHDG,,,,,", "HCHDG,60.0,2.5,,,", "HCHDG,north,,,,", "GPHDT,,T"])
def test_headings_that_are_none_are_counted(tmp_path: Path, line: str) -> None:
    read = sailed(tmp_path, sentence(line))
    assert set(read.sensors) == {"gnss"}
    assert Counter(r.sensor for r in read.rejections) == {"heading": 6}


def test_short_sentences_are_read(tmp_path: Path) -> None:
    read = sailed(tmp_path, sentence("HCHDG,60.0"), sentence("VWVHW,,T,,M,4.0,N"))
    assert degrees_of(read) == [60.0] * 6
    assert len(read.sensors["log"].series) == 6


@pytest.mark.parametrize("date", [None, "010205"])
def test_a_magnetic_heading_of_an_unknown_day_needs_a_card(
    tmp_path: Path, date: str | None
) -> None:
    """Before 2010 the model knows no declination."""
    lines = []
    for k in range(6):
        lines += [rmc(f"12000{k}.0", date)] if date else []
        lines += [gga(f"12000{k}.0", minutes=30.0 + k), hdg(60.0)]
    read = log(tmp_path, *lines)
    assert set(read.sensors) == {"gnss"}
    why = "the magnetic declination of 2005-02-01 is unknown" if date else "no RMC sentence tells"
    assert any(f"6 magnetic headings are left out: {why}" in w for w in read.warnings)
    for noise, degrees in (
        ({"declination_deg": 1.5}, 61.5),
        ({"declination_deg": 0.0}, 60.0),
        ({"magnetic": False}, 60.0),
    ):
        true = headings_true(by_card(tmp_path, {"heading": {"noise": noise}}, *lines))
        assert true is not None
        np.testing.assert_allclose(np.degrees(true.heading), degrees)


def test_a_speed_log_reads_the_water(tmp_path: Path) -> None:
    """Ten knots is more than a DVL is believed."""
    read = sailed(tmp_path, vhw(10.0), hdt(90.0))
    series = read.sensors["log"].series
    assert isinstance(series, DvlSeries)
    np.testing.assert_allclose(series.v_d, np.tile([10 * KNOT_M_S, 0, 0], (6, 1)))
    assert not series.bottom_lock.any()
    assert "speed" not in read.sensors
    assert fixes_of(read).v_n is not None, "the receiver's velocity stays its own"
    in_km_h = sailed(tmp_path, vhw("", 7.2)).sensors["log"].series
    assert isinstance(in_km_h, DvlSeries)
    np.testing.assert_allclose(in_km_h.v_d[:, 0], 2.0)


def test_a_fast_log_passes_through_a_mission_folder(tmp_path: Path) -> None:
    write_mission(sailed(tmp_path, vhw(18.0), hdt(90.0)), tmp_path / "folder")
    assert len(open_mission(tmp_path / "folder").sensors["log"].series) == 6


@pytest.mark.parametrize("line", [vhw(0.0), vhw("")])
def test_a_wheel_that_never_turns_is_no_log(tmp_path: Path, line: str) -> None:
    read = sailed(tmp_path, line, hdt(90.0))
    assert set(read.sensors) == {"gnss", "heading", "speed"}
    assert any("no speed but 0 in 6 sentences of a speed log" in w for w in read.warnings)


def test_a_wheel_that_is_fouled_on_the_way_is_no_log(tmp_path: Path) -> None:
    lines = []
    for k in range(8):
        clock = (rmc(f"12000{k}.0", "010224", speed=6.0), gga(f"12000{k}.0", minutes=30.0 + k))
        lines += [*clock, hdt(90.0), vhw(6.0 if k < 5 else 0.0)]
    read = log(tmp_path, *lines)
    assert set(read.sensors) == {"gnss", "heading", "speed"}
    assert any("(VWVHW) stands still at 38% of the times" in w for w in read.warnings)


def test_velocities_far_from_any_heading_stay_with_the_fixes(tmp_path: Path) -> None:
    lines = [gga("115900.0"), hdt(90.0)]
    for k in range(6):
        lines += [rmc(f"12000{k}.0", "010224"), gga(f"12000{k}.0", minutes=30.0 + k)]
    read = log(tmp_path, *lines[2:], *lines[:2])
    assert set(read.sensors) == {"gnss", "heading"}
    assert not any("'speed' is turned" in w for w in read.warnings)


def test_sentences_of_a_compass_and_a_log_that_are_no_figures_are_counted(tmp_path: Path) -> None:
    read = log(
        tmp_path, rmc("120000.0", "010224"), gga("120000.0"), hdg(60.0), vhw(3.0),
        rmc("120001.0", "010224"), gga("120001.0", minutes=31.0), hdg(""), vhw(""),
        rmc("120002.0", "010224"), gga("120002.0", minutes=32.0),
        sentence("HCHDG,north,,,,"), sentence("VWVHW,,T,,M,fast,N,,K"),
    )  # fmt: skip
    assert Counter((r.sensor, r.reason) for r in read.rejections) == {
        (name, reason): 1
        for name, none in (("heading", "no heading"), ("log", "no speed"))
        for reason in (none, "malformed sentence")
    }


@pytest.mark.slow
@pytest.mark.parametrize(("off_deg", "least_m", "most_m"), [(0.0, 0.0, 12.0), (60.0, 20.0, np.inf)])
def test_compass_and_log_carry_a_vessel_around_a_corner(
    tmp_path: Path, off_deg: float, least_m: float, most_m: float
) -> None:
    """North at 4 knots, then east, over a current to the east; no fixes about the corner.

    A compass that is off there alone leads astray: it is listened to.
    """
    speed_m_s, current_m_s, metres_a_minute, corner = 4 * KNOT_M_S, 0.5, 1852.0, 180
    silence = range(120, 240)
    lines = []
    for k in range(300):
        n, e = speed_m_s * min(k, corner), speed_m_s * max(k - corner, 0) + current_m_s * k
        v_n, v_e = (speed_m_s, current_m_s) if k < corner else (0.0, speed_m_s + current_m_s)
        time = f"12{k // 60:02d}{k % 60:02d}.0"
        west = 15.0 - e / (metres_a_minute * np.cos(np.radians(45.5)))
        moving = (np.hypot(v_n, v_e) / KNOT_M_S, np.degrees(np.arctan2(v_e, v_n)))
        lines += [rmc(time, "010224", "V" if k in silence else "A", *moving)]
        lines += [] if k in silence else [gga(time, minutes=30.0 + n / metres_a_minute, west=west)]
        true_deg = 90.0 * (k >= corner) + off_deg * (k in silence)
        lines += [hdg((true_deg - 0.6) % 360.0), vhw(4.0)]
    found = estimate(log(tmp_path, *lines), "graph").trajectory.interpolate([float(corner)])
    wanted = np.array([speed_m_s * corner, current_m_s * corner])
    assert least_m < np.linalg.norm(found.p_n[0, :2] - wanted) < most_m


def test_a_log_without_positions_and_headings(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no GGA or RMC sentence with a position"):
        log(tmp_path, sentence("GPVTG,90.0,T,,M,3.888,N,7.2,K,A"))


@pytest.mark.realdata
def test_the_recorded_vessel(recorded_data: Path) -> None:
    path = recorded_data / "usv_nmea" / "202412051751.nmea.txt.gz"
    if not path.is_file():
        pytest.skip("the NMEA log is not among the recorded missions")
    read = open_mission(path)
    series = fixes_of(read)
    assert len(series) == 2897
    assert read.start_utc == datetime(2024, 12, 5, 9, 41, 55, 200000, tzinfo=UTC).timestamp()
    way = np.linalg.norm(np.diff(series.p_n[:, :2], axis=0), axis=1).sum()
    assert way == pytest.approx(635, abs=10)
    assert set(read.sensors) == {"gnss", "speed", "heading"}
