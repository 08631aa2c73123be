"""Frames beside the keyframes: NavStates of which only a part means anything, the rest is pinned.

They are a compass's yaw, the error that GNSS fixes share, a landmark's place and a range scale.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import gtsam
import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.graph.factors import KEPT_NOISES, displaced, precisions

PIN_PRECISION = 1e8
"""Holds what means nothing."""
_ZERO = gtsam.NavState()


@lru_cache(maxsize=KEPT_NOISES)
def _yaw_noise(yaw: float, others: float) -> Any:
    """By precisions, as all of these."""
    return precisions([others, others, yaw, *[others] * 6])


@lru_cache(maxsize=KEPT_NOISES)
def _place_noise(place: tuple[float, ...], others: float) -> Any:
    return precisions([*[others] * 3, *place, *[others] * 3])


def compass_prior(key: int, sigma: float) -> Any:
    """A compass frame: all but its yaw pinned to the navigation frame."""
    yaw = 1 / sigma**2 if sigma > 0 else PIN_PRECISION
    return gtsam.PriorFactorNavState(key, _ZERO, _yaw_noise(yaw, PIN_PRECISION))


def compass_link(a: int, b: int, yaw_precision: float) -> Any:
    """Keeps the yaws of two compass frames together."""
    return gtsam.BetweenFactorNavState(a, b, _ZERO, _yaw_noise(yaw_precision, 0.0))


def compass_pin(key: int) -> Any:
    """Pins all but the yaw of a compass frame, which `compass_link` then governs."""
    return gtsam.PriorFactorNavState(key, _ZERO, _yaw_noise(0.0, PIN_PRECISION))


def gnss_error_prior(key: int, precision: Array) -> Any:
    """A shared GNSS error about zero, by its precisions along n, e and d: only the position means
    anything."""
    return gtsam.PriorFactorNavState(
        key, _ZERO, _place_noise(tuple(precision.tolist()), PIN_PRECISION)
    )


def gnss_error_link(a: int, b: int, precision: Array) -> Any:
    """Keeps two shared GNSS errors together."""
    return gtsam.BetweenFactorNavState(a, b, _ZERO, _place_noise(tuple(precision.tolist()), 0.0))


def landmark_prior(key: int, p_n: Array, sigma: Array) -> Any:
    """Where a landmark is known to be: only the position means anything."""
    pins = [PIN_PRECISION] * 3
    noise = precisions([*pins, *(1 / np.asarray(sigma) ** 2), *pins])
    return gtsam.PriorFactorNavState(key, displaced(p_n), noise)


def range_scale_prior(key: int, sigma: float) -> Any:
    """By what share a sensor's ranges are too long: only ``n`` means anything."""
    pins = [PIN_PRECISION] * 5
    noise = precisions([*pins[:3], 1 / sigma**2, *pins])
    return gtsam.PriorFactorNavState(key, _ZERO, noise)
