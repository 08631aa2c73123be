"""Three published systems beside ours, over many seeds.

``python -m benchmarks.seeds [--seeds N] [--stpere FOLDER] [--json FILE]`` prints one table per
system and writes them as JSON, to ``out/seeds.json`` unless told where. [A] INS aided by landmark
SLAM, [B] pose-based SLAM with a scanning sonar (the real logs with ``--stpere``), [C] INS/GPS EKF
with outlier rejection.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

from benchmarks.seeds import gnss, landmarks, marina
from benchmarks.seeds.table import Table

SYSTEMS = ("A", "B", "C")


def tables(systems: list[str], seeds: int, workers: int, folder: Path | None) -> Iterator[Table]:
    """The tables that are asked for, as they are done."""
    if "A" in systems:
        yield landmarks.five_runs(seeds, workers)
        yield landmarks.submarine(seeds, workers)
    if "B" in systems:
        if folder is not None:
            yield marina.stpere(folder)
            yield marina.cost(folder)
        yield marina.simulated(seeds, workers)
    if "C" in systems:
        yield gnss.laps(seeds, workers)


def main() -> None:
    """Print the tables and write them as JSON."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.seeds", description=__doc__)
    parser.add_argument("--seeds", type=int, default=5, help="simulated missions of each kind")
    parser.add_argument("--system", nargs="+", choices=SYSTEMS, default=list(SYSTEMS))
    parser.add_argument("--stpere", type=Path, help="folder of the St. Pere logs")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--json", type=Path, default=Path("out/seeds.json"), help="the tables")
    arguments = parser.parse_args()
    done = []
    for table in tables(arguments.system, arguments.seeds, arguments.workers, arguments.stpere):
        print(table.text(), end="\n\n", flush=True)
        done.append(asdict(table))
    arguments.json.parent.mkdir(parents=True, exist_ok=True)
    arguments.json.write_text(json.dumps(done, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
