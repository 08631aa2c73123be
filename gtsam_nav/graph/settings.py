"""Settings of the factor graph."""

from __future__ import annotations

from pydantic import Field

from gtsam_nav.settings import Settings


class LoopSettings(Settings):
    """Which earlier scans a scan is registered against, and what may enter the graph.

    Attributes
    ----------
    radius_m : float
        Scans whose estimated distance, less their uncertainty, is smaller are candidates.
    min_separation_s : float
        Nearer scans in time are not loops.
    max_candidates : int
        Nearest candidates registered a scan.
    gate_probability : float
        A match is rejected where it contradicts the estimate more than this probability allows.
    cauchy_k : float
        Scale of the Cauchy kernel on accepted loops.
    """

    radius_m: float = Field(default=15.0, gt=0)
    min_separation_s: float = Field(default=60.0, ge=0)
    max_candidates: int = Field(default=4, ge=1)
    gate_probability: float = Field(default=0.999, gt=0, lt=1)
    cauchy_k: float = Field(default=1.5, gt=0)


class RefinementSettings(Settings):
    """Joint registration of all echoes, each at its own beam's time.

    Attributes
    ----------
    max_iterations : int
    converged_m : float
        Stop where no keyframe moves further in an iteration.
    """

    max_iterations: int = Field(default=40, ge=0)
    converged_m: float = Field(default=0.01, gt=0)


class GraphSettings(Settings):
    """The factor graph.

    Attributes
    ----------
    keyframe_interval_s : float
        Longest time between keyframes.
    keyframes_per_update : int
        Keyframes handed to iSAM2 at once.
    huber_k : float
        Huber threshold of DVL, heading, attitude and depth residuals.
    """

    keyframe_interval_s: float = Field(default=7.0, gt=0)
    keyframes_per_update: int = Field(default=10, ge=1)
    huber_k: float = Field(default=1.345, gt=0)
    loops: LoopSettings = LoopSettings()
    refinement: RefinementSettings = RefinementSettings()
