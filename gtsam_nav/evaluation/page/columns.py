"""Long columns of numbers for the page: quantised, as differences, deflated, in base64."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gtsam_nav.frames import Array

Document = dict[str, Any]

TIME_S, PLACE_M, ANGLE_DEG = 1e-3, 5e-3, 0.02
"""Steps to which times, places and angles are rounded: finer than what a screen can show."""


def packed(values: ArrayLike, step: float = 1.0) -> Document:
    """A column as multiples of a step, rounded.

    Neighbours are close: their differences as 32-bit integers hold little, and deflate well. The
    page's ``unpacked`` is the inverse.

    Parameters
    ----------
    values : array_like, shape (k,)
        Finite, and less than two thousand million steps from zero.
    step : float

    Raises
    ------
    ValueError
        Where neighbours are too many steps apart.
    """
    multiples = np.round(np.asarray(values, dtype=float) / step).astype(np.int64)
    differences = np.diff(multiples, prepend=0)
    if np.any(np.abs(differences) >= 2**31):
        raise ValueError(f"values are more than two thousand million steps of {step:g} apart")
    return {"step": step, "deflated": _deflated(differences.astype("<i4").tobytes())}


def packed_bytes(values: NDArray[np.uint8]) -> Document:
    """Bytes as they are, deflated."""
    return {"bytes": _deflated(np.ascontiguousarray(values).tobytes())}


def packed_path(t: Array, p_n: Array) -> Document:
    """Times, north and east of points."""
    return {
        "t": packed(t, TIME_S),
        "n": packed(p_n[:, 0], PLACE_M),
        "e": packed(p_n[:, 1], PLACE_M),
    }


def every_nth(n_samples: int, most: int) -> slice:
    """Thins to no more than so many samples, the first among them."""
    return slice(None, None, max(1, -(-n_samples // most)))


def figure(value: float, digits: int) -> float | None:
    """A single number for the page; None for what is not known."""
    return round(float(value), digits) if np.isfinite(value) else None


def _deflated(content: bytes) -> str:
    return base64.b64encode(zlib.compress(content)).decode("ascii")
