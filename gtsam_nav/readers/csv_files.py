"""CSV files of others, with a card that says which column is what.

The card, the section ``mission`` of a file given by ``-c``, is what ``mission.yaml`` would be
beside the files (see `gtsam_nav.readers.folder`), with a map of the columns and what turns their
numbers into SI::

    mission:
      sensors:
        heading:
          file: flight.csv
          columns: {t: stamp_ns, heading_deg: yaw}
          scale: {t: 1.0e-9, heading_deg: 57.29578}
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gtsam_nav.cards import MISSION_SECTION, read_yaml
from gtsam_nav.errors import DataError
from gtsam_nav.mission import Mission
from gtsam_nav.readers._mission_yaml import MissionFile
from gtsam_nav.readers._table import header_names
from gtsam_nav.readers._text import first_lines, read_lines
from gtsam_nav.readers.contents import Contents, Stream
from gtsam_nav.readers.folder import read_described
from gtsam_nav.readers.layout import GEODETIC_COLUMNS, LAYOUTS, NED_COLUMNS
from gtsam_nav.solution import Progress, no_progress

NAME = "CSV with a card"
EXPECTS = "a .csv file (plain or .gz) or a folder of them, whose columns a card names"

ENDINGS = (".csv", ".csv.gz")


def can_open(path: Path) -> bool:
    """Whether the path is a CSV file, or a folder with one."""
    try:
        return bool(_files(path))
    except (OSError, ValueError):
        return False


def read(path: Path, progress: Progress = no_progress, card: Path | None = None) -> Mission:
    """Read the files that a card names.

    Raises
    ------
    DataError
        Where no card is given, a file or a column is missing, or a file is malformed.
    """
    if card is None:
        raise DataError(
            f"a card must say what the columns are: a file given by -c, as in {_example(path)}"
            " (docs/cards.md)",
            path,
        )
    described = read_yaml(card, MissionFile, section=MISSION_SECTION)
    return read_described(path if path.is_dir() else path.parent, described, card, progress)


def describe(path: Path, card: Path | None = None) -> Contents:
    """List the columns of the files; the card takes those that are named as in a mission folder."""
    streams = []
    entries: dict[str, Any] = {}
    for file in _files(path):
        names = header_names(next(iter(first_lines(file, 1)), ""), file)
        kinds = _kinds(names)
        streams.append(Stream(file.name, ", ".join(names), None, None, kinds, ""))
        for kind in kinds[:1]:
            entries.setdefault(kind, {"file": file.name})
    if card is not None:
        return Contents(tuple(streams), "\n".join(read_lines(card)))
    import yaml

    tree = {MISSION_SECTION: {"sensors": entries}}
    return Contents(tuple(streams), yaml.safe_dump(tree, sort_keys=False) if entries else "")


def _example(path: Path) -> str:
    """A card for the first file, to be edited."""
    file = _files(path)[0]
    first, *_ = header_names(next(iter(first_lines(file, 1)), ""), file)
    entry = f"file: {file.name}, columns: {{t: '{first}', heading_deg: ...}}"
    return f"{MISSION_SECTION}: {{sensors: {{heading: {{{entry}}}}}}}"


def _files(path: Path) -> list[Path]:
    if path.is_dir():
        return sorted(p for p in path.iterdir() if p.name.endswith(ENDINGS) and p.is_file())
    return [path] if path.is_file() and path.name.endswith(ENDINGS) else []


def _kinds(names: list[str]) -> tuple[str, ...]:
    """Types of sensor whose required columns are all there."""
    found = []
    for kind, layout in LAYOUTS.items():
        needed = {"t", *(c for spec in layout if spec.required for c in spec.columns)}
        geodetic = needed - {*NED_COLUMNS} | {*GEODETIC_COLUMNS}
        if needed <= {*names} or (kind == "gnss" and geodetic <= {*names}):
            found.append(kind)
    return tuple(found)
