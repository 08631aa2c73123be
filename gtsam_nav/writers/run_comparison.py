"""Two runs that should be the same, file by file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtsam_nav.writers.run_record import RECORD

SAME = "same bytes"
NUMBER = re.compile(rb"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])")


@dataclass(frozen=True)
class Repetition:
    """What a run and its repetition have in common.

    Attributes
    ----------
    files : mapping of str to str
        `SAME`, or how the two differ, by the name of the result.
    versions : mapping of str to (str or None, str or None)
        Packages of another version now than then; None where one was not there.
    """

    files: Mapping[str, str]
    versions: Mapping[str, tuple[str | None, str | None]]

    @property
    def is_same(self) -> bool:
        """Whether all results are the same bytes."""
        return all(difference == SAME for difference in self.files.values())


def compare(before: Path, after: Path) -> dict[str, str]:
    """How each result of a run differs in another; all files but run.json."""
    names = {path.name for folder in (before, after) for path in folder.iterdir() if path.is_file()}
    found = {}
    for name in sorted(names - {RECORD}):
        one, two = before / name, after / name
        if not (one.is_file() and two.is_file()):
            found[name] = "only in the repetition" if two.is_file() else "not in the repetition"
        else:
            found[name] = difference(one.read_bytes(), two.read_bytes())
    return found


def difference(one: bytes, two: bytes) -> str:
    """How much two contents differ: the numbers of texts that are alike, else lines or bytes."""
    if one == two:
        return SAME
    if b"\0" in one or b"\0" in two:
        shared = min(len(one), len(two))
        ours, theirs = (np.frombuffer(data, np.uint8, shared) for data in (one, two))
        n = int(np.count_nonzero(ours != theirs)) + max(len(one), len(two)) - shared
        return f"{n} of {max(len(one), len(two))} bytes differ"
    if NUMBER.sub(b"#", one) == NUMBER.sub(b"#", two):
        a, b = (np.array(NUMBER.findall(text), dtype=float) for text in (one, two))
        n = int(np.count_nonzero(a != b))
        return f"{n} of {len(a)} numbers differ, by {np.max(np.abs(a - b)):.3g} at most"
    ours_lines, their_lines = one.splitlines(), two.splitlines()
    first = next(
        (k for k, (x, y) in enumerate(zip(ours_lines, their_lines, strict=False)) if x != y),
        min(len(ours_lines), len(their_lines)),
    )
    return f"{len(ours_lines)} lines became {len(their_lines)}, other from line {first + 1} on"
