"""What a second worker brings: ``python -m benchmarks.batch``.

The same simulated missions are estimated by one worker and by two, each from nothing to the summary
page, processes started in between. The load average tells what else the machine did.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import gtsam_nav as gn
from gtsam_nav.writers.mission_folder import write_mission


@dataclass(frozen=True)
class Side:
    """One batch."""

    workers: int
    method: str
    missions: int
    failed: int
    wall_s: float
    runs_cpu_s: float
    worker_peak_mb: float
    wall_s_per_mission_h: float
    load_before: float
    load_after: float


def measure(missions: Path, method: str, workers: int) -> Side:
    """Run the batch once."""
    with tempfile.TemporaryDirectory() as out:
        load_before, begin = os.getloadavg()[0], time.perf_counter()
        results = gn.batch(missions / "*", out, [method], workers=workers)
        wall_s = time.perf_counter() - begin
    return Side(
        workers=workers,
        method=method,
        missions=len(results),
        failed=int(results["cause"].notna().sum()),
        wall_s=wall_s,
        runs_cpu_s=float(results["cpu_s"].sum()),
        worker_peak_mb=float(results["worker_peak_mb"].max()),
        wall_s_per_mission_h=3600.0 * float(results["wall_s"].sum() / results["mission_s"].sum()),
        load_before=load_before,
        load_after=os.getloadavg()[0],
    )


def main() -> None:
    """Print a row a side and the ratio; write JSON where asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.batch", description=__doc__)
    parser.add_argument("--missions", type=int, default=32)
    parser.add_argument("--duration", type=float, default=600.0, help="of each mission, s")
    parser.add_argument("--method", default="graph")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--json", type=Path, help="write the figures here")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(arguments.missions):
            simulated = gn.simulate("marina", seed=seed, duration_s=arguments.duration)
            write_mission(simulated, Path(folder) / f"marina-{seed:03d}")
        print("workers method missions failed  wall s  CPU s of runs  peak MB  load")
        sides = []
        for workers in arguments.workers:
            side = measure(Path(folder), arguments.method, workers)
            sides.append(side)
            print(
                f"{side.workers:7d} {side.method:6} {side.missions:8d} {side.failed:6d} "
                f"{side.wall_s:7.1f} {side.runs_cpu_s:14.1f} {side.worker_peak_mb:8.0f}  "
                f"{side.load_before:.1f} to {side.load_after:.1f}",
                flush=True,
            )
    ratio = sides[0].wall_s / sides[-1].wall_s
    print(f"{sides[-1].workers} workers are {ratio:.2f} times as fast as {sides[0].workers}")
    if arguments.json:
        document = {"cores": os.cpu_count(), "sides": [asdict(s) for s in sides], "ratio": ratio}
        arguments.json.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
