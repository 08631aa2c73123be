"""One sighting of a landmark as a native factor, made anew at each estimate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtsam_nav.frames import Array, skew
from gtsam_nav.graph import sighting_factors
from gtsam_nav.graph.factors import X
from gtsam_nav.graph.problem import StateAt
from gtsam_nav.mission import Sensor
from gtsam_nav.sensors.landmarks import NO_DIRECTION_M, Sighting


@dataclass(frozen=True)
class Seen:
    """One sighting at keyframe k of the landmark with this key.

    Attributes
    ----------
    sensor : Sensor
        As if mounted on that keyframe's body.
    level : bool
        The landmark is taken to lie level with the sensor.
    planar : bool
        The body stays upright, at one depth.
    excess : float
        By how much its variance grows because earlier sightings share its error.
    scale_key : int or None
        Of the share by which the sensor's ranges are too long, where that is a state.
    """

    k: int
    key: int
    values: Sighting
    sensor: Sensor
    level: bool
    planar: bool = False
    excess: float = 1.0
    scale_key: int | None = None

    def make(self, state_at: StateAt) -> Any:
        """The native factor, linear about the present estimate.

        As `sensors.landmarks.predict` has it: thousands of sightings are made anew many times.
        """
        body, landmark = state_at(X(self.k)), state_at(self.key)
        R_nb = body.attitude().matrix()
        offset_b = R_nb.T @ (landmark.position() - body.position())
        counted_b = offset_b - self.sensor.xyz_b
        if self.level:
            counted_b = counted_b - R_nb[2] * (R_nb[2] @ counted_b)
        values, by_point = _polar(self.sensor.R_bs.T @ counted_b, self.values.elevation is not None)
        by_scale: Array = np.zeros(len(values))
        scale = None if self.scale_key is None else state_at(self.scale_key)
        if scale is not None:
            by_scale[0] = values[0]
            values[0] += scale.position()[0] * values[0]
            by_point[0] += scale.position()[0] * by_point[0]
        by_offset = by_point_b = by_point @ self.sensor.R_bs.T
        if self.level:
            by_offset = by_offset - np.outer(by_offset @ R_nb[2], R_nb[2])
        residual = values - self.values.polar
        residual[1:] = (residual[1:] + np.pi) % (2 * np.pi) - np.pi
        residual[~np.any(by_point, axis=1)] = 0.0
        rows, sigma = self.values.rows, math.sqrt(self.excess) * self.values.sigma
        if scale is None and (self.planar or not self.level):
            return sighting_factors.sighting(
                X(self.k), self.key, offset_b, by_offset[rows], residual[rows], sigma
            )
        by_turn = by_point_b @ skew(counted_b) + by_offset @ skew(self.sensor.xyz_b)
        slopes = sighting_factors.SightingSlopes(by_offset[rows], by_turn[rows])
        if scale is None:
            return sighting_factors.level_sighting(
                X(self.k), self.key, (body, landmark), slopes, residual[rows], sigma
            )
        keys, states = (X(self.k), self.key, self.scale_key), (body, landmark, scale)
        return sighting_factors.scaled_sighting(
            keys, states, slopes, by_scale[rows], residual[rows], sigma
        )


def _polar(p_s: Array, elevation: bool) -> tuple[Array, Array]:
    """Range, bearing[, elevation] of a point in sensor axes, and their Jacobian (m, 3)."""
    x, y, z = p_s.tolist()
    level, distance = math.hypot(x, y), math.hypot(x, y, z)
    values, jacobian = np.zeros(3), np.zeros((3, 3))
    values[:] = distance, math.atan2(y, x), math.atan2(-z, level)
    if distance > NO_DIRECTION_M:
        jacobian[0] = x / distance, y / distance, z / distance
    if level > NO_DIRECTION_M:
        jacobian[1, :2] = -y / level**2, x / level**2
        jacobian[2] = x * z / level, y * z / level, -level
        jacobian[2] /= distance**2
    m = 3 if elevation else 2
    return values[:m], jacobian[:m]
