"""Settings of the vehicle's motion model."""

from __future__ import annotations

from pydantic import Field

from gtsam_nav.settings import Settings


class MotionSettings(Settings):
    """How the vehicle moves between measurements, for every method.

    Attributes
    ----------
    sigma_accel_m_s2, sigma_vertical_accel_m_s2, sigma_yaw_accel_rad_s2 : float
        Densities of the white acceleration that changes its velocities, per square root of Hz.
    fit_accelerations : bool
        Raise these where its sensors show a vehicle that is much brisker.
    water_lock_after_s : float
        Water lock is used only where bottom lock stays away for longer.
    rate_hz : float
        Rate of the trajectories.
    nonholonomic, zero_velocity : bool or None
        Constraints on the motion; None takes the mission's own word (``Mission.constraints``).
    nonholonomic_sigma_m_s : float
        Of the velocity sideways and upwards that such a vehicle shows all the same.
    pitch_by_acceleration_sigma_deg_s2_m : float
        Spread of how far the springs of such a vehicle let its bow rise, degrees per m/s^2 of
        acceleration; the graph finds it. Zero is a rigid one.
    zero_velocity_sigma_m_s : float
        Of each component of the velocity at rest.
    """

    sigma_accel_m_s2: float = Field(default=0.05, gt=0)
    sigma_vertical_accel_m_s2: float = Field(default=0.02, gt=0)
    sigma_yaw_accel_rad_s2: float = Field(default=0.1, gt=0)
    fit_accelerations: bool = True
    water_lock_after_s: float = Field(default=10.0, ge=0)
    rate_hz: float = Field(default=10.0, ge=10, le=1000)
    nonholonomic: bool | None = None
    zero_velocity: bool | None = None
    nonholonomic_sigma_m_s: float = Field(default=0.1, gt=0)
    pitch_by_acceleration_sigma_deg_s2_m: float = Field(default=0.5, ge=0)
    zero_velocity_sigma_m_s: float = Field(default=0.01, gt=0)
