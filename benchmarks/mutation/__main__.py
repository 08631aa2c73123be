"""``python -m benchmarks.mutation [PACKAGE ...] [--sample N] [--seed N] [--target SHARE]``.

Prints every mutant that survived and a row a package; fails where a package is below the target.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from scipy.stats import binomtest

from benchmarks.mutation.trials import Fate, Mutant, baseline_s, fate, mirroring_tests

PACKAGES = ("sensors", "registration", "sonar", "evaluation")
TARGET = 0.85
"""Least share of the mutants that the tests kill."""
PATIENCE = 3.0
"""A mutant whose tests take so many times as long as without it hangs: it is noticed."""
LEAST_LIMIT_S = 20.0
"""Its kernels are compiled anew."""


@dataclass(frozen=True)
class Outcome:
    """What became of a package's mutants, how many of the killed ones only took too long, and how
    long all that took [s]."""

    package: str
    mutants: int
    survivors: tuple[Mutant, ...]
    hung: int
    wall_s: float

    @property
    def killed(self) -> float:
        """Share of the mutants."""
        return 1.0 - len(self.survivors) / self.mutants

    def interval(self) -> tuple[float, float]:
        """Within which the share among all the mutants lies: 95 %, Wilson 1927."""
        killed = self.mutants - len(self.survivors)
        low, high = binomtest(killed, self.mutants).proportion_ci(method="wilson")
        return float(low), float(high)


def modules(package: str) -> list[Path]:
    """Those of a package, without the plots: what they draw is judged by eye."""
    found = Path("gtsam_nav", package).rglob("*.py")
    return sorted(path for path in found if "plots" not in path.parts)


def check(package: str, size: int, seed: int, jobs: int) -> Outcome:
    """Run a sample of a package's mutants."""
    from benchmarks.mutation.mutants import sample

    begin = time.perf_counter()
    mutants = sample(modules(package), size, seed)
    tests = mirroring_tests(Path("gtsam_nav", package, "__init__.py"))
    limit_s = LEAST_LIMIT_S + PATIENCE * baseline_s(tests)

    def run(mutant: Mutant) -> Fate:
        return fate(mutant, mirroring_tests(mutant.path), limit_s)

    survivors: list[Mutant] = []
    hung = 0
    with ThreadPoolExecutor(jobs) as pool:
        for mutant, found in zip(mutants, pool.map(run, mutants), strict=True):
            hung += found is Fate.HUNG
            if found is Fate.SURVIVED:
                survivors.append(mutant)
                print("\n".join(told(mutant)), flush=True)
    return Outcome(package, len(mutants), tuple(survivors), hung, time.perf_counter() - begin)


def told(mutant: Mutant) -> Iterator[str]:
    """Where a mutant is, and what it changes."""
    yield f"  {mutant.path}:{mutant.line} {mutant.operator}"
    yield from (f"    {line}" for line in mutant.diff.splitlines())


def row(outcome: Outcome) -> str:
    """A package's figures."""
    low, high = outcome.interval()
    return (
        f"{outcome.package:14}{outcome.mutants:5} mutants, killed {outcome.killed:6.1%}"
        f" ({low:.1%} to {high:.1%}; {outcome.hung} by time), {outcome.wall_s:.0f} s"
    )


def record(outcome: Outcome) -> dict[str, object]:
    """The same for a file."""
    return {
        "package": outcome.package,
        "mutants": outcome.mutants,
        "killed": outcome.killed,
        "killed_by_time": outcome.hung,
        "interval95": outcome.interval(),
        "survivors": [
            {
                "path": str(each.path),
                "line": each.line,
                "operator": each.operator,
                "diff": each.diff,
            }
            for each in outcome.survivors
        ],
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Check the packages one after the other."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutation")
    parser.add_argument("packages", nargs="*", metavar="PACKAGE", help=", ".join(PACKAGES))
    parser.add_argument("--sample", type=int, default=60, help="mutants a package")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--target", type=float, default=TARGET, help="least share killed")
    parser.add_argument("--json", type=Path, help="file for the figures")
    options = parser.parse_args(arguments)
    if unknown := sorted(set(options.packages) - set(PACKAGES)):
        parser.error(f"no such package: {', '.join(unknown)}; there are {', '.join(PACKAGES)}")
    if find_spec("cosmic_ray") is None:
        sys.exit("cosmic-ray is not installed: pip install -e '.[test,mutation]'")
    # before the first process loads its libraries: trials run beside each other
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    outcomes = []
    for package in options.packages or PACKAGES:
        outcomes.append(check(package, options.sample, options.seed, options.jobs))
        print(row(outcomes[-1]), flush=True)
    if options.json:
        options.json.write_text(json.dumps([record(each) for each in outcomes], indent=2) + "\n")
    short = [each.package for each in outcomes if each.killed < options.target]
    if short:
        sys.exit(f"below {options.target:.0%}: {', '.join(short)}")


if __name__ == "__main__":
    main()
