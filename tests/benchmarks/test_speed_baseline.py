"""The check of measured ratios against the committed baseline."""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks.speed.baseline import BASELINE, FLOOR, TOLERANCE, check, update


def test_a_ratio_beyond_its_tolerance_is_told(tmp_path: Path) -> None:
    path = tmp_path / "baseline.json"
    update({"slow": 2.0, "fast": 0.5}, path)
    assert check({"slow": 2.0 * TOLERANCE, "fast": 0.1, "new": 99.0}, path) == []
    (exceeded,) = check({"slow": 2.0 * TOLERANCE + 2 * FLOOR, "fast": 0.5}, path)
    assert (exceeded.name, exceeded.baseline) == ("slow", 2.0)


def test_an_update_keeps_the_tolerances_that_were_set_by_hand(tmp_path: Path) -> None:
    path = tmp_path / "baseline.json"
    path.write_text(json.dumps({"ratios": {"a": {"value": 1.0, "tolerance": 1.1}}}))
    update({"a": 3.0}, path)
    assert json.loads(path.read_text())["ratios"]["a"] == {"value": 3.0, "tolerance": 1.1}


def test_the_committed_baseline_meets_itself() -> None:
    ratios = json.loads(BASELINE.read_text(encoding="utf-8"))["ratios"]
    assert ratios
    assert check({name: entry["value"] for name, entry in ratios.items()}) == []
