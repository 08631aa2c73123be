"""What the C++ side has freed, given back to the system."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any


@cache
def _malloc_trim() -> Any:
    # glibc's own; other C libraries give memory back by themselves, or not at all
    return getattr(ctypes.CDLL(None), "malloc_trim", None)


def give_back() -> None:
    """Return the heap's free pages to the system.

    iSAM2 and the solves free millions of small pieces, which the C library keeps: on a mission of
    an hour a third of the process, that no large array can use.
    """
    trim = _malloc_trim()
    if trim is not None:
        trim(0)
