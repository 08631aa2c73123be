"""Freed memory is there for the next large array, and goes back to the system when asked."""

import os
import subprocess
import sys
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


IN_A_FRESH_PROCESS = """
import resource
import numpy as np
from test_heap import resident_kb
from gtsam_nav.graph.heap import give_back, keep_large

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    np.full(8_000_000, 1.0)  # 64 MB, which the C library would map each time
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

keep_large()
print(faults(), faults(), resident_kb())
give_back()
print(resident_kb())
"""
"""Where the heap ends, and so what of it can be returned, depends on all that a process did."""


def test_a_large_array_takes_the_pages_of_the_one_before() -> None:
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([*sys.path, str(Path(__file__).parent)])
    }
    told = subprocess.run(
        [sys.executable, "-c", IN_A_FRESH_PROCESS], env=environment, capture_output=True, check=True
    ).stdout.split()
    first, second, full_kb, left_kb = map(int, told)
    assert second < 0.1 * first
    assert left_kb < full_kb - 50_000
