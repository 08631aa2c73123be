"""Which fixes are used and which are truth: half-open windows, defaults, several receivers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.gnss_policy import GnssSettings, reference_from_fixes, split_fixes
from gtsam_nav.series import GnssSeries, ReferenceSeries

T = np.arange(0.0, 1000.0, 10.0)
LEVER_B = np.array([0.5, 0.0, -2.0])


def receiver(name: str = "gnss", t: Array = T, sigma: float = 1.0) -> Sensor:
    n = len(t)
    p_n = np.random.default_rng(0).normal(size=(n, 3))
    series = GnssSeries(t=t, p_n=p_n, sigma=np.tile([sigma, 2 * sigma, 5.0], (n, 1)))
    return Sensor(name, "gnss", series, xyz_b=LEVER_B)


def mission(*sensors: Sensor, reference: bool = False) -> Mission:
    everything = list(sensors)
    if reference:
        truth = ReferenceSeries(t=T, p_n=np.zeros((len(T), 3)))
        everything.append(Sensor("truth", "reference", truth))
    return Mission("m", {s.name: s for s in everything})


def used(one: Mission, settings: GnssSettings, name: str = "gnss") -> Array:
    blind, _, n_withheld = split_fixes(one, settings)
    kept = blind.sensors[name].series.t
    if len(one.of_type("gnss")) == 1:
        assert n_withheld == len(one.sensors[name].series) - len(kept)
    return kept


def test_all_and_none() -> None:
    np.testing.assert_array_equal(used(mission(receiver()), GnssSettings(use="all")), T)
    assert len(used(mission(receiver()), GnssSettings(use="none"))) == 0


@given(st.integers(1, 150))
def test_every_k_counts_fixes_from_the_first(k: int) -> None:
    settings = GnssSettings(use="every_k", every_k=k)
    np.testing.assert_array_equal(used(mission(receiver()), settings), T[::k])


@pytest.mark.parametrize(
    ("window_s", "first", "last"),
    [((0, 300), 0, 290), ((10, 10.1), 10, 10), ((5, 30), 10, 20), ((-50, 1e6), 0, 990)],
)
def test_a_window_is_half_open(window_s: tuple[float, float], first: float, last: float) -> None:
    kept = used(mission(receiver()), GnssSettings(use="window", window_s=window_s))
    assert (kept[0], kept[-1]) == (first, last)
    assert len(kept) == (last - first) / 10 + 1


def test_a_window_without_fixes_uses_none() -> None:
    settings = GnssSettings(use="window", window_s=(2000.0, 3000.0))
    assert len(used(mission(receiver()), settings)) == 0


def test_it_is_said_where_a_policy_leaves_no_fix() -> None:
    """As the default window does of a mission that is cropped from beyond its end."""
    late = mission(receiver(t=T[40:50]))
    blind, _, n_withheld = split_fixes(late, GnssSettings())
    assert n_withheld == 10
    (said,) = blind.warnings
    assert "gnss.use=window" in said
    assert "[0.0, 300.0]" in said
    assert "400.0 s to 490.0 s" in said
    for wanted in ("all", "none", "every_k"):
        assert split_fixes(late, GnssSettings.model_validate({"use": wanted}))[0].warnings == ()


def test_velocities_that_are_not_to_be_used_are_not_seen() -> None:
    gnss = receiver()
    moving = replace(gnss, series=replace(gnss.series, v_n=np.ones((len(T), 3))))
    for use_velocity in (True, False):
        settings = GnssSettings(use="all", use_velocity=use_velocity)
        series = split_fixes(mission(moving), settings)[0].sensors["gnss"].series
        assert isinstance(series, GnssSeries)
        assert (series.v_n is not None) == use_velocity


def test_gaps_are_half_open_and_withheld() -> None:
    settings = GnssSettings(use="gaps", gaps_s=((20.0, 50.0), (40.0, 60.0), (985.0, 2000.0)))
    kept = used(mission(receiver()), settings)
    np.testing.assert_array_equal(np.setdiff1d(T, kept), [20, 30, 40, 50, 990])


def test_a_mission_with_a_reference_uses_all_by_default() -> None:
    one = mission(receiver(), reference=True)
    np.testing.assert_array_equal(used(one, GnssSettings()), T)
    _, reference, n_withheld = split_fixes(one, GnssSettings())
    assert reference is one.reference
    assert n_withheld == 0


def test_a_mission_without_one_uses_the_first_five_minutes_by_default() -> None:
    one = mission(receiver())
    np.testing.assert_array_equal(used(one, GnssSettings()), T[T < 300])
    _, reference, n_withheld = split_fixes(one, GnssSettings())
    assert reference is not None
    np.testing.assert_array_equal(reference.series.t, T[T >= 300])
    assert n_withheld == 70


def test_the_mission_itself_keeps_all() -> None:
    one = mission(receiver(), reference=True)
    split_fixes(one, GnssSettings(use="none"))
    assert len(one.sensors["gnss"].series) == len(T)
    assert one.reference is not None


def test_a_reference_beats_withheld_fixes() -> None:
    one = mission(receiver(), reference=True)
    blind, reference, n_withheld = split_fixes(one, GnssSettings(use="none"))
    assert reference is one.reference
    assert blind.reference is None
    assert n_withheld == len(T)


def test_the_policy_holds_for_every_receiver() -> None:
    one = mission(receiver("bow"), receiver("stern", T + 5.0, sigma=9.0))
    settings = GnssSettings(use="window", window_s=(0.0, 100.0))
    blind, reference, n_withheld = split_fixes(one, settings)
    assert max(blind.sensors[name].series.t[-1] for name in ("bow", "stern")) < 100.0
    assert n_withheld == 180
    assert reference is not None
    assert reference.name == "bow (withheld)"  # of the first receiver


def test_a_mission_without_gnss_has_nothing_to_split() -> None:
    blind, reference, n_withheld = split_fixes(mission(), GnssSettings())
    assert (blind.sensors, reference, n_withheld) == ({}, None, 0)


def test_fixes_make_a_horizontal_reference_at_their_antenna() -> None:
    gnss = receiver(sigma=3.0)
    assert isinstance(gnss.series, GnssSeries)
    reference = reference_from_fixes(gnss)
    assert isinstance(reference.series, ReferenceSeries)
    assert not reference.series.vertical_usable
    np.testing.assert_array_equal(reference.xyz_b, LEVER_B)
    np.testing.assert_array_equal(reference.series.p_n, gnss.series.p_n)
    np.testing.assert_array_equal(reference.series.row, gnss.series.row)
    # one sigma an axis: the root mean square of north and east
    np.testing.assert_allclose(reference.series.sigma, np.sqrt((3.0**2 + 6.0**2) / 2))


@pytest.mark.parametrize(
    "bad",
    [
        {"use": "some"},
        {"every_k": 0},
        {"window_s": (10.0, 10.0)},
        {"window_s": (10.0, 0.0)},
        {"gaps_s": ((0.0, 1.0), (3.0, 2.0))},
        {"use": "gaps"},
        {"position_gate_probability": 1.0},
    ],
)
def test_settings_are_checked(bad: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        GnssSettings.model_validate(bad)
