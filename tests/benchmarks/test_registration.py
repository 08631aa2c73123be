"""The small twin of ``benchmarks.registration``."""

from __future__ import annotations

import pytest

from benchmarks.registration import PLACES, as_the_card_states, echo_errors, measure
from gtsam_nav.registration.pic import UNOBSERVED_M


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES)
def test_matches_are_no_better_than_they_say(place: str) -> None:
    found = measure(place, 20, as_the_card_states())
    assert found.failed == 0
    assert found.within_95 > 0.85
    assert found.nees_per_dof < 1.5
    if place == "corridor":
        assert found.sigma_along_m == pytest.approx(UNOBSERVED_M, rel=0.01)
    else:
        assert found.sigma_along_m < 0.3


@pytest.mark.slow
def test_echoes_lie_off_walls_a_little_less_than_the_card_states() -> None:
    # neighbours share their errors, so that each alone is better than a match may count on
    for row in echo_errors(3, as_the_card_states())[:3]:
        assert 0.3 < row.nees < 0.8
