"""What a batch has to do: missions times swept settings times methods."""

from __future__ import annotations

import glob
import hashlib
import itertools
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from gtsam_nav.config import Config, override_config
from gtsam_nav.errors import ConfigError, DataError
from gtsam_nav.yaml_files import YamlError, parse_yaml

Sweep = Mapping[str, Sequence[Any]]


@dataclass(frozen=True)
class PlannedRun:
    """One method on one mission under one configuration; small, for it travels to a worker.

    Attributes
    ----------
    mission : str
        The mission's label: the end of its path, as long as it takes to be unique.
    path : Path
        Absolute; workers share the file system.
    method : str
    parameters : mapping of str to value
        The swept settings of this run.
    config : Config
        Resolved, the swept settings included.
    folder : Path
        Where the run's own folder, named for the method, goes.
    card : Path or None
        What the mission is opened by.
    """

    mission: str
    path: Path
    method: str
    parameters: Mapping[str, Any]
    config: Config
    folder: Path
    card: Path | None = None

    @property
    def sweep(self) -> str:
        """The swept settings as text; empty where nothing is swept."""
        return sweep_label(self.parameters)

    @cached_property
    def config_sha256(self) -> str:
        """Checksum of the resolved configuration."""
        return hashlib.sha256(self.config.model_dump_json().encode()).hexdigest()

    @cached_property
    def key(self) -> str:
        """What this run is, whatever its input holds: by all that it is called with."""
        card = "" if self.card is None else f"\n{self.card}"
        identity = f"{self.path}\n{self.method}\n{self.config_sha256}{card}"
        return hashlib.sha256(identity.encode()).hexdigest()[:20]


def plan_runs(
    missions: Iterable[Path | str],
    out: Path,
    methods: Sequence[str],
    config: Config,
    sweep: Sweep,
    card: Path | None = None,
) -> list[PlannedRun]:
    """All runs of a batch, mission by mission.

    Parameters
    ----------
    missions : iterable of Path or str
        Paths or glob patterns.
    out : Path
    methods : sequence of str
    config : Config
    sweep : mapping of str to sequence
        Values of each swept setting; all combinations are run.
    card : Path, optional
        What each mission is opened by.

    Raises
    ------
    ConfigError
        For a swept setting that is unknown, out of range or without a value, or without a method.
    DataError
        Where a pattern matches nothing.
    """
    if not methods:
        raise ConfigError("no method is given; at least one is needed")
    for key, values in sweep.items():
        if not values:
            raise ConfigError(f"no value is given to sweep '{key}'; at least one is needed")
    configs = [
        (parameters, override_config(config, [_override(*item) for item in parameters.items()]))
        for parameters in combinations(sweep)
    ]
    return [
        PlannedRun(
            mission=label,
            path=path,
            method=method,
            parameters=parameters,
            config=resolved,
            folder=out.absolute() / label / _folder_name(sweep_label(parameters)),
            card=None if card is None else card.absolute(),
        )
        for label, path in label_missions(find_missions(missions)).items()
        for parameters, resolved in configs
        for method in dict.fromkeys(methods)
    ]


def find_missions(patterns: Iterable[Path | str]) -> list[Path]:
    """The paths that match, each once, by name within a pattern.

    Raises
    ------
    DataError
        Where a pattern matches nothing.
    """
    found: dict[Path, None] = {}
    for pattern in patterns:
        # the stem of a robot's files is a mission's path too, though no file has that name
        literal = [] if glob.has_magic(str(pattern)) else [str(pattern)]
        # Path.glob takes no absolute pattern
        matches = literal or sorted(glob.glob(str(pattern), recursive=True))  # noqa: PTH207
        if not matches:
            raise DataError("no file or folder matches", pattern)
        found |= {Path(match).resolve(): None for match in matches}
    return list(found)


def label_missions(paths: Sequence[Path]) -> dict[str, Path]:
    """Paths by their shortest trailing parts that tell all of them apart, joined by ``_``."""
    deepest = max((len(path.parts) for path in paths), default=1)
    for length in range(1, deepest):
        labels = ["_".join(path.parts[1:][-length:]) for path in paths]
        if len(set(labels)) == len(paths):
            return dict(zip(labels, paths, strict=True))
    raise DataError(f"cannot tell these missions apart: {', '.join(map(str, paths))}")


def combinations(sweep: Sweep) -> Iterator[dict[str, Any]]:
    """Every combination of the swept values; one that is empty where nothing is swept."""
    for values in itertools.product(*sweep.values()):
        yield dict(zip(sweep, values, strict=True))


def parse_sweep(specs: Sequence[str]) -> dict[str, list[Any]]:
    """Sweeps from ``key=v1,v2,...``; values are read as YAML.

    Raises
    ------
    ConfigError
        Where one is of another form, or names a setting that another one names.
    """
    sweep: dict[str, list[Any]] = {}
    for spec in specs:
        key, _, text = (part.strip() for part in spec.partition("="))
        try:
            values = parse_yaml(f"[{text}]")
        except YamlError:
            values = []
        if not key or not values:
            raise ConfigError(
                f"'{spec}' is not of the form key=v1,v2, as in graph.keyframe_interval_s=0.5,1"
            )
        if key in sweep:
            raise ConfigError(f"'{key}' is swept twice; give all its values in one --sweep")
        sweep[key] = values
    return sweep


def sweep_label(parameters: Mapping[str, Any]) -> str:
    """``key=value`` of each swept setting."""
    return ",".join(_override(*item) for item in parameters.items())


def _override(key: str, value: Any) -> str:
    # JSON is YAML, and keeps a value on one line
    text = value if isinstance(value, str) else json.dumps(value, separators=(",", ":"))
    return f"{key}={text}"


def _folder_name(label: str) -> str:
    return label.replace("/", "_")
