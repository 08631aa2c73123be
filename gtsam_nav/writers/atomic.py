"""Results that appear whole or not at all: written beside their place, then renamed.

What was there before stays until the new is whole, whether an error, a full disk or a signal ends
the writing. Only a process that is killed outright leaves its draft, hidden by a dot.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

ENDING = ".draft"


@contextmanager
def draft_folder(target: Path) -> Iterator[Path]:
    """A folder beside a place, for what will be moved there; it vanishes in any case."""
    draft = target.with_name(f".{target.name}.{os.getpid()}{ENDING}")
    try:
        shutil.rmtree(draft, ignore_errors=True)
        draft.mkdir(parents=True)
        yield draft
    finally:
        shutil.rmtree(draft, ignore_errors=True)


@contextmanager
def replacing_folder(target: Path) -> Iterator[Path]:
    """A draft folder that takes the target's place when all went well, and else vanishes."""
    retired = target.with_name(f".{target.name}.{os.getpid()}.old")
    with draft_folder(target) as draft:
        yield draft
        try:
            if target.exists():
                target.rename(retired)
            draft.rename(target)
        finally:
            if retired.exists() and not target.exists():
                retired.rename(target)
            shutil.rmtree(retired, ignore_errors=True)


@contextmanager
def replacing_file(target: Path) -> Iterator[Path]:
    """A draft file that takes the target's place when all went well, and else vanishes."""
    draft = target.with_name(f".{target.name}.{os.getpid()}{ENDING}")
    try:
        yield draft
        draft.replace(target)
    finally:
        draft.unlink(missing_ok=True)


def remove_drafts(folder: Path) -> None:
    """Remove the drafts below a folder; for when no process that writes there lives any more."""
    for draft in folder.rglob(f".*{ENDING}"):
        if draft.is_dir():
            shutil.rmtree(draft, ignore_errors=True)
        else:
            draft.unlink(missing_ok=True)


def missing_folders(path: Path) -> list[Path]:
    """A folder and its parents as far as they are not there, the innermost first."""
    return [folder for folder in (path, *path.parents) if not folder.exists()]


def remove_empty(folders: Iterable[Path]) -> None:
    """Remove those of the folders that hold nothing."""
    for folder in folders:
        with suppress(OSError):  # it holds something, or somebody else removed it
            folder.rmdir()
