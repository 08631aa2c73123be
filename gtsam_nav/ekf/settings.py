"""Settings of the reference filters."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gtsam_nav.settings import Settings


class DeadReckoningSettings(Settings):
    """The 8-state constant-velocity filter.

    Attributes
    ----------
    gate_probability : float
        Probability of the chi-square gate on each update.
    """

    gate_probability: float = Field(default=0.9999, gt=0, lt=1)


class InsSettings(Settings):
    """The strapdown error-state filter.

    Attributes
    ----------
    smooth : bool
        Run a Rauch-Tung-Striebel smoother over the filter; the filter's own estimate is then the
        causal one.
    gate_probability : float
        Probability of the chi-square gate on updates other than GNSS, which has its own.
    """

    smooth: bool = False
    gate_probability: float = Field(default=0.9999, gt=0, lt=1)


class LandmarkEkfSettings(Settings):
    """EKF-SLAM on landmarks.

    Attributes
    ----------
    motion : {"auto", "odometry", "ins"}
        What predicts the motion; ``auto`` takes odometry (or a DVL) where there is one.
    """

    motion: Literal["auto", "odometry", "ins"] = "auto"


class PoseEkfSettings(Settings):
    """The augmented-state filter on scan poses, and scan matching without it.

    Attributes
    ----------
    loop_radius_m : float
        Every earlier scan that is no further away is registered.
    association : {"mean", "nearest"}
        How the filter's registrations pair points, in place of ``pic.association``: nearest, as
        published; along a corridor the mean holds on to the walls' sampling and shortens the way.
    gate_probability : float
        Probability of the chi-square gate on each match, with and without the filter.
    """

    loop_radius_m: float = Field(default=15.0, gt=0)
    association: Literal["mean", "nearest"] = "nearest"
    gate_probability: float = Field(default=0.999, gt=0, lt=1)
