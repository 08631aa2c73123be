"""The checks that take hours, one after the other: ``./scripts/test --long``.

Each has a small twin among the ordinary tests: consistency in ``tests/evaluation`` and
``tests/graph``, fuzzing in ``tests/readers/test_hostile_files.py``, mutants and the matrix of
versions in ``tests/benchmarks``. ``./scripts/test --long --quick`` runs each check itself in
minutes, on so little that it only says whether the check works.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

THIS_PYTHON = f"{sys.version_info.major}.{sys.version_info.minor}"


@dataclass(frozen=True)
class Check:
    """A module of ``benchmarks``, and what it is told: for the whole check, and for a quick one."""

    module: str
    whole: tuple[str, ...]
    quick: tuple[str, ...]


CHECKS = (
    # of what is only measured: two runs keep no promise
    Check("consistency", (), ("--runs", "2", "--case", "scan-match, matched")),
    Check("fuzz", ("--cases", "100000"), ("--cases", "500")),
    Check("mutation", ("--sample", "100"), ("--sample", "3", "--target", "0")),
    Check("versions", (), ("--python", THIS_PYTHON, "--bounds", "newest")),
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run every check, and say at the end which failed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.long", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="each check on next to nothing")
    quick = parser.parse_args(arguments).quick
    outcomes = []
    for check in CHECKS:
        command = ["-m", f"benchmarks.{check.module}", *(check.quick if quick else check.whole)]
        print(f"\n{' '.join(command[1:])}", flush=True)
        begin = time.perf_counter()
        code = subprocess.run([sys.executable, *command], check=False).returncode
        outcomes.append((check.module, code, time.perf_counter() - begin))
    print()
    for module, code, seconds in outcomes:
        print(
            f"{module:14}{seconds:8.0f} s  {f'failed with exit code {code}' if code else 'passed'}"
        )
    sys.exit(any(code for _, code, _ in outcomes))


if __name__ == "__main__":
    main()
