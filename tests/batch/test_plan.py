"""What a batch has to do, and what it calls it."""

from __future__ import annotations

from pathlib import Path

import pytest

from gtsam_nav.batch.plan import find_missions, label_missions, parse_sweep, plan_runs
from gtsam_nav.config import Config
from gtsam_nav.errors import ConfigError, DataError


@pytest.fixture
def missions(tmp_path: Path) -> Path:
    for name in ("may/m1", "may/m2", "june/m1"):
        (tmp_path / name).mkdir(parents=True)
    return tmp_path


def test_patterns_match_each_path_once(missions: Path) -> None:
    found = find_missions([missions / "*/m1", f"{missions}/may/*", missions / "june/m1"])
    names = [path.relative_to(missions).as_posix() for path in found]
    assert names == ["june/m1", "may/m1", "may/m2"]


def test_a_pattern_without_a_match_is_an_error(missions: Path) -> None:
    with pytest.raises(DataError, match="no file or folder matches"):
        find_missions([missions / "july/*"])


def test_a_path_without_a_pattern_need_not_be_a_file(missions: Path) -> None:
    """The stem of a robot's files is the path of a mission."""
    assert find_missions([missions / "Robot3"]) == [missions / "Robot3"]


def test_labels_are_as_long_as_it_takes(missions: Path) -> None:
    may, june = missions / "may/m1", missions / "june/m1"
    assert list(label_missions([may, missions / "may/m2"])) == ["m1", "m2"]
    assert label_missions([may, june]) == {"may_m1": may, "june_m1": june}


def test_sweeps_read_values_as_yaml() -> None:
    swept = parse_sweep(["graph.keyframe_interval_s=0.5,1", "gnss.window_s=[0,60],[0,120]"])
    assert swept == {
        "graph.keyframe_interval_s": [0.5, 1],
        "gnss.window_s": [[0, 60], [0, 120]],
    }


@pytest.mark.parametrize("spec", ["seed", "seed=", "=1,2", "seed=[1"])
def test_a_malformed_sweep_is_an_error(spec: str) -> None:
    with pytest.raises(ConfigError, match="is not of the form key=v1,v2"):
        parse_sweep([spec])


def test_a_setting_is_swept_once() -> None:
    with pytest.raises(ConfigError, match="'seed' is swept twice"):
        parse_sweep(["seed=1", "seed=2"])


def test_missions_times_settings_times_methods(missions: Path) -> None:
    sweep = {"gnss.window_s": [[0, 60], [0, 120]], "seed": [1, 2]}
    runs = plan_runs([missions / "may/*"], missions / "out", ["dr", "graph", "dr"], Config(), sweep)
    assert len({run.key for run in runs}) == len(runs) == 2 * 4 * 2
    last = runs[-1]
    assert (last.mission, last.method) == ("m2", "graph")
    assert (last.config.seed, last.config.gnss.window_s) == (2, (0.0, 120.0))
    assert last.folder == missions / "out/m2/gnss.window_s=[0,120],seed=2"


def test_without_a_sweep_runs_stand_right_below_their_mission(missions: Path) -> None:
    (run,) = plan_runs([missions / "june/m1"], missions / "out", ["dr"], Config(), {})
    assert (run.sweep, run.folder) == ("", missions / "out/m1")


def test_the_key_tells_configurations_apart(missions: Path) -> None:
    def key(config: Config) -> str:
        return plan_runs([missions / "june/m1"], missions / "out", ["dr"], config, {})[0].key

    assert key(Config()) == key(Config(seed=0)) != key(Config(seed=1))


def test_an_unknown_setting_is_an_error_before_anything_runs(missions: Path) -> None:
    with pytest.raises(ConfigError, match=r"unknown config key 'gnss\.usage'"):
        plan_runs([missions / "may/*"], missions, ["dr"], Config(), {"gnss.usage": ["all"]})


def test_another_card_is_another_run(missions: Path) -> None:
    card = missions / "card.yaml"
    (bare,), (carded,) = (
        plan_runs([missions / "june/m1"], missions / "out", ["dr"], Config(), {}, given)
        for given in (None, card)
    )
    assert carded.card == card
    assert carded.key != bare.key
