"""The committed baseline: ratios, and by how much each may be exceeded.

A ratio compares two times of one process on one machine, so that it holds on another; less is
better. Seconds are not compared.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

BASELINE = Path(__file__).parents[1] / "speed_baseline.json"
TOLERANCE = 1.3
"""Of a ratio that the baseline has no tolerance for yet."""
FLOOR = 0.05
"""Added to what is allowed: a ratio near zero is noise."""


@dataclass(frozen=True)
class Exceeded:
    """A ratio that is worse than the baseline allows."""

    name: str
    measured: float
    baseline: float
    allowed: float

    def __str__(self) -> str:
        return (
            f"{self.name} is {self.measured:.3f}; the baseline is {self.baseline:.3f}, "
            f"{self.allowed:.3f} is allowed"
        )


def check(ratios: Mapping[str, float], path: Path = BASELINE) -> list[Exceeded]:
    """The ratios that exceed what the baseline allows; those it does not know are let pass."""
    document = json.loads(path.read_text(encoding="utf-8"))["ratios"]
    exceeded = []
    for name, measured in ratios.items():
        if name in document:
            value, tolerance = document[name]["value"], document[name]["tolerance"]
            allowed = value * tolerance + FLOOR
            if measured > allowed:
                exceeded.append(Exceeded(name, measured, value, allowed))
    return exceeded


def update(ratios: Mapping[str, float], path: Path = BASELINE) -> None:
    """Put measured ratios in the baseline's place; tolerances that were set by hand stay."""
    known = json.loads(path.read_text(encoding="utf-8"))["ratios"] if path.is_file() else {}
    for name, value in ratios.items():
        tolerance = known.get(name, {}).get("tolerance", TOLERANCE)
        known[name] = {"value": round(value, 4), "tolerance": tolerance}
    text = json.dumps({"ratios": dict(sorted(known.items()))}, indent=2)
    path.write_text(text + "\n", encoding="utf-8")
