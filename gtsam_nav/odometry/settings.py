"""Settings of the cloud odometry."""

from __future__ import annotations

from pydantic import Field

from gtsam_nav.settings import Settings


class KissSettings(Settings):
    """KISS-ICP.

    Attributes
    ----------
    use : bool
        Whether ``graph`` uses the clouds of a mission.
    voxel_m : float
        Side of the local map's voxels: about a hundredth of the range, as KISS-ICP itself has it.
    min_range_m, max_range_m : float
        Points nearer to the body's origin are the vehicle's own, those further away too sparse.
    keyframe_interval_s : float
        Shortest time between clouds whose poses are kept: they become keyframes of a graph.
    floor_m, floor_deg : float
        A pose in the local map is never stated more certain: sweeps are not rigid, and the map is
        made of them.
    """

    use: bool = True
    voxel_m: float = Field(default=0.8, gt=0)
    min_range_m: float = Field(default=1.0, ge=0)
    max_range_m: float = Field(default=80.0, gt=0)
    keyframe_interval_s: float = Field(default=1.0, gt=0)
    floor_m: float = Field(default=0.006, ge=0)
    floor_deg: float = Field(default=0.03, ge=0)
