"""What all tests share: profiles of hypothesis, and the recorded missions."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# derandomised: a test that passes here passes everywhere
settings.register_profile(
    "repeatable",
    derandomize=True,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
settings.load_profile("repeatable")

# a shell's background jobs ignore Ctrl-C, and so would the processes that tests interrupt
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def recorded_data() -> Path:
    """The folder of recorded missions; a test that asks for it is marked ``realdata``."""
    default = Path(__file__).parents[2] / "shared" / "data"
    folder = Path(os.environ.get("GTSAM_NAV_DATA", default))
    if not folder.is_dir():
        pytest.skip("no recorded missions; GTSAM_NAV_DATA names their folder")
    return folder


@pytest.fixture(scope="session")
def stpere_folder(recorded_data: Path) -> Path:
    """The logs of the St. Pere mission."""
    folder = recorded_data / "stpere"
    if not folder.is_dir():
        pytest.skip("the St. Pere logs are not among the recorded missions")
    return folder


@pytest.fixture(scope="session")
def open3d_here() -> None:
    """Skips where Open3D does not import: it links libraries that not every system has."""
    from gtsam_nav.errors import PackageError
    from gtsam_nav.registration.packages import open3d

    try:
        open3d("this test")
    except PackageError as error:
        pytest.skip(str(error))
