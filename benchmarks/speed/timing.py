"""How often, and with what: medians of several runs, and runs in a process of their own."""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ProcessTime:
    """Medians of some processes, s; on a busy machine the processor's time says more."""

    wall_s: float
    cpu_s: float


def process_time(arguments: Sequence[str], repeats: int) -> ProcessTime:
    """Time of a Python process with these arguments."""
    command = [sys.executable, *arguments]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}

    def run() -> tuple[float, float]:
        begin, cpu = time.perf_counter(), _children_cpu_s()
        subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)
        return time.perf_counter() - begin, _children_cpu_s() - cpu

    wall, cpu = zip(*(run() for _ in range(repeats)), strict=True)
    return ProcessTime(statistics.median(wall), statistics.median(cpu))


def _children_cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def in_process(module: str, *arguments: str) -> Any:
    """The JSON that a module prints, run in a process of its own: its memory is nobody else's."""
    command = [sys.executable, "-m", module, *arguments]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run(command, check=True, env=environment, capture_output=True, text=True)
    return json.loads(done.stdout)
