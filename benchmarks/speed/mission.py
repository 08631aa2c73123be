"""One mission from its files to its results, with the process's memory.

``python -m benchmarks.speed.mission PATH METHOD [KEY=VALUE ...]`` prints JSON. What numba has not
in its cache is compiled within the stages, so that the first run ever is slower.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import gtsam_nav as gn
from gtsam_nav.errors import GtsamNavError


def peak_mb() -> float:
    """Most memory that this process has held, MB (1e6 bytes).

    `resource.getrusage` would tell the parent's at the fork where that is more.
    """
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    (kibibytes,) = (line.split()[1] for line in lines if line.startswith("VmHWM:"))
    return int(kibibytes) * 1.024e-3


def stages(path: Path, method: str, config: gn.Config) -> tuple[dict[str, float], float]:
    """Seconds of each stage, from opening to results written without plots; and the mission's."""
    with tempfile.TemporaryDirectory() as out:
        begin = time.perf_counter()
        mission = gn.open_mission(path)
        opened = time.perf_counter()
        solution = gn.estimate(mission, method, config)
        estimated = time.perf_counter()
        gn.write_run(solution, config, out)
        written = time.perf_counter()
    first, last = mission.span_s
    inside = dict(solution.stage_s)
    rest = estimated - opened - sum(inside.values())
    seconds = {
        "opening": opened - begin,
        **inside,
        "rest of the estimate": rest,
        "writing": written - estimated,
    }
    return seconds, last - first


def run(path: Path, method: str, overrides: list[str]) -> dict[str, Any]:
    """One pass over a mission, imports included."""
    import_mb, cpu_s = peak_mb(), time.process_time()
    config = gn.load_config(None, overrides)
    seconds, mission_s = stages(path, method, config)
    total_s = sum(seconds.values())
    return {
        "stage_s": seconds,
        "total_s": total_s,
        "cpu_s": time.process_time() - cpu_s,
        "mission_s": mission_s,
        "realtime_factor": mission_s / total_s,
        "import_mb": import_mb,
        "peak_mb": peak_mb(),
    }


def main() -> None:
    """Print the figures of one run."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.speed.mission", description=__doc__)
    parser.add_argument("mission", type=Path, metavar="PATH", help="mission folder or logs")
    parser.add_argument("method", metavar="METHOD", help="as in gtsam-nav run -m")
    parser.add_argument("overrides", nargs="*", metavar="KEY=VALUE", help="settings")
    arguments = parser.parse_args()
    try:
        figures = run(arguments.mission, arguments.method, arguments.overrides)
    except GtsamNavError as error:
        parser.error(str(error))
    json.dump(figures, sys.stdout)


if __name__ == "__main__":
    main()
