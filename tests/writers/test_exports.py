"""A finished run in other formats."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import solutions

from gtsam_nav.config import Config
from gtsam_nav.errors import ConfigError, DataError
from gtsam_nav.frames import ENU_FROM_NED
from gtsam_nav.writers.exports import FORMATS, export_run
from gtsam_nav.writers.frame import Frame
from gtsam_nav.writers.pose_graph import read_pose_graph
from gtsam_nav.writers.run_folder import write_run
from gtsam_nav.writers.trajectories import read_trajectory


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(solutions.graph_solution(), Config(), tmp_path_factory.mktemp("out"))


def test_formats_are_those_of_the_command_line() -> None:
    assert list(FORMATS) == ["tum", "kitti", "g2o", "nav", "geojson", "kml", "ply"]


def test_ned_exports_repeat_the_run(run: Path) -> None:
    paths = {name: export_run(run, [name])[0] for name in FORMATS}
    assert {path.parent for path in paths.values()} == {run / "export"}
    for name in ("geojson", "ply"):
        assert paths[name].read_bytes() == (run / paths[name].name).read_bytes()
    for name, separator, skipped in (("tum", " ", 0), ("nav", ",", 1)):
        exported, original = (
            np.loadtxt(path, delimiter=separator, skiprows=skipped)
            for path in (paths[name], run / paths[name].name)
        )
        np.testing.assert_allclose(
            exported, original, rtol=0, atol=1e-15 if name == "tum" else 2e-5
        )
    graphs = [
        read_pose_graph(path, run / "vertex_times.csv")
        for path in (paths["g2o"], run / "graph.g2o")
    ]
    np.testing.assert_array_equal(graphs[0].p_n, graphs[1].p_n)
    assert len(graphs[0].edges) == len(graphs[1].edges) > 0


def test_enu_exports_have_their_own_names(run: Path) -> None:
    paths = export_run(run, ["tum", "kitti", "g2o", "ply"], "enu")
    assert [path.name for path in paths] == [
        "trajectory_enu.tum", "trajectory_enu.kitti", "times.txt", "graph_enu.g2o", "map_enu.ply",
    ]  # fmt: skip
    tum, kitti, *_ = paths
    p_enu, p_n = np.loadtxt(tum)[:, 1:4], np.loadtxt(run / "trajectory.tum")[:, 1:4]
    np.testing.assert_allclose(p_enu, p_n @ ENU_FROM_NED)
    np.testing.assert_allclose(np.loadtxt(kitti)[:, [3, 7, 11]], p_enu)


@pytest.mark.parametrize("frame", ["ned", "enu"])
def test_kitti_reads_back_with_its_times(run: Path, frame: Frame) -> None:
    kitti, tum = (export_run(run, [name], frame)[0] for name in ("kitti", "tum"))
    one, two = read_trajectory(kitti, frame), read_trajectory(tum, frame)
    np.testing.assert_array_equal(one.t, two.t)
    np.testing.assert_array_equal(one.p_n, two.p_n)
    np.testing.assert_allclose(one.R_nb, two.R_nb, atol=1e-12)


def test_unknown_formats_and_frames_name_the_choices(run: Path) -> None:
    with pytest.raises(ConfigError, match="'gpx'; the choices are: tum, kitti"):
        export_run(run, ["tum", "gpx"])
    with pytest.raises(ConfigError, match="'flu'; the choices are: ned, enu"):
        export_run(run, ["tum"], "flu")  # type: ignore[arg-type]


def test_what_the_run_lacks_is_said_with_the_reason(tmp_path: Path) -> None:
    run = write_run(solutions.without_origin(solutions.dr_solution()), Config(), tmp_path)
    with pytest.raises(DataError, match=r"no graph\.g2o: the method builds no pose graph"):
        export_run(run, ["g2o"])
    with pytest.raises(DataError, match="geodetic origin"):
        export_run(run, ["kml"])
    with pytest.raises(DataError, match=r"run\.json"):
        export_run(tmp_path, ["tum"])
