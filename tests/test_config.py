"""Configuration: files, overrides, and errors that name the choices."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from pydantic import ValidationError

from gtsam_nav.config import Config, load_config
from gtsam_nav.errors import ConfigError
from gtsam_nav.settings import Settings


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "config.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def sections(settings: Settings, path: str = "") -> Iterator[tuple[str, Settings]]:
    yield path, settings
    for name in type(settings).model_fields:
        child = getattr(settings, name)
        if isinstance(child, Settings):
            yield from sections(child, f"{path}{name}.")


SECTIONS = dict(sections(Config()))


def test_the_defaults_need_no_file(tmp_path: Path) -> None:
    assert load_config() == Config()
    assert load_config(written(tmp_path, "")) == Config()
    assert load_config(written(tmp_path, "# nothing but a comment\n")) == Config()


@pytest.mark.parametrize(
    "overrides",
    [
        [],
        ["gnss.use=window", "gnss.window_s=[10, 200.5]", "seed=7"],
        ["gnss.use=gaps", "gnss.gaps_s=[[0, 10], [20, 30]]", "evaluation.window_s=[0, 3020]"],
        ["motion.rate_hz=20", "dr.gate_probability=0.99", "sonar.use=false"],
    ],
)
def test_a_resolved_configuration_reads_as_itself(tmp_path: Path, overrides: list[str]) -> None:
    config = load_config(None, overrides)
    assert load_config(written(tmp_path, config.to_yaml())) == config


def test_the_yaml_keeps_the_order_of_the_fields() -> None:
    dumped = yaml.safe_load(Config().to_yaml())
    assert list(dumped) == list(Config.model_fields)
    assert list(dumped["gnss"]) == list(type(Config().gnss).model_fields)


def test_overrides_beat_the_file_and_the_file_the_defaults(tmp_path: Path) -> None:
    path = written(tmp_path, "gnss: {use: none, every_k: 5}\nseed: 3\n")
    config = load_config(path, ["gnss.every_k=9", "gnss.every_k=11"])
    assert (config.gnss.use, config.gnss.every_k, config.seed) == ("none", 11, 3)
    assert config.motion == Config().motion


def test_override_values_are_read_as_yaml() -> None:
    config = load_config(None, [" gnss.use = all", "sonar.use=no", "motion.rate_hz=1e1"])
    assert config.gnss.use == "all"
    assert config.sonar.use is False
    assert config.motion.rate_hz == 10.0


@pytest.mark.parametrize(
    ("override", "complaint"),
    [
        ("gnss.use", "'gnss.use' is not of the form key=value"),
        ("=3", "'=3' is not of the form key=value"),
        ("gnss.use=[", "the value is not YAML"),
        ("seed.x=1", "config key 'seed'"),
        ("gnss.use=sometimes", r"config key 'gnss\.use'.*'all'.*'none'.*'window'"),
        ("gnss.use=sometimes", "\"sometimes\" is unknown; the choices are: 'all', 'none'"),
        ("gnss.every_k=0", r"config key 'gnss\.every_k': 0 must be at least 1"),
        ("gnss.every_k=1.5", "1.5 stands where a whole number belongs"),
        ("gnss.window_s=[5, 5]", r"config key 'gnss': .*start must be before stop"),
        ("gnss.window_s=5", "5 stands where a list belongs"),
        ("gnss.window_s={2020-01-01: 1}", r"2020, 1, 1\): 1} stands where a list belongs"),
        ("gnss.window_s=[5]", r"config key 'gnss\.window_s\.1': is missing"),
        ("gnss.window_s=[5, 6, 7]", r"\[5, 6, 7\] must hold at most 2"),
        ("motion.rate_hz=fast", r"config key 'motion\.rate_hz': \"fast\" stands where a number"),
        ("pic.max_iterations=null", "null stands where a whole number belongs"),
        ("sonar.use=none", '"none" stands where true or false belongs'),
        ("graph.loops.consistency_probability=1", "1 must be below 1"),
        ("gnss=all", "config key 'gnss': \"all\" stands where a map of keys belongs"),
        (
            "graph.robust.gnss=none",
            '"none" stands where a map of keys belongs; its keys are: kernel,'
            " threshold, gate_probability",
        ),
    ],
)
def test_bad_overrides_are_named(override: str, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        load_config(None, [override])


def test_a_value_has_no_keys_of_its_own(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="'seed' is not a section"):
        load_config(written(tmp_path, "seed: 3\n"), ["seed.x=1"])


@pytest.mark.parametrize("section", SECTIONS)
def test_an_unknown_key_is_answered_with_the_choices(section: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_config(None, [f"{section}no_such_key=1"])
    message = str(caught.value)
    assert f"unknown config key '{section}no_such_key'" in message
    choices = message.split("the choices are: ")[1].split(", ")
    assert choices == list(type(SECTIONS[section]).model_fields)


def test_errors_name_the_file(tmp_path: Path) -> None:
    path = written(tmp_path, "gnss: {used: all}\n")
    with pytest.raises(ConfigError, match=rf"{path}: unknown config key 'gnss\.used'"):
        load_config(path)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("gnss: [\n", "cannot read the configuration"),
        (b"\xff\xfe\x00gnss", "cannot read the configuration"),
        ("- gnss\n- motion\n", "must be a map of sections"),
        ("all\n", "must be a map of sections"),
        ("3: 4\n", "config key '3'"),
        ("gnss: 5\n", "config key 'gnss'"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, text: str | bytes, complaint: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(ConfigError, match=complaint) as caught:
        load_config(path)
    assert str(caught.value).startswith(f"{path}:")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.yaml: cannot read the configuration"):
        load_config(tmp_path / "nowhere.yaml")


@pytest.mark.parametrize("section", SECTIONS)
def test_settings_are_frozen(section: str) -> None:
    settings = SECTIONS[section]
    name = next(iter(type(settings).model_fields))
    with pytest.raises(ValidationError, match="frozen"):
        setattr(settings, name, getattr(settings, name))


def test_a_path_may_be_text(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text("seed: 4")
    assert load_config(str(tmp_path / "c.yaml")).seed == 4
