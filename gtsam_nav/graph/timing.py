"""Constant timing errors of the sensors: what they do to the residuals.

A reading stamped t belongs to ``t + offset``: it is compared with the vehicle as it is so much
later. A residual's derivative in the offset is therefore its Jacobian in the keyframe times the
keyframe's own rate of change, ``(omega_b, R_nb' v_n, R_nb' a_n)`` in a NavState's tangent space.
Keyframes that an IMU ties keep its time: its own offset is that of all other sensors, backwards.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.graph.factors import X, parts
from gtsam_nav.graph.keys import letter_of
from gtsam_nav.graph.measurements import constraints
from gtsam_nav.graph.measurements.gnss import VELOCITY_OUTLIER
from gtsam_nav.graph.problem import Problem, TimingEffect
from gtsam_nav.graph.readings import Reading
from gtsam_nav.graph.sensor_posterior import keyframe_of, tangent_width
from gtsam_nav.mission import Mission
from gtsam_nav.sensors.noise import GnssNoise
from gtsam_nav.sonar.preparation import scans_at_once

TIMELESS = ("imu", "start", constraints.NAME)
"""Factors that no other sensor's time enters."""
LABELLED = {"attitude": "attitude", "dvl": "velocity", "odometry": "velocity"}
"""How factors are called whose type has one sensor taken; all others bear their sensor's name."""

Used = tuple[tuple[Reading, Any], ...]
"""Readings in use with their factors, as they follow the problem's own in the solution's graph."""


@dataclass(frozen=True)
class TimingError:
    """A sensor's stamps, or the lag of a receiver's velocities, that are off by a constant.

    Attributes
    ----------
    sensor, sensor_type : str
    quantity : {"time_offset", "velocity_lag"}
    sigma_s : float
        Spread of the error beforehand.
    """

    sensor: str
    sensor_type: str
    quantity: Literal["time_offset", "velocity_lag"]
    sigma_s: float

    @property
    def name(self) -> str:
        """With its unit, as for `SlowStates`."""
        return f"{self.sensor}_{self.quantity}_s"

    def corrected(self, mission: Mission, by_s: float) -> Mission:
        """The mission with so much added to the offset (or the lag)."""
        sensor = mission.sensors[self.sensor]
        if self.quantity == "time_offset":
            return mission.with_sensor(replace(sensor, series=sensor.series.shift(by_s)))
        lag_s = GnssNoise.model_validate(sensor.noise).velocity_lag_s + by_s
        return mission.with_sensor(replace(sensor, noise={**sensor.noise, "velocity_lag_s": lag_s}))

    def shares(self, problem: Problem, sensor: str, reason: str) -> tuple[int, int]:
        """How a measurement moves against the keyframes as this error grows, 1 being ahead.

        Once in yaw and once in all else: an orientation is put together of two sensors.

        Parameters
        ----------
        sensor, reason : str
            Of a factor or reading of the problem.
        """
        if self.quantity == "velocity_lag":
            ahead = -int(sensor == self.sensor and reason == VELOCITY_OUTLIER)
            return ahead, ahead
        if self.sensor_type == "imu":
            ahead = -int(problem.uses_imu and sensor not in TIMELESS)
            return ahead, ahead
        if self.sensor_type in ("heading", "attitude") and sensor == "heading":
            return int(self.sensor_type == "heading"), int(self.sensor_type == "attitude")
        own = int(sensor == LABELLED.get(self.sensor_type, self.sensor))
        return own, own


def timing_errors(mission: Mission) -> tuple[TimingError, ...]:
    """Those that the mission asks to estimate, sensor by sensor, with samples or without."""
    found = []
    for name, sensor in mission.sensors.items():
        # what is scanned at once finds its own (`scan_calibration`)
        if sensor.time_offset_sigma_s > 0 and not (
            sensor.type == "scans" and scans_at_once(mission)
        ):
            sigma_s = sensor.time_offset_sigma_s
            found.append(TimingError(name, sensor.type, "time_offset", sigma_s))
        if sensor.type == "gnss" and getattr(sensor.series, "v_n", None) is not None:
            sigma_s = GnssNoise.model_validate(sensor.noise).velocity_lag_sigma_s
            if sigma_s > 0:
                found.append(TimingError(name, sensor.type, "velocity_lag", sigma_s))
    return tuple(found)


def timing_effect(
    problem: Problem,
    errors: tuple[TimingError, ...],
    corrected_s: Array,
    used: Used,
    values: Any,
) -> TimingEffect:
    """Derivative of a problem's whitened residuals in its timing errors.

    Parameters
    ----------
    problem : Problem
        Of a mission with what was found of the errors, ``corrected_s``, applied.
    used : tuple of (Reading, factor)
    values : gtsam.Values
        Where the graph is linearised.
    """
    course = _Course.of(problem, values)

    @cache
    def shares_of(sensor: str, reason: str) -> Array:
        return np.array([error.shares(problem, sensor, reason) for error in errors]).T

    effect = []
    for sensor, reason, t, factor in _measurements(problem, used):
        shares = shares_of(sensor, reason)
        if shares.any():
            effect.append(course.slopes(factor, t, values) @ shares)
        else:
            effect.append(np.zeros((factor.dim(), len(errors))))
    return TimingEffect(
        names=tuple(error.name for error in errors),
        sigma_s=np.array([error.sigma_s for error in errors]),
        corrected_s=corrected_s,
        effect=np.concatenate(effect),
    )


def _measurements(problem: Problem, used: Used) -> Iterator[tuple[str, str, float | None, Any]]:
    """Sensor, reason, own time (None: the keyframes') and factor of all that is in the graph."""
    for entry in problem.entries:
        yield entry.sensor, "", None, entry.factor
    for reading, factor in used:
        yield reading.sensor, reading.reason, reading.t, factor


@dataclass(frozen=True)
class _Course:
    """Attitude, angular rate (rad/s), velocity and acceleration at the keyframes."""

    t: Array
    R_nb: Array
    omega_b: Array
    v_n: Array
    a_n: Array

    @classmethod
    def of(cls, problem: Problem, values: Any) -> _Course:
        """Of the keyframes' values; rates are their central differences."""
        from scipy.spatial.transform import Rotation

        t = problem.t
        R_nb, _, v_n = parts(values.atNavState(X(k)) for k in range(len(t)))
        a, b = (
            np.clip(np.arange(len(t)) - 1, 0, None),
            np.clip(np.arange(len(t)) + 1, None, len(t) - 1),
        )
        span_s = np.maximum(t[b] - t[a], 1e-9)[:, None]
        turned_b = Rotation.from_matrix(np.swapaxes(R_nb[a], 1, 2) @ R_nb[b]).as_rotvec()
        return cls(t, R_nb, turned_b / span_s, v_n, (v_n[b] - v_n[a]) / span_s)

    def slopes(self, factor: Any, t: float | None, values: Any) -> Array:
        """How a factor's whitened, weighted residual changes as the vehicle moves on, (dim, 2).

        By its change of yaw, and by all else.
        """
        linear = factor.linearize(values)
        A, b = linear.jacobian()
        slopes, first = np.zeros((len(b), 2)), 0
        for key in list(linear.keys()):
            width = tangent_width(key)
            if letter_of(key) == "x":
                slopes += A[:, first : first + width] @ self._rates(keyframe_of(key), t)
            first += width
        return slopes

    def _rates(self, k: int, t: float | None) -> Array:
        """A keyframe's rate of change in its tangent space, (9, 2), as it is at a time beside it.

        Its change of yaw, and all else.
        """
        R_bn = self.R_nb[k].T
        omega_b, v_n, a_n = self.omega_b[k], self.v_n[k], self.a_n[k]
        if t is not None:
            a = min(max(int(np.searchsorted(self.t, t)) - 1, 0), len(self.t) - 2)
            f = min(max((t - self.t[a]) / (self.t[a + 1] - self.t[a]), 0.0), 1.0)
            omega_b, v_n, a_n = (
                (1.0 - f) * of[a] + f * of[a + 1] for of in (self.omega_b, self.v_n, self.a_n)
            )
        down_b = R_bn[:, 2]
        level2 = float(down_b[1:] @ down_b[1:])
        yaw_b = down_b * float(down_b[1:] @ omega_b[1:]) / level2
        rates = np.zeros((9, 2))
        rates[:3, 0] = yaw_b
        rates[:, 1] = np.concatenate([omega_b - yaw_b, R_bn @ v_n, R_bn @ a_n])
        return rates
