"""Compiled search for the strongest peaks of each profile."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from gtsam_nav.frames import Array
from gtsam_nav.series import IntArray


@numba.njit(cache=True)
def strongest_peaks(
    intensity: NDArray[np.uint8],
    threshold: Array,
    first_bin: int,
    last_bin: int,
    separation: int,
    max_peaks: int,
) -> tuple[IntArray, Array, Array]:
    """Strongest local maxima of each profile above a threshold, at least a separation apart.

    Profiles are averaged over three bins, and a peak's position is the centre of gravity of what
    stands above half of it within half the separation: speckle makes the top bin itself jump.

    Returns
    -------
    beam : ndarray of int, shape (k,)
    bin_centre : ndarray, shape (k,)
        Fractional bin of the echo.
    strength : ndarray, shape (k,)
    """
    n = len(intensity)
    beam = np.empty(n * max_peaks, np.int64)
    centre = np.empty(n * max_peaks)
    strength = np.empty(n * max_peaks)
    smooth = np.zeros(intensity.shape[1])
    count = 0
    for i in range(n):
        for k in range(first_bin, last_bin):
            below, above = max(k - 1, 0), min(k + 1, intensity.shape[1] - 1)
            smooth[k] = (
                float(intensity[i, below]) + float(intensity[i, k]) + float(intensity[i, above])
            ) / 3.0
        begin = count
        for _ in range(max_peaks):
            best, best_value = -1, 0.0
            for k in range(first_bin, last_bin):
                if smooth[k] <= best_value or smooth[k] < threshold[k]:
                    continue
                free = True
                for c in range(begin, count):
                    if abs(k - centre[c]) < separation:
                        free = False
                        break
                if free and _is_local_maximum(smooth, k, first_bin, last_bin):
                    best, best_value = k, smooth[k]
            if best < 0:
                break
            beam[count] = i
            centre[count] = _centre_of_gravity(smooth, best, separation, first_bin, last_bin)
            strength[count] = best_value
            count += 1
    return beam[:count], centre[:count], strength[:count]


@numba.njit(cache=True)
def _is_local_maximum(smooth: Array, k: int, first_bin: int, last_bin: int) -> bool:
    left = smooth[k - 1] if k > first_bin else -1.0
    right = smooth[k + 1] if k + 1 < last_bin else -1.0
    return bool(smooth[k] >= left and smooth[k] >= right)


@numba.njit(cache=True)
def _centre_of_gravity(
    smooth: Array, peak: int, separation: int, first_bin: int, last_bin: int
) -> float:
    half = 0.5 * smooth[peak]
    total, moment = 0.0, 0.0
    for direction in (-1, 1):
        k = peak if direction == 1 else peak - 1
        while first_bin <= k < last_bin and abs(k - peak) <= separation // 2 and smooth[k] >= half:
            total += smooth[k]
            moment += smooth[k] * k
            k += direction
    return moment / total
