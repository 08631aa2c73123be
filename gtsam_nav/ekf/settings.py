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
    """The augmented-state filter on scan poses."""
