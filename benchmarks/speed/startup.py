"""Start-up: importing the package, and asking the command line for help."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from benchmarks.speed.timing import process_time

HELP = "import sys; from gtsam_nav.cli import main; sys.argv = ['gtsam-nav', '--help']; main()"


def measure(repeats: int) -> dict[str, Any]:
    """Seconds of whole processes, an empty one among them; ratios are of the processor's time."""
    commands = {"python": "pass", "import": "import gtsam_nav", "help": HELP}
    times = {name: process_time(["-c", code], repeats) for name, code in commands.items()}
    empty_s = times["python"].cpu_s
    return {
        "processes": {name: asdict(time) for name, time in times.items()},
        "ratios": {
            f"{name}_over_python": times[name].cpu_s / empty_s for name in ("import", "help")
        },
    }
