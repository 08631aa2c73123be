"""Freed memory goes back to the system."""

from pathlib import Path

import numpy as np

from gtsam_nav.graph.heap import give_back


def resident_kb() -> int:
    (line,) = (s for s in Path("/proc/self/status").read_text().splitlines() if "VmRSS" in s)
    return int(line.split()[1])


def test_small_freed_pieces_do_not_stay_with_the_process() -> None:
    # below the size that the C library maps by itself, with one that stays on top of the heap
    pieces = [np.ones(4000) for _ in range(2000)]
    kept = np.ones(4000)
    full_kb = resident_kb()
    pieces.clear()
    give_back()
    assert resident_kb() < full_kb - 40_000
    assert kept.sum() == 4000.0
