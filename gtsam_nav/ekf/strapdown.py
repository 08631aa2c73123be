"""Strapdown inertial navigation: the state between measurements, and how its errors grow.

States live in the mission's NED, so that fixes and trajectories need no conversion. Within a span
the mechanisation runs in latitude, longitude and height and in the NED axes of the vehicle's own
place: quaternion attitude less Earth rate and transport rate, Coriolis, normal gravity with height,
meridian and transverse radii. Without an origin the Earth is flat, does not turn, and pulls with
standard gravity.

Errors are those of `sensors.prediction.BodyState` and of the biases: (theta_b, rho_b, nu_b, gyro,
accelerometer), 15 in all. They are vectors in body axes, the same in whichever NED the state is
expressed. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*
(2013), chapters 5 and 14; Titterton and Weston (2004), chapters 3 and 11.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gtsam_nav.ekf.local_level import LocalLevel, rotation, turned
from gtsam_nav.frames import STANDARD_GRAVITY_M_S2, Array, Origin
from gtsam_nav.mission import Sensor
from gtsam_nav.preprocess.rest import spells_of
from gtsam_nav.preprocess.strapdown import readings_at_origin
from gtsam_nav.sensors.noise import ImuNoise
from gtsam_nav.sensors.orientation import UNMEASURED_TILT_SIGMA_RAD
from gtsam_nav.sensors.prediction import BodyState
from gtsam_nav.sensors.silences import silent_spells
from gtsam_nav.series import ImuSeries

THETA, RHO, NU = slice(0, 3), slice(3, 6), slice(6, 9)
GYRO_BIAS, ACCEL_BIAS = slice(9, 12), slice(12, 15)
SIZE = 15
"""Number of errors, and above where each stands among them."""

MAX_GAP_S, MAX_GAP_SAMPLES = 0.2, 3.0
"""The IMU is silent where its samples lie further apart than both."""
MANOEUVRE_S = 10.0
"""How long a manoeuvre that the silent IMU misses lasts."""


@dataclass(frozen=True)
class InertialState:
    """State of the body's origin and of the IMU's errors.

    Attributes
    ----------
    t : float
        Mission time, s.
    q_nb_wxyz : ndarray, shape (4,)
    p_n, v_n : ndarray, shape (3,)
        Position (m) and velocity over the ground (m/s) in the mission's NED.
    gyro_bias_b, accel_bias_b : ndarray, shape (3,)
        Along body axes, rad/s and m/s^2.
    """

    t: float
    q_nb_wxyz: Array
    p_n: Array
    v_n: Array
    gyro_bias_b: Array
    accel_bias_b: Array

    @cached_property
    def body(self) -> BodyState:
        """What the sensor models take."""
        return BodyState(rotation(self.q_nb_wxyz), self.p_n, self.v_n)

    def corrected(self, error: Array) -> InertialState:
        """The state with an error of shape (15,) put right."""
        R_nb = self.body.R_nb
        return InertialState(
            self.t,
            turned(self.q_nb_wxyz, error[THETA]),
            self.p_n + R_nb @ error[RHO],
            self.v_n + R_nb @ error[NU],
            self.gyro_bias_b + error[GYRO_BIAS],
            self.accel_bias_b + error[ACCEL_BIAS],
        )


@dataclass(frozen=True)
class Span:
    """What a span of inertial readings does: the state at its end, and to a covariance P of the
    errors at its start: ``Phi P Phi' + Q``, both of shape (15, 15)."""

    state: InertialState
    Phi: Array
    Q: Array


class Strapdown:
    """Carries states from one time to another on an IMU's readings.

    Samples are readings of their instant, linear in between; a span may begin and end anywhere.
    Where the IMU is silent (also before its first sample and after its last) its last readings are
    held for a second; after that the vehicle keeps its velocity and attitude, and the uncertainty
    grows by what the vehicle does on this mission.

    Parameters
    ----------
    imu : Sensor
        Its readings are turned into body axes and moved to the body's origin: the centripetal part
        of the lever arm exactly, the Euler part by the gyro's central differences.
    origin : Origin, optional
        Of the mission's NED.
    """

    def __init__(self, imu: Sensor, origin: Origin | None) -> None:
        series = imu.series
        assert isinstance(series, ImuSeries)
        self.level = None if origin is None else LocalLevel(origin)
        self._origin = np.empty(0) if self.level is None else np.array(self.level.origin)
        self.noise = ImuNoise.model_validate(imu.noise)
        self.t = series.t
        self.gyro_b, self.accel_b = readings_at_origin(imu)
        usual_s = float(np.median(np.diff(self.t))) if len(self.t) > 1 else 0.0
        self.max_gap_s = max(MAX_GAP_S, MAX_GAP_SAMPLES * usual_s)
        self.growth = _growth(imu, self.noise)

    def propagate(self, state: InertialState, to_s: float) -> Span:
        """The state at a later time, with the transition and the noise of its errors."""
        from gtsam_nav.ekf import _strapdown

        biases = state.gyro_bias_b, state.accel_bias_b
        x, p_n = np.concatenate([state.q_nb_wxyz, state.v_n, *biases]), state.p_n.copy()
        Phi, Q = np.eye(SIZE), np.zeros((SIZE, SIZE))
        _strapdown.integrate(
            x,
            p_n,
            Phi,
            Q,
            np.empty(_strapdown.SCRATCH),
            self._origin,
            self.t,
            self.gyro_b,
            self.accel_b,
            int(np.searchsorted(self.t, state.t, side="right")) - 1,
            state.t,
            to_s,
            self.max_gap_s,
            self.growth,
        )
        return Span(InertialState(to_s, x[:4], p_n, x[4:7], x[7:10], x[10:]), Phi, Q)

    def silences(self, from_s: float, to_s: float) -> Array:
        """First and last moment of each spell within a span that no held reading covers, (k, 2)."""
        return silent_spells(self.t, from_s, to_s, self._longest_s)

    @cached_property
    def _longest_s(self) -> float:
        """How long a reading is held."""
        from gtsam_nav.ekf import _strapdown

        return max(self.max_gap_s, _strapdown.HOLD_S)

    def rate_b(self, state: InertialState, unheard_b: Array) -> Array:
        """Angular rate of the body against the Earth at a state's time, shape (3,), rad/s; while no
        reading is held that which others tell."""
        k = int(np.searchsorted(self.t, state.t))
        a, b = max(k - 1, 0), min(k, len(self.t) - 1)
        span_s = self.t[b] - self.t[a]
        if max(span_s, self.t[0] - state.t, state.t - self.t[-1]) > self._longest_s:
            return unheard_b
        share = (state.t - self.t[a]) / span_s if span_s > 0 else 0.0
        rate_b = self.gyro_b[a] + min(share, 1.0) * (self.gyro_b[b] - self.gyro_b[a])
        rate_b = rate_b - state.gyro_bias_b
        if self.level is None:
            return np.asarray(rate_b)
        return np.asarray(rate_b - state.body.R_nb.T @ self.level.earth_rate_n)

    def gravity_n(self, p_n: Array) -> Array:
        """Gravity at a place along the axes of the mission's NED, shape (3,), m/s^2."""
        if self.level is None:
            return np.array([0.0, 0.0, STANDARD_GRAVITY_M_S2])
        return self.level.gravity_n(p_n)


def _growth(imu: Sensor, noise: ImuNoise) -> Array:
    """What the variances of the errors grow by in a second, shape (3, 15).

    While the IMU measures, by its noise. While it is silent, by what the vehicle does on this
    mission: over the first second, as one second's readings differ from the last one's; after
    that, as a manoeuvre of the usual strength adds up. Tilt does not wander as heading does: a
    minute makes it as uncertain as if it had never been measured.
    """
    measured = np.zeros(SIZE)
    measured[THETA] = noise.gyro_noise_density_rad_s_sqrt_hz**2
    measured[NU] = noise.accel_noise_density_m_s2_sqrt_hz**2
    measured[GYRO_BIAS] = noise.gyro_bias_walk_rad_s2_sqrt_hz**2
    measured[ACCEL_BIAS] = noise.accel_bias_walk_m_s3_sqrt_hz**2
    growth = np.tile(measured, (3, 1))
    growth[1:, :2] = UNMEASURED_TILT_SIGMA_RAD**2 / 60.0
    spells = spells_of(imu)
    if len(spells.t) > 1:
        growth[1, 2] = np.mean(np.diff(spells.rate_b[:, 2]) ** 2)
        growth[1, NU] = np.mean(np.diff(spells.force_b, axis=0) ** 2, axis=0)
        growth[2, 2] = 2 * MANOEUVRE_S * np.mean(spells.rate_b[:, 2] ** 2)
        growth[2, NU] = 2 * MANOEUVRE_S * np.var(spells.force_b, axis=0)
    return np.maximum(growth, measured)
