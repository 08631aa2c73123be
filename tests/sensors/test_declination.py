"""Magnetic declination by date and place."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Origin
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.sensors.declination import declination_deg
from gtsam_nav.sensors.orientation import headings_true
from gtsam_nav.series import HeadingSeries

GIRONA = Origin(42.2, 3.1)


def posix(year: int, month: int = 1, day: int = 1) -> float:
    return datetime(year, month, day, tzinfo=UTC).timestamp()


@pytest.mark.parametrize(
    ("place", "when", "expected"),
    [
        # test values that the World Magnetic Model is published with
        (Origin(80.0, 0.0, 0.0), posix(2020), -1.28),
        (Origin(80.0, 0.0, 100e3), posix(2020), -1.70),
        (Origin(80.0, 0.0, 0.0), posix(2022, 7, 2) + 12 * 3600.0, 0.01),
        (Origin(0.0, 120.0, 0.0), posix(2025), -0.16),
        (Origin(80.0, 0.0, 0.0), posix(2025), 1.28),
    ],
)
def test_it_is_the_published_models(place: Origin, when: float, expected: float) -> None:
    assert declination_deg(place, when) == pytest.approx(expected, abs=0.011)


def test_each_metre_of_height_counts() -> None:
    low, high = (declination_deg(Origin(80.0, 0.0, h), posix(2020)) for h in (0.0, 900.0))
    assert 0.001 < low - high < 0.01


def test_it_drifts_without_a_jump_from_model_to_model() -> None:
    before, after = (
        declination_deg(GIRONA, posix(2025) - 60.0),
        declination_deg(GIRONA, posix(2025)),
    )
    assert after == pytest.approx(before, abs=0.2)
    assert declination_deg(GIRONA, posix(2010)) < before - 1.0


@pytest.mark.parametrize("year", [2009, 2030])
def test_a_date_without_a_model_is_refused(year: int) -> None:
    with pytest.raises(DataError, match=f"declination of {year}-01-01 is unknown"):
        declination_deg(GIRONA, posix(year))


def mission() -> Mission:
    t = np.arange(3.0)
    series = HeadingSeries(t=t, heading=np.full(3, 0.5), sigma=np.full(3, 0.01))
    compass = Sensor("heading", "heading", series, noise={"magnetic": True})
    return Mission("magnetic", {"heading": compass}, origin=GIRONA, start_utc=posix(2022, 7))


def test_magnetic_headings_become_true() -> None:
    found = headings_true(mission())
    assert found is not None
    expected = np.radians(declination_deg(GIRONA, posix(2022, 7)))
    assert expected > np.radians(1.5)
    np.testing.assert_allclose(found.heading, 0.5 + expected)


@pytest.mark.parametrize("unknown", [{"origin": None}, {"start_utc": None}])
def test_magnetic_headings_of_an_unknown_place_or_date_are_refused(
    unknown: dict[str, None],
) -> None:
    with pytest.raises(DataError, match="'heading' are magnetic"):
        headings_true(replace(mission(), **unknown))
