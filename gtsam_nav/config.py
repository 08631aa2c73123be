"""The whole configuration: assembles the settings that live beside their algorithms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from gtsam_nav.cards import MISSION_SECTION, with_mission
from gtsam_nav.ekf.settings import (
    DeadReckoningSettings,
    InsSettings,
    LandmarkEkfSettings,
    PoseEkfSettings,
)
from gtsam_nav.errors import ConfigError
from gtsam_nav.evaluation.settings import EvaluationSettings
from gtsam_nav.graph.settings import GraphSettings
from gtsam_nav.odometry.settings import KissSettings
from gtsam_nav.preprocess.gnss_policy import GnssSettings
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.registration.settings import CorrelativeSettings, Open3dSettings, PicSettings
from gtsam_nav.sensors.settings import LandmarkSettings
from gtsam_nav.settings import Settings, in_words
from gtsam_nav.sonar.settings import SonarSettings
from gtsam_nav.yaml_files import YamlError, parse_yaml, read_yaml_file


class Config(Settings):
    """How to treat a mission. ``gtsam-nav config dump`` prints all of it with its defaults."""

    seed: int = 0
    gnss: GnssSettings = GnssSettings()
    motion: MotionSettings = MotionSettings()
    landmarks: LandmarkSettings = LandmarkSettings()
    dr: DeadReckoningSettings = DeadReckoningSettings()
    ins_ekf: InsSettings = InsSettings()
    landmark_ekf: LandmarkEkfSettings = LandmarkEkfSettings()
    pose_ekf: PoseEkfSettings = PoseEkfSettings()
    sonar: SonarSettings = SonarSettings()
    pic: PicSettings = PicSettings()
    correlative: CorrelativeSettings = CorrelativeSettings()
    open3d: Open3dSettings = Open3dSettings()
    kiss: KissSettings = KissSettings()
    graph: GraphSettings = GraphSettings()
    evaluation: EvaluationSettings = EvaluationSettings()

    def to_yaml(self) -> str:
        """The resolved configuration as YAML, in the order of the fields."""
        return yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False)


def load_config(path: Path | str | None = None, overrides: Sequence[str] = ()) -> Config:
    """Read a configuration file and apply ``key=value`` overrides.

    Parameters
    ----------
    path : Path or str, optional
        YAML; what it does not name keeps its default.
    overrides : sequence of str
        ``gnss.use=window`` and the like; values are read as YAML.

    Raises
    ------
    ConfigError
        Where the file is not YAML, or a key is unknown, or a value is out of range.
    """
    tree: dict[str, Any] = {}
    path = None if path is None else Path(path)
    if path is not None:
        try:
            loaded = read_yaml_file(path)
        except YamlError as error:
            where = path if error.line is None else f"{path}:{error.line}"
            raise ConfigError(f"{where}: cannot read the configuration: {error}") from error
        if not isinstance(loaded, dict | None):
            raise ConfigError(f"{path}: the configuration must be a map of sections")
        # a mission's card may stand beside the settings; the readers' business
        tree = {key: value for key, value in (loaded or {}).items() if key != MISSION_SECTION}
    return _validated(tree, overrides, path)


def checked_card(path: Path | None) -> Path | None:
    """The file of settings again where it holds a mission's card.

    Raises
    ------
    ConfigError
        Where its settings are not in order, even if nobody uses them.
    """
    load_config(path)
    return with_mission(path)


def override_config(config: Config, overrides: Sequence[str]) -> Config:
    """A configuration with ``key=value`` overrides, as those of `load_config`.

    Raises
    ------
    ConfigError
        Where a key is unknown or a value out of range.
    """
    return _validated(config.model_dump(mode="json"), overrides)


def _validated(tree: dict[str, Any], overrides: Sequence[str], path: Path | None = None) -> Config:
    for override in overrides:
        _apply_override(tree, override)
    try:
        return Config.model_validate(tree)
    except ValidationError as error:
        raise ConfigError(_explain(error, path)) from error


def _apply_override(tree: dict[str, Any], override: str) -> None:
    key, equals, text = override.partition("=")
    if not equals or not key.strip():
        raise ConfigError(f"'{override}' is not of the form key=value, as in gnss.use=none")
    try:
        value = parse_yaml(text)
    except YamlError as error:
        raise ConfigError(f"'{override}': the value is not YAML") from error
    *sections, last = key.strip().split(".")
    for section in sections:
        branch = tree.setdefault(section, {})
        if not isinstance(branch, dict):
            raise ConfigError(f"'{override}': '{section}' is not a section")
        tree = branch
    tree[last] = value


def _explain(error: ValidationError, path: Path | None) -> str:
    """One line that names the first offending key and the choices beside it."""
    first = error.errors()[0]
    location = [str(part) for part in first["loc"]]
    key = ".".join(location)
    where = f"{path}: " if path is not None else ""
    if first["type"] == "model_type":
        keys = ", ".join(_keys(location))
        return f"{where}config key '{key}': {in_words(first)}; its keys are: {keys}"
    if first["type"] != "extra_forbidden":
        return f"{where}config key '{key}': {in_words(first)}"
    choices = _keys(location[:-1])
    if path is not None and len(location) == 1:
        choices.append(f"{MISSION_SECTION} (a mission's card: its sensors stand there)")
    return f"{where}unknown config key '{key}'; the choices are: {', '.join(choices)}"


def _keys(location: Sequence[str]) -> list[str]:
    """The keys of a section."""
    section: Any = Config()
    for part in location:
        section = getattr(section, part)
    return list(type(section).model_fields)
