"""The registry of readers: what each must keep to, and paths that none of them knows."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from gtsam_nav.errors import DataError
from gtsam_nav.readers import Reader, open_mission, readers
from gtsam_nav.simulation import simulate
from gtsam_nav.writers.mission_folder import write_mission


@pytest.mark.parametrize("reader", readers(), ids=lambda r: r.NAME)
def test_every_reader_declines_what_it_does_not_know(reader: Reader, tmp_path: Path) -> None:
    assert reader.NAME
    assert reader.EXPECTS
    (tmp_path / "notes.txt").write_text("nothing")
    for path in (tmp_path, tmp_path / "notes.txt", tmp_path / "absent"):
        assert not reader.can_open(path)


def test_an_unknown_path_is_told_what_every_reader_expects(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=str(tmp_path)) as caught:
        open_mission(tmp_path)
    for reader in readers():
        assert reader.EXPECTS in str(caught.value)


def test_the_one_mission_in_a_folder_is_opened(tmp_path: Path) -> None:
    write_mission(simulate("laps", seed=1, duration_s=5.0), tmp_path / "monday")
    assert open_mission(tmp_path).name == open_mission(tmp_path / "monday").name
    write_mission(simulate("laps", seed=2, duration_s=5.0), tmp_path / "tuesday")
    with pytest.raises(DataError, match="holds 2 missions; name one of: monday, tuesday"):
        open_mission(tmp_path)


def test_missions_two_folders_down_are_listed(tmp_path: Path) -> None:
    mission = simulate("laps", seed=1, duration_s=5.0)
    for name in ("one/monday", "one/tuesday", "friday"):
        write_mission(mission, tmp_path / "all" / name)
    (tmp_path / "all" / "notes").mkdir()
    with pytest.raises(DataError, match=r"holds 3 missions; .*: friday, one/monday, one/tuesday"):
        open_mission(tmp_path / "all")


@pytest.mark.parametrize("columns", [8, 12])
def test_a_trajectory_is_no_mission_and_evaluate_is_named(tmp_path: Path, columns: int) -> None:
    path = tmp_path / "track.txt"
    path.write_text("# a comment\n" + 3 * (" ".join(["0.5"] * columns) + "\n"))
    with pytest.raises(DataError, match="a trajectory and no mission: 'gtsam-nav evaluate"):
        open_mission(path)


def test_an_absent_path_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file or folder"):
        open_mission(tmp_path / "absent")


def test_importing_the_readers_loads_nothing_but_the_types() -> None:
    code = "import sys, gtsam_nav.readers; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {"scipy", "numba", "pymap3d", "yaml", "pydantic"}.isdisjoint(run.stdout.split())
