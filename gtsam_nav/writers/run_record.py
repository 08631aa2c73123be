"""run.json: where a run came from and how long it took; all that two equal runs differ in."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

import gtsam_nav
from gtsam_nav.config import Config
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Origin
from gtsam_nav.mission import Opening, SonarKind
from gtsam_nav.settings import first_fault
from gtsam_nav.solution import Solution

RECORD = "run.json"
CONFIG = "config.yaml"
PACKAGES = (
    *("gtsam", "numpy", "scipy", "numba", "pymap3d", "pydantic", "pyyaml", "matplotlib", "pillow"),
    *("rosbags", "kiss-icp", "open3d"),
)
"""What a result may depend on; those that are not installed are left out."""


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """Provenance of a run.

    Attributes
    ----------
    method, mission : str
    origin : Origin or None
    start_utc : float or None
        POSIX seconds of mission time zero.
    sonar : {"simulated", "recorded"} or None
    georeferenced : bool
        Whether positions are absolute.
    seed : int
    config_sha256 : str or None
        SHA-256 of the run's config.yaml; None in the record of an earlier version.
    command : str or None
        The command line, where there was one.
    versions : mapping of str to str
    sources : mapping of str to str
        SHA-256 of each file that was read, by absolute path.
    opening : Opening or None
        How the mission was opened; None where it did not come from disk.
    wall_s : float or None
        From opening the mission to the last result written, plots aside.
    mission_s : float
        Span of the mission's sensors.
    realtime_factor : float or None
        ``mission_s / wall_s``.
    stage_s : mapping of str to float
        Wall time of each stage.
    faults : tuple of str
        Specifications of what was injected.
    warnings : tuple of str
    skipped : mapping of str to str
        Files that the run has not, and why.
    """

    method: str
    mission: str
    origin: Origin | None
    start_utc: float | None
    sonar: SonarKind | None
    georeferenced: bool
    seed: int
    config_sha256: str | None = None
    command: str | None
    versions: Mapping[str, str]
    sources: Mapping[str, str]
    opening: Opening | None = None
    wall_s: float | None
    mission_s: float
    realtime_factor: float | None
    stage_s: Mapping[str, float]
    faults: tuple[str, ...] = ()
    warnings: tuple[str, ...]
    skipped: Mapping[str, str]


def make_record(
    solution: Solution,
    config: Config,
    skipped: Mapping[str, str],
    command: str | None,
    wall_s: float | None,
) -> RunRecord:
    """Collect the provenance of a solution."""
    mission = solution.mission
    begin, end = mission.span_s
    return RunRecord(
        method=solution.method,
        mission=mission.name,
        origin=mission.origin,
        start_utc=mission.start_utc,
        sonar=solution.sonar_kind,
        georeferenced=solution.georeferenced,
        seed=config.seed,
        config_sha256=hashlib.sha256(config.to_yaml().encode()).hexdigest(),
        command=command,
        versions=installed_versions(),
        sources={str(path.absolute()): sha256(path) for path in mission.sources},
        opening=mission.opening,
        wall_s=wall_s,
        mission_s=end - begin,
        realtime_factor=(end - begin) / wall_s if wall_s else None,
        stage_s=dict(solution.stage_s),
        faults=mission.faults,
        warnings=tuple(dict.fromkeys((*mission.warnings, *solution.warnings))),
        skipped=skipped,
    )


def installed_versions() -> dict[str, str]:
    """Version of this package, of those that results depend on, and of Python."""
    versions = {"gtsam_nav": gtsam_nav.__version__}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    return {**versions, "python": platform.python_version()}


def write_record(record: RunRecord, path: Path) -> None:
    """Write run.json."""
    document = TypeAdapter(RunRecord).dump_python(record, mode="json")
    text = json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")


def read_record(path: Path) -> RunRecord:
    """Read run.json.

    Raises
    ------
    DataError
        Where it is missing or of another shape.
    """
    try:
        return TypeAdapter(RunRecord).validate_json(path.read_bytes())
    except OSError as error:
        raise DataError(f"cannot read the record of the run: {error.strerror}", path) from error
    except ValidationError as error:
        raise DataError(f"is no record of a run: {first_fault(error)}", path) from error


def sha256(path: Path) -> str:
    """Checksum of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
