"""Settings of the factor graph."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gtsam_nav.graph.robust import RobustSettings
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
    max_searches : int
        Scans that look for candidates: those of a longer mission do at even intervals, since each
        search costs in proportion to the mission's length.
    consistency_probability : float or None
        Closures enter the final solution as the largest set of which each pair, with what all other
        sensors say, passes a chi-square test of this probability; None lets all enter.
    arbiter : {"none", "gnc"}
        What judges them last: graduated non-convexity leaves out those whose residuals stay beyond
        ``arbiter_probability``.
    """

    radius_m: float = Field(default=15.0, gt=0)
    min_separation_s: float = Field(default=60.0, ge=0)
    max_candidates: int = Field(default=2, ge=1)
    max_searches: int = Field(default=100, ge=1)
    consistency_probability: float | None = Field(default=0.9999, gt=0, lt=1)
    arbiter: Literal["none", "gnc"] = "none"
    arbiter_probability: float = Field(default=0.999, gt=0, lt=1)


class CloudLoopSettings(Settings):
    """Which earlier 3-D clouds a cloud is registered against, and what may enter the graph.

    Attributes
    ----------
    interval_s : float
        Clouds nearer in time to the last one that was compared are not.
    radius_m : float
        Clouds whose estimated distance, less its uncertainty, is smaller are candidates.
    min_separation_s, max_candidates
        As in `LoopSettings`.
    """

    interval_s: float = Field(default=3.0, ge=0)
    radius_m: float = Field(default=10.0, gt=0)
    min_separation_s: float = Field(default=30.0, ge=0)
    max_candidates: int = Field(default=1, ge=1)


class SubmapLoopSettings(Settings):
    """Loops of a scanner whose scans are taken at once: between submaps, the scans of a stretch.

    Attributes
    ----------
    reach_m : float
        A submap holds the scans so far along the track to either side of its own.
    spacing_m : float
        Along the track, from one submap to the next.
    radius_m : float
        Submaps whose estimated distance, less two standard deviations, is smaller are candidates.
    max_candidates : int
        Nearest passages that a submap is registered to.
    """

    reach_m: float = Field(default=8.0, gt=0)
    spacing_m: float = Field(default=3.0, gt=0)
    radius_m: float = Field(default=3.0, gt=0)
    max_candidates: int = Field(default=4, ge=1)


class RefinementSettings(Settings):
    """Joint registration of all echoes, each at its own beam's time.

    Attributes
    ----------
    max_iterations : int
        Zero leaves the pose graph of rigid scans as it is.
    converged_m : float
        Stop where no keyframe moves further in an iteration.
    neighbour_radius_m : float
        Scans taken further apart are not compared.
    max_neighbours : int
        Scans that each is compared with at most: the nearest of each passage first.
    first_gate_m, last_gate_m, gate_factor : float
        Partners are sought within a distance that shrinks by a factor each iteration, and to the
        last at once where no knot moved further than a decimetre, or than ``converged_m``.
    line_radius_m, line_thickness_m : float
        An echo lies on a wall where its neighbours within the radius are thinner than this.
    point_radius_m, min_sightings : float, int
        Off the walls an echo counts where no single wall fills this surrounding, and where it has
        partners in so many other scans: clutter is seen once.
    cauchy_k : float
        Scale of the Cauchy weight, in standard deviations of the residuals found.
    """

    max_iterations: int = Field(default=40, ge=0)
    converged_m: float = Field(default=0.03, gt=0)
    neighbour_radius_m: float = Field(default=30.0, gt=0)
    max_neighbours: int = Field(default=30, ge=2)
    first_gate_m: float = Field(default=3.0, gt=0)
    last_gate_m: float = Field(default=1.0, gt=0)
    gate_factor: float = Field(default=0.85, gt=0, le=1)
    line_radius_m: float = Field(default=3.0, gt=0)
    line_thickness_m: float = Field(default=0.4, gt=0)
    point_radius_m: float = Field(default=2.0, gt=0)
    min_sightings: int = Field(default=3, ge=1)
    cauchy_k: float = Field(default=1.5, gt=0)


class GraphSettings(Settings):
    """The factor graph.

    Attributes
    ----------
    keyframe_interval_s : float
        Longest time between keyframes; the causal trajectory consists of them, and is scored only
        where they are at most 5 s apart. Where a compass alone tells the turns they are closer.
    anchor_spacing_s : float
        Fixes and sightings get keyframes of their own unless they follow each other faster.
    imu_min_rate_hz : float
        A slower IMU is not preintegrated where a DVL or odometry measures the velocity: rotations
        then come from the AHRS.
    imu_preintegration : {"standard", "combined"}
        Whether the biases stand still between keyframes, or walk there too and widen the noise.
    keyframes_per_update : int
        Keyframes handed to iSAM2 at once, and more where the mission would take over 1000 updates.
    """

    keyframe_interval_s: float = Field(default=5.0, gt=0, le=5)
    anchor_spacing_s: float = Field(default=0.1, ge=0.05)
    imu_min_rate_hz: float = Field(default=50.0, gt=0)
    imu_preintegration: Literal["standard", "combined"] = "standard"
    keyframes_per_update: int = Field(default=3, ge=1)
    robust: RobustSettings = RobustSettings()
    loops: LoopSettings = LoopSettings()
    submap_loops: SubmapLoopSettings = SubmapLoopSettings()
    cloud_loops: CloudLoopSettings = CloudLoopSettings()
    refinement: RefinementSettings = RefinementSettings()
