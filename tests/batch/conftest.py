"""Short missions on disk."""

from __future__ import annotations

from pathlib import Path

import pytest

from gtsam_nav.simulation import simulate
from gtsam_nav.writers.mission_folder import write_mission


@pytest.fixture(scope="session")
def missions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of two good missions and one whose velocities are not numbers."""
    folder = tmp_path_factory.mktemp("missions")
    for name in ("m0", "m1", "bad"):
        write_mission(simulate("marina", seed=1, duration_s=20.0), folder / name)
    velocities = folder / "bad/dvl.csv"
    velocities.write_text(velocities.read_text().replace("\n0", "\nnought", 1))
    return folder
