"""What is written appears whole or not at all: errors, full disks and signals leave no half."""

from __future__ import annotations

import errno
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import solutions

import gtsam_nav as gn
from gtsam_nav.config import Config
from gtsam_nav.errors import OutputError
from gtsam_nav.evaluation.report import write_report
from gtsam_nav.writers.atomic import draft_folder, remove_drafts, replacing_file, replacing_folder
from gtsam_nav.writers.exports import export_run
from gtsam_nav.writers.mission_folder import write_mission
from gtsam_nav.writers.run_folder import write_run

CLI = (sys.executable, "-c", "from gtsam_nav.cli import main; main()")


def names(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def fail(error: BaseException) -> None:
    raise error


def test_a_folder_takes_its_place_whole(tmp_path: Path) -> None:
    for text in ("first", "second"):
        with replacing_folder(tmp_path / "out") as draft:
            (draft / text).write_text(text)
            assert not (tmp_path / "out" / text).exists()
    assert names(tmp_path) == {"out", "out/second"}


@pytest.mark.parametrize(
    "error", [OSError(errno.ENOSPC, "full"), KeyboardInterrupt(), SystemExit(1)]
)
@pytest.mark.parametrize("replacing", [replacing_folder, replacing_file])
def test_what_was_there_stays_where_the_new_does_not_come_to_be(
    tmp_path: Path, error: BaseException, replacing: Callable[[Path], object]
) -> None:
    if replacing is replacing_folder:
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "old").write_text("old")
    else:
        (tmp_path / "out").write_text("old")
    before = names(tmp_path)

    def write() -> None:
        with replacing(tmp_path / "out") as draft:
            (draft / "half" if draft.is_dir() else draft).write_text("half")
            raise error

    with pytest.raises(type(error)):
        write()
    assert names(tmp_path) == before


def test_what_was_there_comes_back_where_the_new_cannot_take_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "old").write_text("old")
    rename = Path.rename
    monkeypatch.setattr(
        Path,
        "rename",
        lambda p, to: fail(OSError("no")) if p.name.endswith(".draft") else rename(p, to),
    )
    with pytest.raises(OSError, match="no"), replacing_folder(out) as draft:
        (draft / "new").write_text("new")
    assert names(tmp_path) == {"out", "out/old"}


def test_a_draft_of_a_killed_process_is_no_hindrance_and_is_removed(tmp_path: Path) -> None:
    with draft_folder(tmp_path / "out") as draft:
        left = draft.name
    (tmp_path / left).mkdir()
    (tmp_path / left / "half").write_text("half")
    with replacing_folder(tmp_path / "out") as draft:
        assert not (draft / "half").exists()
    deep = tmp_path / "a" / "b" / ".report.html.7.draft"
    deep.mkdir(parents=True)
    (tmp_path / "a" / ".x.parquet.7.draft").write_text("half")
    remove_drafts(tmp_path)
    assert names(tmp_path) == {"out", "a", "a/b"}


def run(place: Path) -> None:
    write_run(solutions.dr_solution(), Config(), place)


def mission(place: Path) -> None:
    write_mission(gn.simulate("ranger", seed=1, duration_s=5.0), place / "mission")


def report(place: Path) -> None:
    write_report([solutions.dr_solution()], place)


def export(place: Path) -> None:
    export_run(place / "dr", ["kitti", "tum"])


@pytest.mark.parametrize("write", [run, mission, report, export])
def test_a_full_disk_is_an_error_that_names_the_place_and_leaves_no_half(
    tmp_path: Path, write: Callable[[Path], None]
) -> None:
    """A bound on the size of files ends the writing as a full disk does."""
    if write is export:
        run(tmp_path)
    before = names(tmp_path)
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, hard))
    try:
        with pytest.raises(OutputError, match=str(tmp_path)):
            write(tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    assert names(tmp_path) == before
    write(tmp_path)
    assert len(names(tmp_path)) > len(before)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)], ids=["SIGTERM", "SIGINT"]
)
def test_a_signal_leaves_what_was_done_and_nothing_half(
    tmp_path: Path, number: signal.Signals, code: int
) -> None:
    write_mission(gn.simulate("marina", seed=1, duration_s=120.0), tmp_path / "mission")
    out = tmp_path / "out"
    command = ("run", str(tmp_path / "mission"), "-q", "-m", "dr", "-m", "graph", "--out", str(out))
    process = subprocess.Popen([*CLI, *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    until = time.monotonic() + 120.0
    while not (out / "dr" / "run.json").is_file() and time.monotonic() < until:
        time.sleep(0.02)
    process.send_signal(number)
    _, errors = process.communicate(timeout=120.0)
    assert process.returncode == code, errors
    assert b"Traceback" not in errors
    assert (out / "dr" / "trajectory.tum").is_file()
    assert [name for name in names(out) if "/." in f"/{name}"] == []


@pytest.mark.slow
def test_an_interrupted_batch_can_be_resumed(tmp_path: Path) -> None:
    for seed in (1, 2, 3):
        made = gn.simulate("ranger", seed=seed, duration_s=60.0)
        write_mission(made, tmp_path / "missions" / f"m{seed}")
    out = tmp_path / "out"
    command = ("batch", str(tmp_path / "missions" / "*"), "-q", "-m", "landmark-ekf")
    command += ("-m", "ins-ekf", "--workers", "1", "--out", str(out))
    process = subprocess.Popen([*CLI, *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    until = time.monotonic() + 120.0
    while not [*out.glob("results.parquet/[!.]*")] and time.monotonic() < until:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=120.0)
    assert process.returncode == 130
    assert [name for name in names(out) if "/." in f"/{name}"] == []
    done = subprocess.run([*CLI, *command, "--resume"], capture_output=True, timeout=300.0)
    assert done.returncode == 0, done.stderr
    assert len([*out.glob("*/*/run.json")]) == 6
