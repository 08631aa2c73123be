"""Missions from disk: one module a format, found by what it can open.

A format's module has ``NAME``, ``EXPECTS`` (what it looks for, for the message of a path that no
reader knows), ``can_open(path) -> bool`` and ``read(path, progress) -> Mission``.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Protocol, cast

from gtsam_nav.errors import DataError
from gtsam_nav.mission import Mission
from gtsam_nav.solution import Progress, no_progress


class Reader(Protocol):
    """A module that reads one format."""

    NAME: str
    EXPECTS: str

    def can_open(self, path: Path) -> bool:
        """Whether the path looks like this format; cheap, and never raises."""

    def read(self, path: Path, progress: Progress = no_progress) -> Mission:
        """Read the mission, or raise `DataError`."""


_READERS = (
    "gtsam_nav.readers.folder",
    "gtsam_nav.readers.stpere",
    "gtsam_nav.readers.mrclam",
    "gtsam_nav.readers.rtklib",
    "gtsam_nav.readers.toro",
    "gtsam_nav.readers.plaza",
)


def readers() -> tuple[Reader, ...]:
    """All readers, in the order in which they are asked."""
    return tuple(cast(Reader, import_module(name)) for name in _READERS)


def open_mission(path: Path | str, progress: Progress = no_progress) -> Mission:
    """Read a mission in whatever format it is.

    Parameters
    ----------
    path : Path or str
        What one of the readers expects: most often a folder, or the stem of a robot's files.
    progress : Progress, optional
        Called as the reading goes on.

    Raises
    ------
    DataError
        Where no reader knows the path, or a file is missing or damaged.
    """
    place = Path(path)
    for reader in readers():
        if reader.can_open(place):
            return reader.read(place, progress)
    if not place.exists():
        raise DataError("no such file or folder", place)
    expected = "; ".join(f"{reader.NAME}: {reader.EXPECTS}" for reader in readers())
    raise DataError(f"not a mission that any reader knows. They expect: {expected}", place)
