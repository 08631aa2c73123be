"""Kernel that turns lines of sonar beams into arrays; a byte is looked at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

NEWLINE, CARRIAGE_RETURN, COMMENT = 10, 13, 37
ZERO, NINE, MINUS, PLUS, POINT = 48, 57, 45, 43, 46
# powers of ten up to 1e22 are exact, so that a quotient by one is correctly rounded
POWERS_OF_TEN = 10.0 ** np.arange(23)


@njit(cache=True)
def _is_gap(byte: int) -> bool:
    return byte == 32 or byte == 9 or byte == 44 or byte == CARRIAGE_RETURN


@njit(cache=True)
def _decimal(text: NDArray[np.uint8], start: int, stop: int) -> float:
    """A plain decimal number; infinity where it is none, NaN where it says nan or inf."""
    k = start
    negative = text[k] == MINUS
    if negative or text[k] == PLUS:
        k += 1
    if k < stop and (text[k] | 32) in (110, 105):  # n, i
        return np.nan
    mantissa, digits, decimals, pointed = 0, 0, 0, False
    while k < stop:
        byte = text[k]
        if ZERO <= byte <= NINE:
            mantissa = mantissa * 10 + (byte - ZERO)
            digits += 1
            decimals += pointed
        elif byte == POINT and not pointed:
            pointed = True
        else:
            return np.inf
        k += 1
    if digits == 0 or digits > 18:
        return np.inf
    value: float = mantissa / POWERS_OF_TEN[decimals]
    return -value if negative else value


@njit(cache=True)
def parse_beams(
    text: NDArray[np.uint8],
    stamps: NDArray[np.float64],
    angles: NDArray[np.float64],
    intensity: NDArray[np.uint8],
    too_strong: NDArray[np.bool_],
) -> Any:
    """Parse whole lines of stamp, sensor time, head angle and bins.

    Parameters
    ----------
    text : ndarray of uint8
        Whole lines; what starts with % is a comment.
    stamps, angles : ndarray, shape (n,)
        Filled: s and rad.
    intensity : ndarray of uint8, shape (n, bins)
        Filled.
    too_strong : ndarray of bool, shape (n,)
        Filled: beams with a bin above 255.

    Returns
    -------
    n_beams : int
        Beams that were parsed.
    fault : int
        Offset of the line at which parsing stopped, -1 where all lines were good.
    """
    n_bins = intensity.shape[1]
    size = text.size
    k, row = 0, 0
    while k < size:
        line = k
        while k < size and _is_gap(text[k]):
            k += 1
        if k == size or text[k] == NEWLINE or text[k] == COMMENT:
            while k < size and text[k] != NEWLINE:
                k += 1
            k += 1
            continue
        if row == stamps.size:
            return row, line
        field = 0
        too_strong[row] = False
        while k < size and text[k] != NEWLINE:
            start = k
            if field < 3:
                while k < size and text[k] != NEWLINE and not _is_gap(text[k]):
                    k += 1
                value = _decimal(text, start, k)
                if value == np.inf:
                    return row, line
                if field == 0:
                    stamps[row] = value
                elif field == 2:
                    angles[row] = value
            else:
                echo = 0
                while k < size and text[k] != NEWLINE and not _is_gap(text[k]):
                    digit = text[k] - ZERO
                    if digit < 0 or digit > 9 or k - start > 8:
                        return row, line
                    echo = echo * 10 + digit
                    k += 1
                if field - 3 >= n_bins:
                    return row, line
                if echo > 255:
                    too_strong[row] = True
                else:
                    intensity[row, field - 3] = echo
            field += 1
            while k < size and _is_gap(text[k]):
                k += 1
        if field != n_bins + 3:
            return row, line
        row += 1
        k += 1
    return row, -1
