"""Rows of a table, as runs would have left them."""

from __future__ import annotations

import json
from typing import Any

import pandas as pd

from gtsam_nav.batch.table import RunRow
from gtsam_nav.evaluation.comparison import ComparisonRow


def figures(**scores: Any) -> ComparisonRow:
    """Scores of a run, all unknown but those given."""
    unknown: dict[str, Any] = dict.fromkeys(ComparisonRow.__dataclass_fields__)
    counts = {"name": "m", "failed": False, "loops_accepted": 0, "loops_proposed": 0}
    return ComparisonRow(**(unknown | counts | {"n_rejected": 0} | scores))


def row(mission: str, method: str = "dr", error_m: float | None = 1.0, **rest: Any) -> RunRow:
    """The row of a run with a mean error; with ``cause`` that of a run that failed."""
    sweep = rest.get("sweep", "")
    failed = "cause" in rest
    about: dict[str, Any] = {
        "key": f"{mission} {method} {sweep}",
        "mission": mission,
        "path": f"/data/{mission}",
        "method": method,
        "sweep": sweep,
        "parameters": "{}",
        "config_sha256": "0",
        "versions": None if failed else json.dumps({"gtsam_nav": "1"}),
        "folder": f"/out/{mission}/{method}",
        "exit_code": 3 if failed else 0,
        "attempts": 1,
        "worker": "host 1",
        "finished_utc": 1.0,
        "wall_s": 2.0,
        "cpu_s": 1.5,
        "mission_s": None if failed else 600.0,
        "worker_peak_mb": 300.0,
        "figures": None if failed else figures(ate_none_mean_m=error_m, nees_mean=2.0),
    }
    return RunRow(**(about | rest))


def frame(*rows: RunRow) -> pd.DataFrame:
    """The table of these rows."""
    return pd.DataFrame([r.to_record() for r in rows])
