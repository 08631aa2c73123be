"""Data-set cards: each that is shipped is whole, and travels with the package."""

from __future__ import annotations

from pathlib import Path

import pytest

from gtsam_nav import cards
from gtsam_nav.cards import SensorCard, load_card, read_yaml
from gtsam_nav.errors import DataError
from gtsam_nav.mission import Constraints
from gtsam_nav.readers._file_card import FileCard

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


@pytest.mark.parametrize(("far_m", "said"), [("-1e300", "-1e+300 m"), ("1000.5", "1000.5 m")])
def test_a_mounting_beyond_any_vehicle_is_refused(tmp_path: Path, far_m: str, said: str) -> None:
    path = tmp_path / "card.yaml"
    path.write_text(f"sensors:\n  dvl: {{type: dvl, xyz_m: [0.0, 0.0, {far_m}]}}\n")
    with pytest.raises(DataError) as told:
        read_yaml(path, FileCard)
    expected = f"sensors.dvl.xyz_m: {said} is no place on a vehicle; the limit is 1000 m"
    assert expected in str(told.value)


def test_the_longest_vehicle_may_carry_a_sensor_at_its_end() -> None:
    assert SensorCard(type="dvl", xyz_m=(-1000.0, 0.0, 1000.0)).xyz_m == (-1000.0, 0.0, 1000.0)


def test_repeats_of_what_repeats_by_itself_are_kept() -> None:
    assert SensorCard(type="dvl", drop_repeats=True).drop_repeats
    with pytest.raises(ValueError, match="drop_repeats is of: imu, dvl, gnss, heading, attitude;"):
        SensorCard(type="odometry", drop_repeats=True)
