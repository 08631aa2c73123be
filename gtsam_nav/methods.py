"""The registry of estimation methods.

The package imports this module at once, since its name is also that of a function: it imports
nothing else before it is called.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING

from gtsam_nav.errors import ConfigError

if TYPE_CHECKING:
    from gtsam_nav.config import Config
    from gtsam_nav.mission import Mission
    from gtsam_nav.simulation import Fault
    from gtsam_nav.solution import Progress, Solution

    Method = Callable[[Mission, Config, Progress], Solution]


def _has_velocity(mission: Mission) -> bool:
    from gtsam_nav.preprocess.motion import measures_velocity

    return measures_velocity(mission)


def _has_imu(mission: Mission) -> bool:
    return mission.first("imu") is not None


def _has_motion(mission: Mission) -> bool:
    return _has_velocity(mission) or _has_imu(mission)


def _moves(mission: Mission) -> bool:
    from gtsam_nav.preprocess.edge_motion import moves_by_edges

    return _has_motion(mission) or moves_by_edges(mission)


def _has_landmarks(mission: Mission) -> bool:
    from gtsam_nav.series import LandmarkSeries

    sensor = mission.first("landmarks")
    if sensor is None:
        return False
    assert isinstance(sensor.series, LandmarkSeries)
    # a filter cannot wait until several ranges, or bearings, have placed one
    return sensor.series.range_m is not None and sensor.series.bearing is not None


def _has_sonar(mission: Mission) -> bool:
    return mission.sonar_kind is not None


def _has_clouds(mission: Mission) -> bool:
    return mission.first("clouds") is not None


@dataclass(frozen=True)
class _Method:
    """Where a method's ``estimate`` is, what it must have, and whether it uses landmarks."""

    module: str
    needs: tuple[Callable[[Mission], bool], ...]
    uses_landmarks: bool = False


_METHODS = {
    "dr": _Method("gtsam_nav.ekf.dead_reckoning", (_has_velocity,)),
    "ins-ekf": _Method("gtsam_nav.ekf.ins", (_has_imu,)),
    "landmark-ekf": _Method("gtsam_nav.ekf.landmark_slam", (_has_landmarks, _has_motion), True),
    "scan-match": _Method("gtsam_nav.ekf.scan_match", (_has_sonar, _has_velocity)),
    "pose-ekf": _Method("gtsam_nav.ekf.pose_slam", (_has_sonar, _has_velocity)),
    "kiss": _Method("gtsam_nav.odometry.dead_reckoning", (_has_clouds,)),
    "graph": _Method("gtsam_nav.graph.estimator", (_moves,), True),
}


def methods() -> tuple[str, ...]:
    """Names that `estimate` takes."""
    return tuple(_METHODS)


def runnable_methods(mission: Mission) -> tuple[str, ...]:
    """Names of the methods that a mission has the sensors for."""
    return tuple(
        name for name, method in _METHODS.items() if all(need(mission) for need in method.needs)
    )


def check_method(method: str) -> None:
    """Raise a ConfigError for a name that `estimate` does not take."""
    if method not in _METHODS:
        raise ConfigError(f"unknown method '{method}'; the choices are: {', '.join(_METHODS)}")


def check_faults(method: str, faults: Sequence[Fault | str]) -> None:
    """Raise a ConfigError for false loop closures where no graph takes them."""
    from gtsam_nav.simulation.faults import FalseLoops

    for fault in faults:
        if method != "graph" and str(fault).startswith(f"{FalseLoops.TARGET}:"):
            raise ConfigError(f"'{fault}': only graph takes false loop closures, not {method}")


def _warnings(method: str, mission: Mission) -> tuple[str, ...]:
    """What a method makes of a mission otherwise than its user may think."""
    from gtsam_nav.preprocess.turning import warnings_on_turns

    return (
        *warnings_on_turns(method, mission),
        *_warnings_on_edges(method, mission),
        *_warnings_on_landmarks(method, mission),
    )


def _warnings_on_edges(method: str, mission: Mission) -> tuple[str, ...]:
    """What every method but the graph leaves out of a pose graph."""
    if method == "graph" or mission.edges is None:
        return ()
    from gtsam_nav.preprocess.edge_loops import n_loops

    n = n_loops(mission)
    return (f"{n} edges close loops, which only the method graph uses",) if n else ()


def _warnings_on_landmarks(method: str, mission: Mission) -> tuple[str, ...]:
    """What a method that knows no landmarks leaves out, though nothing else tells the place."""
    seen = mission.of_type("landmarks")
    if _METHODS[method].uses_landmarks or not seen or mission.first("gnss") is not None:
        return ()
    names = " and ".join(f"'{sensor.name}'" for sensor in seen)
    users = " or ".join(name for name in runnable_methods(mission) if _METHODS[name].uses_landmarks)
    advice = f": {users} would" if users else ""
    return (f"the landmarks of {names} are not used by {method}{advice}",)


def estimate(
    mission: Mission,
    method: str = "graph",
    config: Config | None = None,
    progress: Progress | None = None,
    faults: Sequence[Fault | str] = (),
) -> Solution:
    """Estimate the trajectory of a mission.

    The method sees neither the mission's reference nor the fixes that the GNSS policy withholds;
    it does see the faults, which these are spared.

    Parameters
    ----------
    mission : Mission
    method : str
        One of `methods`.
    config : Config, optional
        Defaults that hold for every mission where absent.
    progress : Progress, optional
        Called as the work goes on.
    faults : sequence of Fault or str
        What to inject, drawn with the configuration's seed; see `gtsam_nav.simulation.inject`.

    Raises
    ------
    ConfigError
        For an unknown method, or a fault that the mission cannot have.
    DataError
        Where the mission lacks what the method needs, stamps are in another unit than seconds, or
        the specific forces that it integrates in another than m/s^2.
    EstimationError
        Where the estimator fails.
    """
    from numpy.linalg import LinAlgError
    from threadpoolctl import threadpool_limits

    from gtsam_nav.config import Config
    from gtsam_nav.errors import EstimationError
    from gtsam_nav.preprocess.gnss_policy import split_fixes
    from gtsam_nav.preprocess.readying import made_ready
    from gtsam_nav.preprocess.stamp_units import check_stamp_units
    from gtsam_nav.solution import no_progress

    check_method(method)
    check_stamp_units(mission)
    config = config or Config()
    blind, reference, n_withheld = split_fixes(mission, config.gnss)
    blind = replace(blind, relations=None)
    if faults:
        from gtsam_nav.simulation import inject

        blind = inject(blind, faults, config.seed)
    check_faults(method, blind.faults)
    blind, motion = made_ready(blind, config.motion)
    config = config.model_copy(update={"motion": motion})
    blind = replace(blind, warnings=(*blind.warnings, *_warnings(method, blind)))
    run: Method = import_module(_METHODS[method].module).estimate
    try:
        # matrices of a thousand rows: more BLAS threads spend their time waiting for each other
        with threadpool_limits(limits=1, user_api="blas"):
            solution = run(blind, config, progress or no_progress)
    except (RuntimeError, ArithmeticError, LinAlgError) as error:
        what = " ".join(str(error).split())[:300]
        raise EstimationError(f"{method} could not solve '{mission.name}': {what}") from error
    return replace(
        _as_told(blind, solution),
        reference=reference,
        relations=mission.relations,
        gnss_withheld=n_withheld,
    )


def _as_told(mission: Mission, solution: Solution) -> Solution:
    """The solution, no surer nor vaguer than what the mission measured lets it be, and doubts."""
    from gtsam_nav.evaluation.contradictions import contradictions
    from gtsam_nav.preprocess.turning import (
        bounded_by_way,
        unknown_where_not_told,
        warnings_on_yaw,
    )

    whole, online = solution.trajectory, solution.online
    if _has_velocity(mission):
        whole, online = bounded_by_way(whole), online and bounded_by_way(online)
    whole, online = unknown_where_not_told(mission, whole, online)
    solution = replace(solution, trajectory=whole, online=online)
    doubts = (*warnings_on_yaw(mission, whole), *contradictions(solution))
    return replace(solution, warnings=(*solution.warnings, *doubts))
