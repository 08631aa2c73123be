"""Two signals side by side in windows of a mission: the sums of products that tell their lag."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from gtsam_nav.frames import Array
from gtsam_nav.series import BoolArray

WINDOWS_S = (10.0, 30.0, 60.0)
"""Within so long neither sensor is taken to drift away from a straight line: slow errors call for
the shorter, slow vehicles for the longer."""
FEWEST_WINDOWS, FEWEST_IN_WINDOW = 6, 8
MOST_WINDOWS = 500
"""Of a long mission some will do."""
GAP_STEPS, GAP_SHARE = 10.0, 0.1
"""A silence of more steps, and of a larger share of the window, is not interpolated over."""


@dataclass(frozen=True)
class Signal:
    """Times (n,), s, and values (n,) of what a sensor measures."""

    t: Array
    values: Array


def integrated(t: Array, rate: Array) -> Signal:
    """The integral of a rate by the trapezoidal rule."""
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(t)
    return Signal(t, np.concatenate([[0.0], np.cumsum(steps)]))


def lagged_products(y: Signal, x: Signal, step_s: float, n_lags: int) -> Iterator[Array]:
    """Of each length of windows that are enough, their products, shape (windows, 3, lags)."""
    grid = np.arange(max(y.t[0], x.t[0]) + step_s, min(y.t[-1], x.t[-1]) - step_s, step_s)
    if len(grid) < FEWEST_WINDOWS * FEWEST_IN_WINDOW:
        return
    means_y, means_x = (_means(s, grid, step_s) for s in (y, x))
    silence_y_s, silence_x_s = (_silence_s(s.t, grid) for s in (y, x))
    for window_s in WINDOWS_S:
        length = max(round(window_s / step_s), 2)
        bearable_s = max(GAP_STEPS * step_s, GAP_SHARE * window_s)
        known_y, known_x = silence_y_s < bearable_s, silence_x_s < bearable_s
        begins = _begins(known_y, known_x, length, n_lags)
        products = np.array(list(_products(means_y, means_x, begins, length, n_lags)))
        if len(products) >= FEWEST_WINDOWS and length >= FEWEST_IN_WINDOW:
            yield products


def _means(signal: Signal, grid: Array, step_s: float) -> Array:
    """Means of a signal over steps about the grid, the same smoothing for any rate."""
    area = integrated(signal.t, signal.values - signal.values[0])
    ends = (np.interp(grid + side * step_s, area.t, area.values) for side in (0.5, -0.5))
    return np.asarray((next(ends) - next(ends)) / step_s)


def _silence_s(t: Array, grid: Array) -> Array:
    """Length of the interval between samples that each of the grid's times lies in."""
    after = np.clip(np.searchsorted(t, grid), 1, len(t) - 1)
    return np.asarray(t[after] - t[after - 1])


def _begins(known_y: BoolArray, known_x: BoolArray, length: int, n_lags: int) -> list[int]:
    """Where windows of y begin that hold no silence, nor does x as far as the lags reach."""
    begins = np.arange(n_lags, len(known_y) - length - n_lags + 1, length)
    return [
        int(begin)
        for begin in begins[:: max(1, -(-len(begins) // MOST_WINDOWS))]
        if np.all(known_y[begin : begin + length])
        and np.all(known_x[begin - n_lags : begin + length + n_lags])
    ]


def _products(
    y: Array, x: Array, begins: Iterable[int], length: int, n_lags: int
) -> Iterator[Array]:
    """Of each window, at each lag: the sums of x y, x x and y y, shape (3, lags)."""
    one = np.full(length, length**-0.5)
    ramp = np.arange(length) - 0.5 * (length - 1)
    ramp = ramp / np.linalg.norm(ramp)
    for begin in begins:
        reach = slice(begin - n_lags, begin + length + n_lags)
        wanted, seen = y[begin : begin + length], x[reach] - np.mean(x[reach])
        wanted = wanted - np.mean(wanted)
        wanted = wanted - (wanted @ ramp) * ramp
        line = [np.correlate(seen, part) ** 2 for part in (one, ramp)]
        xx = np.correlate(seen**2, np.ones(length)) - line[0] - line[1]
        yy = np.full(len(xx), wanted @ wanted)
        yield np.array([np.correlate(seen, wanted), np.maximum(xx, 0.0), yy])
