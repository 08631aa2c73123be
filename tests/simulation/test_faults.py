"""Faults: their grammar, what each does to the samples, and what it leaves alone."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gtsam_nav as gn
from gtsam_nav.errors import ConfigError
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import GnssSeries, HeadingSeries, Series
from gtsam_nav.simulation import Fault, inject, parse_fault, simulate
from gtsam_nav.simulation.faults import (
    ClockOffset,
    Dropout,
    FalseLoops,
    HeadingBias,
    Outliers,
    Silence,
    bursts_of,
)

numbers = st.floats(-1e4, 1e4)
shares = st.floats(0.0, 1.0)
counts = st.integers(1, 50)
targets = st.sampled_from(["gnss", "dvl", "heading", "imu", "sonar", "stern gnss"])
spans = st.tuples(numbers, numbers).filter(lambda s: s[0] < s[1])
sizes = st.tuples(st.floats(0.0, 1e3), st.floats(0.0, 1e3)).filter(lambda s: s[0] < s[1])
any_fault = st.one_of(
    st.builds(Outliers, targets, shares, sizes, counts, st.booleans()),
    st.builds(Dropout, targets, shares),
    st.builds(Silence, targets, spans),
    st.builds(HeadingBias, targets, numbers, st.none() | spans),
    st.builds(ClockOffset, targets, numbers),
    st.builds(FalseLoops, st.floats(0.0, 1.0, exclude_max=True), counts),
)


@pytest.fixture(scope="module")
def mission() -> Mission:
    return simulate("marina", seed=6, duration_s=120.0)


def receiver(n: int) -> Mission:
    """A mission with nothing but fixes at the origin, one a second."""
    fixes = GnssSeries(
        t=np.arange(float(n)),
        p_n=np.zeros((n, 3)),
        sigma=np.ones((n, 3)),
        v_n=np.ones((n, 3)),
    )
    return Mission(name="fixes", sensors={"gnss": Sensor(name="gnss", type="gnss", series=fixes)})


def offsets(mission: Mission) -> Array:
    """How far the fixes of a receiver at the origin are off, shape (n, 3)."""
    series = mission.sensors["gnss"].series
    assert isinstance(series, GnssSeries)
    return series.p_n


def equal(a: Series, b: Series) -> bool:
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))


# ------------------------------------------------------------------------------------- the grammar


@pytest.mark.parametrize(
    ("spec", "fault"),
    [
        ("gnss:outliers=0.3,size=20:100,burst=5", Outliers("gnss", 0.3, (20.0, 100.0), 5)),
        ("gnss:outliers=0.3,size=50:50", Outliers("gnss", 0.3, (50.0, 50.0))),
        ("gnss:outliers=0.1", Outliers("gnss", 0.1)),
        ("gnss:outliers=1,burst=9,coherent", Outliers("gnss", 1.0, burst=9, coherent=True)),
        ("dvl:drop=300:420", Silence("dvl", (300.0, 420.0))),
        ("heading:bias=15@600:900", HeadingBias("heading", 15.0, (600.0, 900.0))),
        ("heading:bias=-3.5", HeadingBias("heading", -3.5)),
        ("imu:gap=100:110", Silence("imu", (100.0, 110.0), "gap")),
        ("loops:false=0.5", FalseLoops(0.5)),
        ("loops:false=0.2,group=10", FalseLoops(0.2, 10)),
        ("sonar:drop=0.5", Dropout("sonar", 0.5)),
        ("clock:gnss=+0.5", ClockOffset("gnss", 0.5)),
        (" stern gnss : drop = 0.5 ", Dropout("stern gnss", 0.5)),
    ],
)
def test_specifications_are_read(spec: str, fault: Fault) -> None:
    assert parse_fault(spec) == fault


def test_a_gap_is_called_as_it_was_given() -> None:
    assert str(parse_fault("imu:gap=100:110")) == "imu:gap=100:110"


@given(any_fault)
def test_what_a_fault_is_called_reads_back_as_the_fault(fault: Fault) -> None:
    assert parse_fault(str(fault)) == fault


@pytest.mark.parametrize(
    ("spec", "trouble"),
    [
        ("gnss", "is not of the form TARGET:FAULT=VALUE"),
        ("", "is not of the form TARGET:FAULT=VALUE"),
        (":drop=0.5", "is not of the form TARGET:FAULT=VALUE"),
        ("gnss:outliers", "is not of the form TARGET:FAULT=VALUE"),
        ("gnss:wobble=1", "unknown fault 'wobble'"),
        ("gnss:outliers=1.2", "the share is 1.2; it must lie in \\[0, 1\\]"),
        ("gnss:outliers=nan", "'nan' is not a number"),
        ("gnss:outliers=0.1,size=20", "'' is not a number"),
        ("gnss:outliers=0.1,size=100:20", "the span 100:20 is empty"),
        ("gnss:outliers=0.1,size=-5:20", "a size must not be negative"),
        ("gnss:outliers=0.1,burst=0", "'0' is not a whole number above zero"),
        ("gnss:outliers=0.1,burst=2.5", "'2.5' is not a whole number above zero"),
        ("gnss:outliers=0.1,burst=2,burst=3", "'burst=3' is empty or said twice"),
        ("gnss:outliers=0.1,", "'' is empty or said twice"),
        ("gnss:outliers=0.1,coherent=no", "a flag takes no value"),
        ("dvl:drop=420:300", "the span 420:300 is empty"),
        ("dvl:drop=soon", "'soon' is not a number"),
        ("dvl:drop=0.5,burst=3", "drop takes no 'burst'"),
        ("imu:gap=0.5", "'' is not a number"),
        ("heading:bias=15@600", "'' is not a number"),
        ("heading:bias=inf", "'inf' is not a number"),
        ("clock:gnss=late", "'late' is not a number"),
        ("loops:true=0.5", "loops have no 'true'"),
        ("loops:false=1", "false loops come among true ones: their share must be below 1"),
    ],
)
def test_wrong_specifications_are_named_with_the_choices(spec: str, trouble: str) -> None:
    with pytest.raises(ConfigError, match=f"fault '{spec}': {trouble}.*; the choices are: SENSOR:"):
        parse_fault(spec)


@given(st.text(max_size=40))
def test_any_text_is_a_fault_or_an_error_of_configuration(text: str) -> None:
    with suppress(ConfigError):
        fault = parse_fault(text)
        assert parse_fault(str(fault)) == fault


# ---------------------------------------------------------------------------------------- outliers


@given(st.integers(0, 300), shares, st.integers(1, 12), st.integers(0, 5))
def test_bursts_hit_exactly_so_many_samples_in_runs(
    n: int, share: float, length: int, seed: int
) -> None:
    count = round(share * n)
    burst = bursts_of(n, count, length, np.random.default_rng(seed))
    assert len(burst) == n
    hit = burst[burst >= 0]
    assert len(hit) == count
    sizes = np.bincount(hit) if count else np.zeros(0, dtype=int)
    assert sorted(sizes.tolist(), reverse=True) == [length] * (count // length) + (
        [count % length] if count % length else []
    )
    where = [np.flatnonzero(burst == k) for k in range(len(sizes))]
    assert all(np.all(np.diff(w) == 1) for w in where)


def test_every_sample_is_as_likely_to_be_hit() -> None:
    hits = [bursts_of(40, 10, 5, np.random.default_rng(k)) >= 0 for k in range(3000)]
    np.testing.assert_allclose(np.mean(hits, axis=0)[5:-5], 0.25, atol=0.05)
    assert np.mean(hits, axis=0)[0] > 0.05


def test_outliers_are_the_stated_share_in_stated_sizes_all_around() -> None:
    offset_n = offsets(inject(receiver(20_000), ["gnss:outliers=0.3,size=20:100"]))
    size = np.linalg.norm(offset_n, axis=1)
    hit = size > 0
    assert hit.sum() == 6000
    assert size[hit].min() >= 20.0
    assert size[hit].max() <= 100.0
    assert size[hit].mean() == pytest.approx(60.0, abs=1.5)
    assert np.all(offset_n[:, 2] == 0)
    angle = np.arctan2(offset_n[hit, 1], offset_n[hit, 0])
    assert abs(np.exp(1j * angle).mean()) < 0.05
    assert np.mean(hit[1:] & hit[:-1]) == pytest.approx(0.09, abs=0.01)


def test_offsets_in_a_burst_are_independent_unless_coherent() -> None:
    for coherent in (False, True):
        spec = f"gnss:outliers=0.2,burst=5{',coherent' if coherent else ''}"
        offset_n = offsets(inject(receiver(1000), [spec]))
        hit = np.linalg.norm(offset_n, axis=1) > 0
        assert hit.sum() == 200
        distinct = len(np.unique(offset_n[hit], axis=0))
        assert distinct == (40 if coherent else 200)


def test_velocities_and_sigmas_say_nothing_of_the_outliers() -> None:
    before, after = receiver(100), inject(receiver(100), ["gnss:outliers=1"])
    was, now = before.sensors["gnss"].series, after.sensors["gnss"].series
    assert isinstance(was, GnssSeries)
    assert isinstance(now, GnssSeries)
    assert was.v_n is not None
    assert now.v_n is not None
    np.testing.assert_array_equal(now.sigma, was.sigma)
    np.testing.assert_array_equal(now.v_n, was.v_n)
    np.testing.assert_array_equal(now.t, was.t)


# ---------------------------------------------------------------------------------- other faults


def test_a_span_is_dropped_half_open(mission: Mission) -> None:
    series = inject(mission, ["dvl:drop=30:60"]).sensors["dvl"].series
    was = mission.sensors["dvl"].series
    gone = (was.t >= 30.0) & (was.t < 60.0)
    assert gone.any()
    np.testing.assert_array_equal(series.t, was.t[~gone])
    np.testing.assert_array_equal(series.row, was.row[~gone])


def test_beams_are_dropped_at_random(mission: Mission) -> None:
    left = len(inject(mission, ["sonar:drop=0.5"]).sensors["sonar"].series)
    assert left == pytest.approx(0.5 * len(mission.sensors["sonar"].series), rel=0.1)
    assert len(inject(mission, ["sonar:drop=1"]).sensors["sonar"].series) == 0


def test_the_compass_turns_clockwise_for_a_span(mission: Mission) -> None:
    was = mission.sensors["heading"].series
    now = inject(mission, ["heading:bias=15@50:80"]).sensors["heading"].series
    assert isinstance(was, HeadingSeries)
    assert isinstance(now, HeadingSeries)
    turned_deg = np.degrees(wrap_angle(now.heading - was.heading))
    wrong = (was.t >= 50.0) & (was.t < 80.0)
    np.testing.assert_allclose(turned_deg[wrong], 15.0)
    np.testing.assert_allclose(turned_deg[~wrong], 0.0)
    for_good = inject(mission, ["heading:bias=-20"]).sensors["heading"].series
    assert isinstance(for_good, HeadingSeries)
    np.testing.assert_allclose(wrap_angle(for_good.heading - was.heading), np.radians(-20.0))


def test_a_fast_clock_stamps_late(mission: Mission) -> None:
    now = inject(mission, ["clock:gnss=+0.5"]).sensors["gnss"].series
    np.testing.assert_array_equal(now.t, mission.sensors["gnss"].series.t + 0.5)


# -------------------------------------------------------------------------------------- injection


def test_faults_leave_everything_else_alone(mission: Mission) -> None:
    spoilt = inject(mission, ["gnss:outliers=0.5", "dvl:drop=10:20"])
    for name, sensor in mission.sensors.items():
        assert equal(sensor.series, spoilt.sensors[name].series) == (name not in ("gnss", "dvl"))
        assert spoilt.sensors[name].noise == sensor.noise
    assert mission.faults == ()
    assert spoilt.faults == ("gnss:outliers=0.5,size=20:100,burst=1", "dvl:drop=10:20")


def test_the_same_seed_draws_the_same_faults_whatever_else_is_injected() -> None:
    once = offsets(inject(receiver(200), ["gnss:outliers=0.3"], seed=4))
    shifted = inject(receiver(200), ["clock:gnss=1", Outliers("gnss", 0.3)], seed=4)
    np.testing.assert_array_equal(once, offsets(shifted))
    assert not np.array_equal(once, offsets(inject(receiver(200), ["gnss:outliers=0.3"], seed=5)))


def test_a_fault_that_touches_nothing_is_said(mission: Mission) -> None:
    missed, hit = inject(mission, ["dvl:drop=9000:9100"]), inject(mission, ["dvl:drop=10:20"])
    assert "touches no sample" in missed.warnings[-1]
    assert hit.warnings == mission.warnings


def test_two_of_a_type_fail_independently_unless_one_is_named() -> None:
    fixes = receiver(200).sensors["gnss"].series
    pair = {name: Sensor(name=name, type="gnss", series=fixes) for name in ("bow", "stern")}
    mission = Mission(name="two receivers", sensors=pair)
    named = inject(mission, ["stern:outliers=0.5"]).sensors
    assert equal(named["bow"].series, fixes)
    assert not equal(named["stern"].series, fixes)
    both = inject(mission, ["gnss:outliers=0.5"]).sensors
    assert not equal(both["bow"].series, fixes)
    assert not equal(both["bow"].series, both["stern"].series)


@pytest.mark.parametrize(
    ("spec", "trouble"),
    [
        ("lidar:drop=0.5", "no sensor 'lidar'; the choices are: imu, dvl, .*, sonar, beams"),
        ("reference:drop=0.5", "no sensor 'reference'"),
        ("dvl:outliers=0.5", "outliers are of gnss; 'dvl' is dvl"),
        ("gnss:bias=3", "a bias is of heading; 'gnss' is gnss"),
    ],
)
def test_faults_that_the_mission_cannot_have_are_named(
    mission: Mission, spec: str, trouble: str
) -> None:
    with pytest.raises(ConfigError, match=trouble):
        inject(mission, [spec])


def test_false_loops_are_for_the_graph_to_draw(mission: Mission) -> None:
    spoilt = inject(mission, ["loops:false=0.5"])
    assert spoilt.faults == ("loops:false=0.5,group=1",)
    assert spoilt.sensors == mission.sensors
    with pytest.raises(ConfigError, match="only graph takes false loop closures, not dr"):
        gn.estimate(mission, "dr", faults=["loops:false=0.5"])


def test_an_estimate_is_scored_on_clean_fixes_and_sees_the_spoilt_ones(mission: Mission) -> None:
    """A share of the fixes is one of those that the policy leaves."""
    no_truth = mission.without("reference")
    config = gn.load_config(None, ("gnss.use=every_k", "gnss.every_k=4", "seed=3"))
    spec = "gnss:outliers=0.5,size=20:100"
    clean = gn.estimate(no_truth, "dr", config)
    spoilt = gn.estimate(no_truth, "dr", config, faults=[spec])
    assert clean.reference is not None
    assert spoilt.reference is not None
    assert equal(clean.reference.series, spoilt.reference.series)
    assert spoilt.gnss_withheld == clean.gnss_withheld == 90
    used, seen = (s.mission.sensors["gnss"].series for s in (clean, spoilt))
    assert isinstance(used, GnssSeries)
    assert isinstance(seen, GnssSeries)
    kept = np.isin(used.t, seen.t)  # outliers that it begins with are no start
    off_m = np.linalg.norm(seen.p_n - used.p_n[kept], axis=1)
    assert len(kept) == 30
    assert np.sum(off_m > 19.9) + np.sum(~kept) == 15
    assert spoilt.mission.faults == (f"{spec},burst=1",)
    again = gn.estimate(no_truth, "dr", config, faults=[spec])
    np.testing.assert_array_equal(again.trajectory.p_n, spoilt.trajectory.p_n)
