"""What a second worker brings: ``python -m benchmarks.batch``.

The same simulated missions are estimated by one worker and by two, each from nothing to the summary
page, the start of the processes included. On a machine that does other things too, ``--rounds``
lets the two take turns on parts of the missions; the load average tells how busy it was.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import gtsam_nav as gn
from gtsam_nav.writers.mission_folder import write_mission


@dataclass
class Side:
    """All batches of one number of workers."""

    workers: int
    missions: int = 0
    failed: int = 0
    wall_s: float = 0.0
    runs_wall_s: float = 0.0
    runs_cpu_s: float = 0.0
    mission_s: float = 0.0
    worker_peak_mb: float = 0.0
    loads: list[float] = field(default_factory=list)

    def run(self, missions: Sequence[Path], method: str) -> None:
        """Run a batch and add what it took."""
        self.loads.append(os.getloadavg()[0])
        with tempfile.TemporaryDirectory() as out:
            begin = time.perf_counter()
            results = gn.batch(missions, out, [method], workers=self.workers)
            self.wall_s += time.perf_counter() - begin
        self.missions += len(results)
        self.failed += int(results["cause"].notna().sum())
        self.runs_wall_s += float(results["wall_s"].sum())
        self.runs_cpu_s += float(results["cpu_s"].sum())
        self.mission_s += float(results["mission_s"].sum())
        self.worker_peak_mb = max(self.worker_peak_mb, float(results["worker_peak_mb"].max()))


def main() -> None:
    """Print a row a side and the ratio; write JSON where asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.batch", description=__doc__)
    parser.add_argument("--missions", type=int, default=32)
    parser.add_argument("--duration", type=float, default=600.0, help="of each mission, s")
    parser.add_argument("--method", default="graph")
    parser.add_argument("--workers", type=int, nargs=2, default=[1, 2])
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write the figures here")
    arguments = parser.parse_args()
    few, many = (Side(workers) for workers in arguments.workers)
    with tempfile.TemporaryDirectory() as folder:
        missions = [Path(folder) / f"marina-{seed:03d}" for seed in range(arguments.missions)]
        for seed, path in enumerate(missions):
            write_mission(gn.simulate("marina", seed, arguments.duration), path)
        for k in range(arguments.rounds):
            for side in (few, many):
                side.run(missions[k :: arguments.rounds], arguments.method)
    print("workers missions failed  wall s  runs: wall s  CPU s  CPU s/mission h  peak MB  load")
    for side in (few, many):
        print(
            f"{side.workers:7d} {side.missions:8d} {side.failed:6d} {side.wall_s:7.1f}"
            f"  {side.runs_wall_s:12.1f} {side.runs_cpu_s:6.1f}"
            f" {3600.0 * side.runs_cpu_s / side.mission_s:16.1f} {side.worker_peak_mb:8.0f}"
            f"  {min(side.loads):.1f} to {max(side.loads):.1f}"
        )
    ratio = few.wall_s / many.wall_s
    print(f"{arguments.method}: {many.workers} workers are {ratio:.2f} times as fast")
    if arguments.json:
        sides = [asdict(side) for side in (few, many)]
        document = {"method": arguments.method, "cores": os.cpu_count(), "sides": sides}
        text = json.dumps({**document, "ratio": ratio}, indent=2)
        arguments.json.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
