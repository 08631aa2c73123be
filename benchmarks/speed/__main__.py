"""How fast it is: ``python -m benchmarks.speed [--stpere PATH] [--aces PATH] [--check]``.

Sections, all or those after ``--only``: startup, graphs (against the barest GTSAM script),
preintegration (against a bare loop), pose_graphs (city10000, sphere2500, Victoria Park, those of
``--pose-graph``), growth; with ``--stpere`` also stages (of that mission) and registration (against
small_gicp and Open3D, extra ``benchmark``); with ``--aces`` registration_aces, the same on a
laser's scans. Each comparison is made in one process on the same input; figures are medians, ratios
are compared with ``benchmarks/speed_baseline.json``.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections.abc import Callable
from operator import itemgetter
from pathlib import Path
from typing import Any

from benchmarks.acceptance import STPERE, STPERE_SCORED
from benchmarks.speed import baseline
from benchmarks.speed.timing import in_process

NEEDED = {"stages": "stpere", "registration": "stpere", "registration_aces": "aces"}
"""Sections that need a folder, and the argument that gives it."""


def sections(arguments: argparse.Namespace) -> dict[str, Callable[[], dict[str, Any]]]:
    """What can be measured, by name."""

    def startup() -> dict[str, Any]:
        from benchmarks.speed import startup

        return startup.measure(arguments.repeats)

    def graphs() -> dict[str, Any]:
        from benchmarks.speed import graphs

        return graphs.measure(arguments.repeats)

    def preintegration() -> dict[str, Any]:
        from benchmarks.speed import preintegration

        return preintegration.measure(arguments.repeats)

    def pose_graphs() -> dict[str, Any]:
        from benchmarks.speed import pose_graphs

        return pose_graphs.measure(arguments.repeats, arguments.pose_graph, arguments.long)

    def growth() -> dict[str, Any]:
        from benchmarks.speed import growth

        return growth.measure(growth.LONG_H if arguments.long else growth.SHORT_H)

    def stages() -> dict[str, Any]:
        settings = (*STPERE["window"], STPERE_SCORED)
        command = ("benchmarks.speed.mission", str(arguments.stpere))
        runs = {
            name: [in_process(*command, name, *settings) for _ in range(arguments.repeats)]
            for name in ("dr", "graph")
        }
        # a whole run, so that its stages add up
        return {name: sorted(r, key=itemgetter("total_s"))[len(r) // 2] for name, r in runs.items()}

    def registration() -> dict[str, Any]:
        from benchmarks.speed import registration

        return registration.measure(registration.stpere_pairs(arguments.stpere), arguments.repeats)

    def registration_aces() -> dict[str, Any]:
        from benchmarks.speed import registration

        return registration.measure(registration.aces_pairs(arguments.aces), arguments.repeats)

    return {
        "startup": startup,
        "graphs": graphs,
        "preintegration": preintegration,
        "pose_graphs": pose_graphs,
        "stages": stages,
        "registration": registration,
        "registration_aces": registration_aces,
        "growth": growth,
    }


def show(figures: Any, indent: str = "  ") -> None:
    """Nested figures, a line each."""
    for name, value in figures.items():
        if isinstance(value, dict):
            print(f"{indent}{name}")
            show(value, indent + "  ")
        else:
            print(f"{indent}{name:<32} {value:.4g}" if value is not None else f"{indent}{name}")


def main() -> int:
    """Measure, print, write and compare; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.speed", description=__doc__)
    parser.add_argument("--stpere", type=Path, help="folder of the St. Pere logs with pairs.csv")
    parser.add_argument("--aces", type=Path, help="folder of the ACES log and its relations")
    parser.add_argument("--only", nargs="+", metavar="SECTION", help="measure no others")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument(
        "--long", action="store_true", help="missions of 5 and 10 h too, and pose graphs whole"
    )
    parser.add_argument(
        "--pose-graph", nargs="+", type=Path, default=[], metavar="G2O", help="these graphs too"
    )
    parser.add_argument("--json", type=Path, help="write the figures here")
    parser.add_argument("--check", action="store_true", help="compare the ratios, exit 1 if worse")
    parser.add_argument("--update", action="store_true", help="make these ratios the baseline")
    arguments = parser.parse_args()
    known = sections(arguments)
    lacking = {name for name, folder in NEEDED.items() if getattr(arguments, folder) is None}
    chosen = arguments.only or [name for name in known if name not in lacking]
    if unknown := set(chosen) - set(known):
        parser.error(f"unknown section {min(unknown)}; the choices are: {', '.join(known)}")
    if refused := lacking & set(chosen):
        parser.error(f"{min(refused)} needs --{NEEDED[min(refused)]}")
    document: dict[str, Any] = {
        "machine": {
            "processor": platform.processor() or platform.machine(),
            "cores": os.cpu_count(),
            "load_average": os.getloadavg()[0],
        }
    }
    ratios: dict[str, float] = {}
    for name in chosen:
        print(f"{name} (load average {os.getloadavg()[0]:.1f})", flush=True)
        try:
            document[name] = known[name]()
        except ModuleNotFoundError as error:
            parser.error(f"{name} needs {error.name}, of the extra 'benchmark'")
        show(document[name])
        ratios |= {f"{name}.{k}": v for k, v in document[name].get("ratios", {}).items()}
    if arguments.json:
        arguments.json.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    if arguments.update:
        baseline.update(ratios)
    exceeded = baseline.check(ratios) if arguments.check else []
    for one in exceeded:
        print(f"worse than the baseline: {one}", file=sys.stderr)
    return 1 if exceeded else 0


if __name__ == "__main__":
    sys.exit(main())
