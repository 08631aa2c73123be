"""Settings of the registration methods."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gtsam_nav.settings import Settings


class PicSettings(Settings):
    """Probabilistic iterative correspondence.

    Attributes
    ----------
    association : {"mean", "nearest"}
        Pair a point with the covariance-weighted mean of its compatible points, or with the
        nearest of them.
    gate : float
        Chi-square gate (2 degrees of freedom) of the association.
    max_iterations : int
    shrink : float
        Least factor on the prior covariance in the gate from one iteration to the next; while the
        pose moves the gate shrinks less.
    cauchy_k : float
        Scale of the Cauchy weight on the whitened residual.
    wall_radius_m : float
        Surroundings in which reference points are taken for a wall, for the match's covariance.
    min_overlap : float
        Least share of points that must pair.
    floor_xy_m, floor_yaw_deg : float
        The match's standard deviations are never stated smaller.
    """

    association: Literal["mean", "nearest"] = "mean"
    gate: float = Field(default=5.99, gt=0)
    max_iterations: int = Field(default=60, ge=1)
    shrink: float = Field(default=0.4, gt=0, le=1)
    cauchy_k: float = Field(default=1.5, gt=0)
    wall_radius_m: float = Field(default=3.0, gt=0)
    min_overlap: float = Field(default=0.4, ge=0, le=1)
    floor_xy_m: float = Field(default=0.1, ge=0)
    floor_yaw_deg: float = Field(default=0.5, ge=0)


class CorrelativeSettings(Settings):
    """Correlative registration.

    Attributes
    ----------
    cell_m : float
        Of the grid on which poses are tried, and which blurs the reference.
    reach_m, reach_deg : float
        No pose further off along an axis or in yaw is tried, however vague the prior.
    min_score : float
        Least share of the new points that the reference must explain.
    max_rival : float
        Where poses further off than ``rival_m`` or ``rival_deg`` score more than this share of the
        best, the match is ambiguous.
    rival_m, rival_deg : float
    """

    cell_m: float = Field(default=0.2, gt=0)
    reach_m: float = Field(default=12.0, gt=0)
    reach_deg: float = Field(default=45.0, gt=0, le=180)
    min_score: float = Field(default=0.5, ge=0, le=1)
    max_rival: float = Field(default=0.85, gt=0, le=1)
    rival_m: float = Field(default=1.0, gt=0)
    rival_deg: float = Field(default=10.0, gt=0)


class Open3dSettings(Settings):
    """Registration of 3-D clouds.

    Attributes
    ----------
    voxel_m : float
        Clouds are thinned to one point a cube of this side, by `register` and in a map of them. The
        loops of ``graph`` have half of ``kiss.voxel_m`` instead, as the odometry leaves its clouds.
    min_points : int
        Clouds of fewer points are not registered.
    min_fitness : float
        Least share of points that must find a partner within two voxels.
    floor_m, floor_deg : float
        What is added to a match's standard deviations for errors that no residual shows.
    """

    voxel_m: float = Field(default=0.25, gt=0)
    min_points: int = Field(default=100, ge=3)
    min_fitness: float = Field(default=0.5, ge=0, le=1)
    floor_m: float = Field(default=0.02, ge=0)
    floor_deg: float = Field(default=0.1, ge=0)
