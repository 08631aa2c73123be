"""Clouds in memory, written to a mission folder and read back."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import gtsam_nav as gn
from gtsam_nav.readers.clouds import load
from gtsam_nav.series import CloudSeries
from gtsam_nav.simulation import simulate
from gtsam_nav.writers.mission_folder import write_mission


def test_simulated_clouds_come_back_bit_for_bit(tmp_path: Path) -> None:
    mission = simulate("harbour", seed=1, duration_s=1.5)
    write_mission(mission, tmp_path / "harbour")
    read = gn.open_mission(tmp_path / "harbour").sensors["lidar"]
    written = mission.sensors["lidar"]
    assert isinstance(read.series, CloudSeries)
    assert isinstance(written.series, CloudSeries)
    assert len(read.series) == len(written.series) > 4
    np.testing.assert_allclose(read.R_bs, written.R_bs, atol=1e-12)
    for path, cloud in zip(read.series.clouds, written.series.clouds, strict=True):
        copy, original = load(path), load(cloud)
        assert isinstance(path, Path)
        np.testing.assert_array_equal(copy.points_s, original.points_s)
        np.testing.assert_array_equal(copy.offset_s, original.offset_s)
