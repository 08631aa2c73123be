"""Sightings of landmarks as native factors, made anew at each estimate: all of a sensor's at once.

As `sensors.landmarks.predict` has them, in arrays: thousands are made many times.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from gtsam_nav.frames import Array, skew
from gtsam_nav.graph import sighting_factors
from gtsam_nav.graph.factors import X, parts
from gtsam_nav.graph.readings import StateAt
from gtsam_nav.graph.sighting_factors import SightingSlopes
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

    @property
    def leans(self) -> bool:
        """Whether a tilt of the body counts beside the landmark's offset from it.

        No turn changes a range but by the instrument's arm; in body axes one seems to, in second
        order, and far beacons would tell a tilt that nothing measures.
        """
        is_range = self.values.bearing is None
        return self.scale_key is not None or is_range or (self.level and not self.planar)


@dataclass(frozen=True)
class _Expected:
    """What is expected of n sightings at an estimate.

    Attributes
    ----------
    offset_b, counted_b : ndarray, shape (n, 3)
        Of the landmarks from the body; and what of it the sensor sees, from its arm on.
    residual, by_scale : ndarray, shape (n, 3)
        Of range, bearing and elevation, zero where not measured; and its derivative in the scale.
    by_offset, by_point : ndarray, shape (n, 3, 3)
        Its derivatives in the landmark's offset, along body axes; and before level ones lose depth.
    """

    offset_b: Array
    counted_b: Array
    residual: Array
    by_scale: Array
    by_offset: Array
    by_point: Array


@dataclass(frozen=True)
class SightingFactors:
    """The native factors of a sensor's sightings, linear about the present estimate."""

    seen: list[Seen] = field(default_factory=list)

    def __call__(self, rows: Sequence[int], state_at: StateAt) -> list[Any]:
        """Those of some sightings."""
        index = np.asarray(rows)
        some = [self.seen[i] for i in rows]
        bodies = [state_at(X(own.k)) for own in some]
        landmarks = [state_at(own.key) for own in some]
        scale = self._scale(state_at)
        (R_nb, body_n, _), (_, landmark_n, _) = parts(bodies), parts(landmarks)
        share = 0.0 if scale is None else float(scale.position()[0])
        at = self._expected(index, R_nb, landmark_n - body_n, share)
        sigma = self._arrays["sigma"][index]
        plain = sighting_factors.step_back(at.offset_b, at.by_offset, at.residual)
        roots = sighting_factors.offset_roots(at.by_offset, sigma)
        made = []
        for i, own in enumerate(some):
            if own.leans:
                states = (bodies[i], landmarks[i], scale)
                made.append(self._leaning(own, states, at, i, sigma[i]))
            else:
                made.append(sighting_factors.sighting(X(own.k), own.key, plain[i], roots[i]))
        return made

    def _scale(self, state_at: StateAt) -> Any:
        """The state of the ranges' scale; None where it is known: the same of all sightings."""
        key = self.seen[0].scale_key
        return None if key is None else state_at(key)

    @cached_property
    def _arrays(self) -> dict[str, Array]:
        """What was measured, by which sensor: range, bearing, elevation, NaN where not."""
        of = [own.values for own in self.seen]
        polar = np.array([(s.range_m, s.bearing, s.elevation) for s in of], dtype=float)
        sigma = np.array([(s.sigma_range, s.sigma_bearing, s.sigma_bearing) for s in of])
        sigma *= np.sqrt([own.excess for own in self.seen])[:, None]
        return {
            "polar": polar,
            "sigma": np.where(np.isnan(polar), 1.0, sigma),
            "R_bs": np.array([own.sensor.R_bs for own in self.seen]),
            "xyz_b": np.array([own.sensor.xyz_b for own in self.seen]),
            "level": np.array([own.level for own in self.seen], dtype=float)[:, None],
            "absent": np.isnan(polar),
        }

    def _expected(self, index: Any, R_nb: Array, apart_n: Array, scale: float) -> _Expected:
        """Residuals and slopes of some sightings; ``apart_n`` are the landmarks less the bodies."""
        R_bs, xyz_b, polar, level = (
            self._arrays[name][index] for name in ("R_bs", "xyz_b", "polar", "level")
        )
        absent, down_b = self._arrays["absent"][index], R_nb[:, 2]
        offset_b = (apart_n[:, None] @ R_nb)[:, 0]
        counted_b = offset_b - xyz_b
        deep = level * (counted_b[:, None] @ down_b[:, :, None])[:, 0]
        counted_b -= deep * down_b
        values, by_point = _polar((counted_b[:, None] @ R_bs)[:, 0])
        by_scale = np.zeros_like(values)
        by_scale[:, 0] = values[:, 0]
        values[:, 0] *= 1.0 + scale
        by_point[:, 0] *= 1.0 + scale
        residual = values - polar
        residual[:, 1:] = (residual[:, 1:] + np.pi) % (2 * np.pi) - np.pi
        by_point[absent] = by_scale[absent] = 0.0
        residual[~by_point.any(axis=2)] = 0.0
        by_point = by_point @ R_bs.transpose(0, 2, 1)
        along_down = by_point @ down_b[:, :, None] * level[:, None]
        by_offset = by_point - along_down * down_b[:, None]
        return _Expected(offset_b, counted_b, residual, by_scale, by_offset, by_point)

    def _leaning(
        self, own: Seen, states: tuple[Any, Any, Any], at: _Expected, i: int, sigma: Array
    ) -> Any:
        """A sighting on which the body's tilt tells."""
        rows = own.values.rows
        by_turn = at.by_point[i] @ skew(at.counted_b[i]) + at.by_offset[i] @ skew(own.sensor.xyz_b)
        slopes = SightingSlopes(at.by_offset[i][rows], by_turn[rows])
        residual, sigma = at.residual[i][rows], sigma[rows]
        if own.scale_key is None:
            return sighting_factors.leaning_sighting(
                X(own.k), own.key, states[:2], slopes, residual, sigma
            )
        keys = (X(own.k), own.key, own.scale_key)
        by_scale = at.by_scale[i][rows]
        return sighting_factors.scaled_sighting(keys, states, slopes, by_scale, residual, sigma)


def _polar(p_s: Array) -> tuple[Array, Array]:
    """Range, bearing and elevation of points (n, 3) in sensor axes, and their Jacobian (n, 3, 3).

    It is zero where a point has no direction.
    """
    x, y, z = p_s.T
    level = np.hypot(x, y)
    distance = np.hypot(level, z)
    values, jacobian = np.empty_like(p_s), np.zeros((len(p_s), 3, 3))
    values[:, 0], values[:, 1], values[:, 2] = distance, np.arctan2(y, x), np.arctan2(-z, level)
    far = np.where(distance > NO_DIRECTION_M, distance, np.inf)
    aside = np.where(level > NO_DIRECTION_M, level, np.inf)
    far2, aside2, over = far**2, aside**2, aside * far**2
    jacobian[:, 0] = p_s / far[:, None]
    jacobian[:, 1, 0], jacobian[:, 1, 1] = -y / aside2, x / aside2
    jacobian[:, 2, 0], jacobian[:, 2, 1] = x * z / over, y * z / over
    jacobian[:, 2, 2] = -np.where(level > NO_DIRECTION_M, level, 0.0) / far2
    return values, jacobian
