"""What the C library does with freed memory: kept for the next large array, or given back."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
"""Options of glibc's malloc: free bytes on top of the heap beyond which they are returned, and the
size from which a piece is mapped on its own."""
KEPT_BYTES = 2**30


@cache
def _glibc(name: str) -> Any:
    # glibc's own; other C libraries give memory back by themselves, or not at all
    return getattr(ctypes.CDLL(None), name, None)


@cache
def keep_large() -> None:
    """Have freed arrays of up to a gigabyte stay with the process, from now on.

    Beyond 32 MB the C library would map each anew, of pages that the kernel has to clear: on a
    mission of many hours that takes a third as long as the factorisation itself.
    """
    set_option = _glibc("mallopt")
    if set_option is not None:
        set_option(M_MMAP_THRESHOLD, KEPT_BYTES)
        set_option(M_TRIM_THRESHOLD, KEPT_BYTES)


def give_back() -> None:
    """Return the heap's free pages to the system.

    iSAM2 and the solves free millions of small pieces, which the C library keeps: on a mission of
    an hour a third of the process, that no large array can use.
    """
    trim = _glibc("malloc_trim")
    if trim is not None:
        trim(0)
