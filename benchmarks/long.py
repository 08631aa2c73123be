"""The checks that take hours, one after the other: ``./scripts/test --long``.

Each has a small twin among the ordinary tests: consistency in ``tests/evaluation`` and
``tests/graph``, fuzzing in ``tests/readers/test_hostile_files.py``, mutants and the matrix of
versions in ``tests/benchmarks``.
"""

from __future__ import annotations

import subprocess
import sys
import time
from importlib.util import find_spec

CHECKS: dict[str, tuple[str, ...]] = {
    "benchmarks.consistency": (),
    "benchmarks.fuzz": ("--cases", "100000"),
    "benchmarks.mutation": (),
    "benchmarks.versions": (),
}
"""Module to its arguments."""


def main() -> None:
    """Run every check, and say at the end which failed."""
    outcomes = []
    for module, arguments in CHECKS.items():
        if find_spec(module) is None:
            outcomes.append((module, "is not here", 0.0))
            continue
        print(f"\n{module} {' '.join(arguments)}", flush=True)
        begin = time.perf_counter()
        code = subprocess.run([sys.executable, "-m", module, *arguments], check=False).returncode
        result = "passed" if code == 0 else f"failed with exit code {code}"
        outcomes.append((module, result, time.perf_counter() - begin))
    print()
    for module, result, seconds in outcomes:
        print(f"{module:26}{seconds:8.0f} s  {result}")
    sys.exit(any(result.startswith("failed") for _, result, _ in outcomes))


if __name__ == "__main__":
    main()
