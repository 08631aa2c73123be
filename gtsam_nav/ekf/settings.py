"""Settings of the reference filters."""

from __future__ import annotations

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
