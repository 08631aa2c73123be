"""Growth: the same marina for ten minutes, an hour, and longer where asked."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import gtsam_nav as gn
from benchmarks.speed.timing import in_process
from gtsam_nav.writers.mission_folder import write_mission

SHORT_H = (1.0 / 6.0, 1.0)
LONG_H = (*SHORT_H, 5.0, 10.0)


def measure(hours: tuple[float, ...], method: str = "graph") -> dict[str, Any]:
    """Seconds and memory of each length; ratios of the lengths to the shortest, per minute.

    Ratios are of the processor's time; memory is what the process holds beyond its first imports.
    """
    rows = {}
    for length_h in hours:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "mission"
            write_mission(gn.simulate("marina", seed=0, duration_s=3600.0 * length_h), path)
            run = in_process("benchmarks.speed.mission", str(path), method)
        minutes = run["mission_s"] / 60.0
        memory_mb = run["peak_mb"] - run["import_mb"]
        rows[f"{60.0 * length_h:.0f} min"] = {
            "total_s": run["total_s"],
            "cpu_s": run["cpu_s"],
            "memory_mb": memory_mb,
            "cpu_s_per_min": run["cpu_s"] / minutes,
            "kb_per_min": 1e3 * memory_mb / minutes,
            "stage_s": run["stage_s"],
        }
    shortest, *longer = rows.items()
    ratios = {
        f"{what}_{name.split()[0]}_over_{shortest[0].split()[0]}": row[per] / shortest[1][per]
        for name, row in longer
        for what, per in (("time_per_min", "cpu_s_per_min"), ("memory_per_min", "kb_per_min"))
    }
    return {"missions": rows, "ratios": ratios}
