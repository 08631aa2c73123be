"""What a GTSAM key holds: a letter for the kind of variable, and an index."""

from __future__ import annotations

INDEX_BITS = 56
"""The letter stands above them."""


def letter_of(key: int) -> str:
    """Letter of the kind of variable: B, G, L, M, S or X of `factors`, in lower case."""
    return chr(key >> INDEX_BITS)


def index_of(key: int) -> int:
    """Number among its kind."""
    return key & ((1 << INDEX_BITS) - 1)
