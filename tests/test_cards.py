"""Data-set cards: each that is shipped is whole, and travels with the package."""

from __future__ import annotations

from pathlib import Path

import pytest

from gtsam_nav import cards
from gtsam_nav.cards import load_card
from gtsam_nav.errors import DataError
from gtsam_nav.mission import Constraints

SHIPPED = sorted((Path(__file__).parents[1] / "datasets").glob("*.yaml"))
STPERE = next(path for path in SHIPPED if path.stem == "stpere")


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_card_is_whole(path: Path) -> None:
    card = load_card(path.stem)
    assert card.source
    assert card.licence
    assert card.files
    assert card.sensors


def test_there_are_cards_to_test() -> None:
    assert {"stpere", "mrclam", "rtk_mems_car"} <= {path.stem for path in SHIPPED}


def test_a_card_says_how_the_vehicle_moves() -> None:
    assert load_card("stpere").constraints.to_constraints() == Constraints()
    on_wheels = Constraints(nonholonomic=True, zero_velocity=True)
    assert load_card("rtk_mems_car").constraints.to_constraints() == on_wheels


def test_an_unknown_card_is_answered_with_the_choices() -> None:
    with pytest.raises(DataError, match=r"no data-set card 'atlantis'; the cards are: .*stpere"):
        load_card("atlantis")


def test_a_card_inside_the_package_comes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = SHIPPED[0].read_text().replace("name: ", "name: packaged ", 1)
    (tmp_path / SHIPPED[0].name).write_text(text)
    monkeypatch.setattr(cards, "CARD_FOLDERS", (tmp_path, *cards.CARD_FOLDERS))
    assert load_card(SHIPPED[0].stem).name.startswith("packaged")


def test_a_damaged_card_names_file_and_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = STPERE.read_text().replace("rpy_deg", "rpy_rad", 1)
    (tmp_path / "damaged.yaml").write_text(text)
    monkeypatch.setattr(cards, "CARD_FOLDERS", (tmp_path,))
    with pytest.raises(DataError, match=r"damaged\.yaml.*unknown key 'rpy_rad'; the choices are"):
        load_card("damaged")
