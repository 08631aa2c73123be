"""Clouds by themselves: a folder of them, one file, and the recorded pair."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gtsam_nav.errors import DataError
from gtsam_nav.readers import cloud_files, open_mission
from gtsam_nav.readers.clouds import load
from gtsam_nav.series import CloudSeries


def series_of(path: Path) -> CloudSeries:
    series = open_mission(path).sensors["clouds"].series
    assert isinstance(series, CloudSeries)
    return series


def files(folder: Path) -> Path:
    for name in ("b.ply", "a.PCD", "c.ply"):
        (folder / name).write_bytes(b"not opened yet\n")
    return folder


def test_a_folder_s_clouds_come_in_the_order_of_their_names(tmp_path: Path) -> None:
    (files(tmp_path) / "notes.txt").write_text("no cloud")
    series = series_of(tmp_path)
    assert series.clouds == tuple(tmp_path / name for name in ("a.PCD", "b.ply", "c.ply"))
    np.testing.assert_array_equal(series.t, [0, 1, 2])
    assert any("no times" in w for w in open_mission(tmp_path).warnings)


def test_one_file_is_a_mission_of_one_cloud(tmp_path: Path) -> None:
    assert series_of(files(tmp_path) / "b.ply").clouds == (tmp_path / "b.ply",)


def test_a_folder_without_clouds_is_told_what_is_expected(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"\.ply or \.pcd"):
        cloud_files.read(tmp_path)


@pytest.mark.realdata
@pytest.mark.usefixtures("open3d_here")
def test_the_recorded_pair(recorded_data: Path) -> None:
    folder = recorded_data / "lidar_pair"
    if not folder.is_dir():
        pytest.skip("lidar_pair is not among the recorded missions")
    series = series_of(folder)
    assert [Path(str(p)).name for p in series.clouds] == ["source.ply", "target.ply"]
    assert all(len(load(source)) > 1000 for source in series.clouds)
