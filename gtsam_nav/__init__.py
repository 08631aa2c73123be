"""Offline factor-graph navigation and sonar SLAM for marine vehicles.

Conventions, stated once
------------------------
SI and radians inside; degrees only under a ``_deg`` name at file, config and report borders.
Time is float64 seconds since the mission's ``start_utc``; zero is the earliest sample of any
sensor; windows are half-open on it.

===========  ====================================================================================
``n``        navigation frame: local NED at the mission's origin (WGS-84); d = depth when the
             origin is on the water. Without an origin it is a local frame and Earth rate is off.
``b``        body frame: x forward, y starboard, z down (FRD)
``i d s g``  sensor frames: IMU, DVL, sonar, GNSS antenna
``R_nb``     maps body coordinates into n; ``R_bs = Rz(yaw) Ry(pitch) Rx(roll)`` of a mounting
``p_n``      position, ``v_n`` velocity along n, ``v_b`` along b, ``q_nb_wxyz`` scalar first
``heading``  clockwise from true north
``sigma_*``  a standard deviation; ``cov`` a covariance
===========  ====================================================================================

Readers convert ENU/FLU on the way in, writers on the way out. The trajectory is the body origin's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

# at once, so that the functions and not the modules of those names are the package's
from gtsam_nav.batch import batch as batch
from gtsam_nav.lazy import lazy_names
from gtsam_nav.methods import estimate as estimate
from gtsam_nav.methods import methods as methods

if TYPE_CHECKING:
    from gtsam_nav import graph as graph
    from gtsam_nav import registration as registration
    from gtsam_nav import sonar as sonar
    from gtsam_nav.config import Config as Config
    from gtsam_nav.config import load_config as load_config
    from gtsam_nav.evaluation.comparison import ComparisonRow as ComparisonRow
    from gtsam_nav.evaluation.comparison import compare as compare
    from gtsam_nav.evaluation.metrics import Metrics as Metrics
    from gtsam_nav.evaluation.metrics import evaluate as evaluate
    from gtsam_nav.evaluation.report import write_report as write_report
    from gtsam_nav.mission import Mission as Mission
    from gtsam_nav.readers import open_mission as open_mission
    from gtsam_nav.simulation import simulate as simulate
    from gtsam_nav.solution import Solution as Solution
    from gtsam_nav.trajectory import Trajectory as Trajectory
    from gtsam_nav.writers.run_folder import write_run as write_run

__version__ = "0.1.0"

_PUBLIC = {
    "Config": "config",
    "load_config": "config",
    "ComparisonRow": "evaluation.comparison",
    "compare": "evaluation.comparison",
    "Metrics": "evaluation.metrics",
    "evaluate": "evaluation.metrics",
    "write_report": "evaluation.report",
    "Mission": "mission",
    "open_mission": "readers",
    "simulate": "simulation",
    "Solution": "solution",
    "Trajectory": "trajectory",
    "write_run": "writers.run_folder",
}

__all__ = sorted([*_PUBLIC, "batch", "estimate", "methods"])


_PIECES = ("graph", "registration", "sonar")
"""Packages for those who build their own."""

__getattr__ = lazy_names(__name__, {**_PUBLIC, **dict(zip(_PIECES, _PIECES, strict=True))})


def __dir__() -> list[str]:
    return [*__all__, *_PIECES, "__version__"]
