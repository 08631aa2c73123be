"""A finished run again: from its own record and on the same files."""

from __future__ import annotations

from math import inf
from pathlib import Path

from gtsam_nav.audit import with_alerts
from gtsam_nav.config import load_config
from gtsam_nav.errors import DataError
from gtsam_nav.methods import estimate
from gtsam_nav.readers import open_mission
from gtsam_nav.simulation import parse_fault
from gtsam_nav.solution import Progress, no_progress
from gtsam_nav.writers.run_comparison import Repetition, compare
from gtsam_nav.writers.run_folder import write_run
from gtsam_nav.writers.run_record import (
    CONFIG,
    RECORD,
    RunRecord,
    installed_versions,
    read_record,
    sha256,
)

CHANGED = "was changed since the run"


def repeat(run: Path, out: Path, progress: Progress = no_progress) -> Repetition:
    """Estimate a run's mission again and compare the results.

    Parameters
    ----------
    run : Path
        A run's folder; its ``run.json`` and ``config.yaml`` say what is done.
    out : Path
        ``out/<method>/`` takes the repetition.
    progress : Progress, optional

    Raises
    ------
    DataError
        Where the record does not say how the mission was opened, or a file that was read then has
        changed or is gone.
    """
    record = read_record(run / RECORD)
    if record.opening is None:
        raise DataError("does not say how its mission was opened: it cannot be repeated", run)
    check_sources(record, run)
    config = load_config(run / CONFIG)
    mission = open_mission(record.opening.path, progress, record.opening.card)
    start_s, stop_s = record.opening.start_s, record.opening.stop_s
    mission = with_alerts(
        mission.crop(-inf if start_s is None else start_s, inf if stop_s is None else stop_s)
    )
    faults = [parse_fault(spec) for spec in record.faults]
    solution = estimate(mission, record.method, config, progress, faults)
    files = compare(run, write_run(solution, config, out))
    if config_was_changed(record, run):
        files[CONFIG] = CHANGED
    return Repetition(files, changed_versions(record))


def config_was_changed(record: RunRecord, run: Path) -> bool:
    """Whether a run's config.yaml is no longer what the run wrote, as far as its record tells."""
    return record.config_sha256 not in (None, sha256(run / CONFIG))


def check_sources(record: RunRecord, run: Path) -> None:
    """Raise a DataError that names the files which are no longer what the run read."""
    changed = []
    for name, checksum in record.sources.items():
        path = Path(name)
        if not path.is_file():
            changed.append(f"{name} is gone")
        elif sha256(path) != checksum:
            changed.append(f"{name} has changed")
    if changed:
        raise DataError(f"cannot be repeated: {'; '.join(changed)}", run)


def changed_versions(record: RunRecord) -> dict[str, tuple[str | None, str | None]]:
    """Packages whose version is another now than then."""
    now = installed_versions()
    names = dict.fromkeys((*record.versions, *now))
    pairs = {name: (record.versions.get(name), now.get(name)) for name in names}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}
