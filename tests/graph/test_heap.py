"""Freed memory is there for the next large array, and goes back to the system when asked."""

import resource
from pathlib import Path

import numpy as np

from gtsam_nav.graph.heap import give_back, keep_large


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


def test_a_large_array_takes_the_pages_of_the_one_before() -> None:
    keep_large()

    def faults(n: int) -> int:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        np.full(n, 1.0)
        return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

    n = 8_000_000  # 64 MB, which the C library would map each time
    give_back()
    first = faults(n)
    assert faults(n) < 0.1 * first
    full_kb = resident_kb()
    give_back()
    assert resident_kb() < full_kb - 50_000
