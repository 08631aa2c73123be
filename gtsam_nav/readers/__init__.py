"""Missions from disk: one module a format, found by what it can open.

A format's module has ``NAME``, ``EXPECTS`` (what it looks for, for the message of a path that no
reader knows), ``can_open(path) -> bool`` and ``read(path, progress) -> Mission``. One whose files
do not say which stream is which sensor also takes ``read(path, progress, card)``, the card being a
YAML file with a section ``mission``, and lists its streams by ``describe(path, card) -> Contents``.
One whose files hold no sigmas of some sensors has the types of these, by name, in ``BY_FIGURES``
and takes ``read(path, progress, figures)``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, cast, runtime_checkable

from gtsam_nav.errors import ConfigError, DataError
from gtsam_nav.mission import Mission, Opening
from gtsam_nav.readers._figures import NO_FIGURES, Figures
from gtsam_nav.solution import Progress, no_progress

if TYPE_CHECKING:
    from gtsam_nav.readers.contents import Contents


class Reader(Protocol):
    """A module that reads one format."""

    NAME: str
    EXPECTS: str

    def can_open(self, path: Path) -> bool:
        """Whether the path looks like this format; cheap, and never raises."""

    def read(self, path: Path, progress: Progress = no_progress) -> Mission:
        """Read the mission, or raise `DataError`."""


@runtime_checkable
class DescribingReader(Protocol):
    """A reader of files whose streams a card must name."""

    NAME: str

    def read(
        self, path: Path, progress: Progress = no_progress, card: Path | None = None
    ) -> Mission:
        """Read the mission that a card, or the reader's own choice, makes of the streams."""

    def describe(self, path: Path, card: Path | None = None) -> Contents:
        """List the streams, and a card for them."""


@runtime_checkable
class FigureReader(Protocol):
    """A reader of single files that hold no sigmas, or not all: noise figures stand for these."""

    NAME: str
    BY_FIGURES: Mapping[str, str]

    def read(
        self, path: Path, progress: Progress = no_progress, figures: Figures = NO_FIGURES
    ) -> Mission:
        """Read the mission by the figures that a card states."""


_READERS = (
    "gtsam_nav.readers.folder",
    "gtsam_nav.readers.stpere",
    "gtsam_nav.readers.mrclam",
    "gtsam_nav.readers.rtklib",
    "gtsam_nav.readers.toro",
    "gtsam_nav.readers.plaza",
    "gtsam_nav.readers.rosbag",
    "gtsam_nav.readers.nmea",
    "gtsam_nav.readers.waterlinked",
    "gtsam_nav.readers.carmen",
    "gtsam_nav.readers.ping360",
    "gtsam_nav.readers.g2o",
    "gtsam_nav.readers.csv_files",
    "gtsam_nav.readers.cloud_files",
)


def readers() -> tuple[Reader, ...]:
    """All readers, in the order in which they are asked."""
    return tuple(cast(Reader, import_module(name)) for name in _READERS)


def open_mission(
    path: Path | str, progress: Progress = no_progress, card: Path | str | None = None
) -> Mission:
    """Read a mission in whatever format it is.

    Parameters
    ----------
    path : Path or str
        What one of the readers expects: most often a folder, or the stem of a robot's files; or a
        folder that holds one such and no other.
    progress : Progress, optional
        Called as the reading goes on.
    card : Path or str, optional
        A file whose section ``mission`` says what the streams of a bag are, or how the sensors of
        a mission in a single file are mounted.

    Raises
    ------
    DataError
        Where no reader knows the path, or a file is missing or damaged.
    ConfigError
        Where a card is given for a folder that describes itself.
    """
    reader, place = _located(Path(path))
    if card is None:
        return replace(reader.read(place, progress), opening=Opening(place.absolute()))
    opening = Opening(place.absolute(), Path(card).absolute())
    if isinstance(reader, DescribingReader):
        return replace(reader.read(place, progress, Path(card)), opening=opening)
    if place.is_file():
        from gtsam_nav.readers._file_card import read_file_card, with_card

        stated = read_file_card(Path(card))
        mission = (
            reader.read(place, progress, stated.figures(reader.BY_FIGURES))
            if isinstance(reader, FigureReader)
            else reader.read(place, progress)
        )
        return replace(with_card(mission, stated, Path(card)), opening=opening)
    from gtsam_nav.readers._mission_yaml import MISSION_FILE

    takers = ", ".join(r.NAME for r in readers() if isinstance(r, DescribingReader))
    with_own = f", whose card is its {MISSION_FILE}" if (place / MISSION_FILE).is_file() else ""
    raise ConfigError(
        f"{card}: the section 'mission' is for a {takers} and for single files; {place} is a"
        f" {reader.NAME}{with_own}"
    )


def describe(path: Path | str, card: Path | str | None = None) -> Contents | None:
    """The streams of a file that does not say which of them is which sensor; None of others.

    Raises
    ------
    DataError
        Where no reader knows the path, or it is damaged.
    """
    reader, place = _located(Path(path))
    if not isinstance(reader, DescribingReader):
        return None
    return reader.describe(place, None if card is None else Path(card))


MOST_ENTRIES = 100
"""Of a folder, in which the mission is looked for where the folder itself is none."""


def _located(place: Path) -> tuple[Reader, Path]:
    """The reader of a path, or of the one mission that lies in it; and what it is to read."""
    reader = _reader_of(place)
    if reader is not None:
        return reader, place
    if not place.exists():
        raise DataError("no such file or folder", place)
    inside = _inside(place)
    if len(inside) == 1:
        return inside[0]
    if inside:
        names = ", ".join(str(entry.relative_to(place)) for _, entry in inside)
        raise DataError(f"holds {len(inside)} missions; name one of: {names}", place)
    if is_trajectory(place):
        raise DataError(
            "a trajectory and no mission: 'gtsam-nav evaluate TRAJECTORY REFERENCE' scores it,"
            " 'gtsam-nav run' estimates one from a mission",
            place,
        )
    expected = "; ".join(f"{reader.NAME}: {reader.EXPECTS}" for reader in readers())
    raise DataError(f"not a mission that any reader knows. They expect: {expected}", place)


def _inside(place: Path, depth: int = 2) -> list[tuple[Reader, Path]]:
    """The missions in a folder: its entries, and what lies in those that are none themselves."""
    found: list[tuple[Reader, Path]] = []
    for entry in sorted(place.iterdir())[:MOST_ENTRIES] if place.is_dir() else []:
        reader = _reader_of(entry)
        if reader is not None:
            found.append((reader, entry))
        elif depth > 1:
            found += _inside(entry, depth - 1)
    return found


def is_trajectory(place: Path) -> bool:
    """Whether a file holds the eight or twelve numbers a line of TUM or KITTI."""
    from gtsam_nav.readers._text import first_lines

    rows = [line.split() for line in first_lines(place, 20) if not line.startswith("#")]
    try:
        return bool(rows) and all(len([float(x) for x in row]) in (8, 12) for row in rows if row)
    except ValueError:
        return False


def _reader_of(place: Path) -> Reader | None:
    return next((reader for reader in readers() if reader.can_open(place)), None)
