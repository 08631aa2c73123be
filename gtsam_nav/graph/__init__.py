"""The factor graph: the only package that imports gtsam."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gtsam_nav.lazy import lazy_names

if TYPE_CHECKING:
    from gtsam_nav.graph import factors as factors
    from gtsam_nav.graph.backend import Backend as Backend
    from gtsam_nav.graph.backend import Covariances as Covariances
    from gtsam_nav.graph.backend import graph_of as graph_of
    from gtsam_nav.graph.keyframes import keyframe_times as keyframe_times
    from gtsam_nav.graph.measurements import build_problem as build_problem
    from gtsam_nav.graph.problem import Problem as Problem
    from gtsam_nav.graph.settling import Settled as Settled
    from gtsam_nav.graph.settling import settle as settle

_PUBLIC = {
    "factors": "factors",
    "Backend": "backend",
    "Covariances": "backend",
    "graph_of": "backend",
    "keyframe_times": "keyframes",
    "build_problem": "measurements",
    "Problem": "problem",
    "Settled": "settling",
    "settle": "settling",
}

__all__ = sorted(_PUBLIC)
__getattr__ = lazy_names(__name__, _PUBLIC)
