"""Settings of the reference filters."""

from __future__ import annotations

from pydantic import Field

from gtsam_nav.settings import Settings


class DeadReckoningSettings(Settings):
    """The 8-state constant-velocity filter.

    Attributes
    ----------
    sigma_accel_m_s2, sigma_vertical_accel_m_s2, sigma_yaw_accel_rad_s2 : float
        Acceleration noise of the motion model (white, per square root of Hz).
    water_lock_after_s : float
        Water lock is used only where bottom lock stays away for longer.
    gate_probability : float
        Probability of the chi-square gate on each update.
    rate_hz : float
        Least output rate.
    """

    sigma_accel_m_s2: float = Field(default=0.1, gt=0)
    sigma_vertical_accel_m_s2: float = Field(default=0.02, gt=0)
    sigma_yaw_accel_rad_s2: float = Field(default=0.1, gt=0)
    water_lock_after_s: float = Field(default=10.0, ge=0)
    gate_probability: float = Field(default=0.9999, gt=0, lt=1)
    rate_hz: float = Field(default=10.0, ge=1)
