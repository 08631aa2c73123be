"""The pages of docs/ do what they say: their Python blocks run, those of a page in one go."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from gtsam_nav.errors import PackageError
from gtsam_nav.readers._file_card import FileCard
from gtsam_nav.readers._mission_yaml import MissionFile
from gtsam_nav.readers._ros_card import BagCard, BagSensor
from gtsam_nav.sensors.noise import NOISE_MODELS

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs").glob("*.md"))
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
YAML_BLOCK = re.compile(r"^```yaml\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\((?!https?:)([^)#]+)[^)]*\)")


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_examples_run(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in BLOCK.findall(page.read_text(encoding="utf-8")):
        try:
            exec(compile(block, page.name, "exec"), names)
        except PackageError as error:  # Open3D is not everywhere
            pytest.skip(str(error))
    capsys.readouterr()


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), target


def test_the_cards_are_cards() -> None:
    page = (ROOT / "docs" / "cards.md").read_text(encoding="utf-8")
    cards = [yaml.safe_load(text)["mission"] for text in YAML_BLOCK.findall(page)]
    models = (BagCard, BagCard, MissionFile, FileCard)
    for model, card in zip(models, cards, strict=True):
        model.model_validate(card)
    for key in (*BagCard.model_fields, *BagSensor.model_fields, "columns", "scale"):
        assert f"`{key}`" in page, key


FIGURE = re.compile(r"^\| `(\w+)` \| (\S+) \| \S.* \|$", re.MULTILINE)


def test_every_noise_figure_is_listed_with_its_default() -> None:
    page = (ROOT / "docs" / "noise.md").read_text(encoding="utf-8")
    listed = {}
    for section in page.split("\n## ")[1:]:
        title, _, body = section.partition("\n")
        figures = {name: yaml.safe_load(value) for name, value in FIGURE.findall(body)}
        listed |= dict.fromkeys(re.findall(r"`(\w+)`", title), figures)
    assert listed == {
        kind: {
            name: "–" if field.default is None else pytest.approx(field.default)
            for name, field in model.model_fields.items()
        }
        for kind, model in NOISE_MODELS.items()
    }
