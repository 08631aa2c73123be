"""A run is repeated from its own record, and what differs is said with its size."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import gtsam_nav as gn
from gtsam_nav.cli import app
from gtsam_nav.config import Config
from gtsam_nav.errors import DataError, OutputError, RepetitionError
from gtsam_nav.mission import Opening
from gtsam_nav.rerun import changed_versions, repeat
from gtsam_nav.writers.mission_folder import write_mission
from gtsam_nav.writers.run_comparison import SAME, compare, difference
from gtsam_nav.writers.run_folder import write_run
from gtsam_nav.writers.run_record import read_record

METHOD = "landmark-ekf"
FAULT = "landmarks:drop=0.2"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mission, and a run on a stretch of it with a fault."""
    place = tmp_path_factory.mktemp("made")
    write_mission(gn.simulate("ranger", seed=1, duration_s=12.0), place / "mission")
    mission = gn.open_mission(place / "mission").crop(1.0, 9.0)
    config = Config(seed=5)
    write_run(gn.estimate(mission, METHOD, config, faults=[FAULT]), config, place / "out")
    return place


@pytest.fixture
def run(made: Path, tmp_path: Path) -> Path:
    """A copy that a test may alter."""
    shutil.copytree(made / "out" / METHOD, tmp_path / METHOD)
    return tmp_path / METHOD


def test_the_record_says_all_that_a_repetition_needs(made: Path, run: Path) -> None:
    record = read_record(run / "run.json")
    assert record.opening == Opening(made / "mission", None, 1.0, 9.0)
    assert record.faults == (FAULT,)
    assert record.seed == 5
    assert {Path(name).name for name in record.sources} >= {"mission.yaml", "imu.csv"}
    assert all(Path(name).is_absolute() for name in record.sources)
    assert {"gtsam", "numpy", "numba", "python", "gtsam_nav"} <= record.versions.keys()


def test_a_run_comes_out_the_same(run: Path, tmp_path: Path) -> None:
    repetition = repeat(run, tmp_path / "again")
    assert repetition.is_same
    assert repetition.versions == {}
    assert "trajectory.tum" in repetition.files
    assert "run.json" not in repetition.files
    assert (tmp_path / "again" / METHOD / "run.json").is_file()


def test_other_settings_come_out_otherwise(run: Path, tmp_path: Path) -> None:
    text = (run / "config.yaml").read_text()
    (run / "config.yaml").write_text(text.replace("seed: 5", "seed: 6"))
    repetition = repeat(run, tmp_path / "again")
    assert not repetition.is_same
    assert repetition.files["config.yaml"] == "was changed since the run"
    assert "from line" in repetition.files["rejections.csv"] or repetition.files["trajectory.tum"]


def altered(run: Path, **changes: object) -> Path:
    document = json.loads((run / "run.json").read_text())
    (run / "run.json").write_text(json.dumps({**document, **changes}))
    return run


def test_an_edited_configuration_is_named(run: Path, tmp_path: Path) -> None:
    with (run / "config.yaml").open("a") as stream:
        stream.write("# my own\n")
    failed = CliRunner().invoke(app, ["rerun", str(run), "--out", str(tmp_path / "again")])
    assert isinstance(failed.exception, RepetitionError)
    assert "config.yaml was changed since the run" in " ".join(failed.output.split())


def test_a_record_of_an_earlier_version_can_be_repeated(run: Path, tmp_path: Path) -> None:
    document = json.loads((run / "run.json").read_text())
    del document["config_sha256"]
    (run / "run.json").write_text(json.dumps(document))
    assert repeat(run, tmp_path / "again").is_same


def test_the_runs_of_a_batch_are_repeated_side_by_side(run: Path, tmp_path: Path) -> None:
    for mission in ("m0", "m1"):
        shutil.copytree(run, tmp_path / "batch" / mission / METHOD)
    arguments = ["rerun", str(tmp_path / "batch"), "--out", str(tmp_path / "kept")]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    for mission in ("m0", "m1"):
        assert (tmp_path / "kept" / mission / METHOD / "run.json").is_file()


@pytest.mark.parametrize("text", ['{"method": 3}', "{", "[]"])
def test_a_damaged_record_is_told_in_a_line(run: Path, text: str) -> None:
    (run / "run.json").write_text(text)
    with pytest.raises(DataError, match=r"run\.json: is no record of a run: ") as told:
        read_record(run / "run.json")
    assert "\n" not in str(told.value)
    assert "://" not in str(told.value)


def test_files_that_changed_or_are_gone_are_named(run: Path, tmp_path: Path) -> None:
    changed, gone = tmp_path / "imu.csv", tmp_path / "gone.csv"
    changed.write_text("t\n")
    altered(run, sources={str(changed): "0" * 64, str(gone): "0" * 64})
    with pytest.raises(DataError, match=r"imu\.csv has changed; .*gone\.csv is gone"):
        repeat(run, tmp_path / "again")
    assert not (tmp_path / "again").exists()


def test_a_run_that_came_from_no_file_cannot_be_repeated(run: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="does not say how its mission was opened"):
        repeat(altered(run, opening=None), tmp_path / "again")


def test_a_mission_that_is_cropped_twice_remembers_the_common_span() -> None:
    opening = Opening(Path("/m")).cropped(1.0, np.inf).cropped(-np.inf, 9.0).cropped(0.0, 12.0)
    assert opening == Opening(Path("/m"), None, 1.0, 9.0)
    assert Opening(Path("/m")).cropped(-np.inf, np.inf) == Opening(Path("/m"))


def test_other_versions_are_listed(run: Path) -> None:
    record = read_record(run / "run.json")
    older = replace(record, versions={**record.versions, "numpy": "1.0", "gone": "2.0"})
    found = changed_versions(older)
    assert found["numpy"] == ("1.0", record.versions["numpy"])
    assert found["gone"] == ("2.0", None)
    assert changed_versions(record) == {}


@pytest.mark.parametrize(
    ("one", "two", "told"),
    [
        (b"a", b"a", SAME),
        (b"t,n\n0,1.5\n1,2\n", b"t,n\n0,1.25\n1,2\n", "1 of 4 numbers differ, by 0.25 at most"),
        (b'{"x": 1e-3}', b'{"x": -1e-3}', "1 of 1 numbers differ, by 0.002 at most"),
        (b"a,1\nb,2\n", b"a,1\nc,2\nd,3\n", "2 lines became 3, other from line 2 on"),
        (b"a\n", b"a\nb\n", "1 lines became 2, other from line 2 on"),
        (b"\0\1\2", b"\0\1\3\4", "2 of 4 bytes differ"),
        (b"x1 1", b"x2 1", "1 lines became 1, other from line 1 on"),
    ],
)
def test_differences_are_told_with_their_size(one: bytes, two: bytes, told: str) -> None:
    assert difference(one, two) == told


def test_results_that_only_one_has_are_told(tmp_path: Path) -> None:
    for name, files in (("one", "ab"), ("two", "bc")):
        (tmp_path / name / "export").mkdir(parents=True)
        for file in (*files, "run.json"):
            (tmp_path / name / file).write_text("x" if file in "abc" else name)
    found = compare(tmp_path / "one", tmp_path / "two")
    assert found == {"a": "not in the repetition", "b": SAME, "c": "only in the repetition"}


def test_the_command_compares_and_its_exit_code_tells(run: Path, tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["rerun", str(run), "--out", str(tmp_path / "kept")])
    assert done.exit_code == 0, done.output
    assert "the same again" in done.output
    assert (tmp_path / "kept" / METHOD / "trajectory.tum").is_file()
    (run / "loops.csv").write_text("of another day\n")
    failed = CliRunner().invoke(app, ["rerun", str(run)])
    assert isinstance(failed.exception, RepetitionError)
    assert failed.exception.exit_code == 5
    assert "other from line 1" in failed.output
    refused = CliRunner().invoke(app, ["rerun", str(run), "--out", str(run.parent)])
    assert isinstance(refused.exception, OutputError)
