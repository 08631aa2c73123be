"""The lines of a pose graph as text: a word, and numbers behind it, of which the first are ids."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Rejection
from gtsam_nav.readers._matrices import definite, symmetric
from gtsam_nav.readers._rows import is_number
from gtsam_nav.readers._text import TRUNCATED, stream_lines
from gtsam_nav.series import IntArray
from gtsam_nav.solution import Progress

N_IDS = 2
"""Whole numbers that an edge or a sighting begins with."""
MAX_ID = 2**53
AT_ONCE = 10_000
"""Lines whose texts are apart at a time."""


@dataclass(frozen=True)
class GraphLines:
    """What a file says.

    Attributes
    ----------
    path : Path
    numbers : mapping of str to ndarray, shape (n, k)
        Those behind each word, a row a line.
    line : mapping of str to ndarray of int, shape (n,)
        Its number in the file, from one.
    cut : str
        Word of a last line that is cut off; empty where the file is whole.
    skipped : Counter of str
        Other words.
    """

    path: Path
    numbers: Mapping[str, Array]
    line: Mapping[str, IntArray]
    cut: str
    skipped: Counter[str]

    def of(self, words: Sequence[str]) -> tuple[Array, IntArray]:
        """Numbers behind words that take equally many, in the file's order, and their lines."""
        line = np.concatenate([self.line[word] for word in words])
        order = np.argsort(line)
        return np.concatenate([self.numbers[word] for word in words])[order], line[order]

    def truncation(self, words: Sequence[str], sensor: str, n_samples: int) -> list[Rejection]:
        """The rejection of a last line that was cut off, if it was this sensor's."""
        return [Rejection(np.nan, sensor, n_samples, TRUNCATED)] if self.cut in words else []

    def warnings(self) -> list[str]:
        """What the user must hear of."""
        found = ["the graph has no clock: its poses are taken to be one second apart"]
        if self.skipped:
            listed = ", ".join(f"{word} ({n})" for word, n in self.skipped.most_common(5))
            found.append(f"lines that begin with other words are left out: {listed}")
        return found


def read_graph_lines(
    path: Path, n_numbers: Mapping[str, int], not_read: Collection[str], progress: Progress
) -> GraphLines:
    """Read the lines that begin with one of ``n_numbers``' words and hold so many numbers.

    Raises
    ------
    DataError
        Where a line is malformed. The last one of the file may be cut off instead.
    """
    rests: dict[str, list[str]] = {word: [] for word in n_numbers}
    line: dict[str, list[int]] = {word: [] for word in n_numbers}
    others: Counter[str] = Counter()
    last = 0
    for number, (text, fraction) in enumerate(stream_lines(path), start=1):
        if number % 1000 == 0:
            progress("read mission", fraction)
        word, rest = (*text.split(None, 1), "", "")[:2]
        if word in rests:
            rests[word].append(rest)
            line[word].append(number)
        elif word:
            others[word[:20]] += 1
        last = number if word else last
    progress("read mission", 1.0)
    cut = _cut_off(rests, line, n_numbers, last)
    if cut:
        rests[cut].pop()
        line[cut].pop()
    numbers = {
        word: _numbers(word, own, line[word], n_numbers[word], path) for word, own in rests.items()
    }
    for word in list(others):
        if word.startswith("#") or word in not_read:
            del others[word]
    at = {word: np.array(own, dtype=np.int64) for word, own in line.items()}
    return GraphLines(path, numbers, at, cut, others)


def _cut_off(
    rests: Mapping[str, list[str]],
    line: Mapping[str, list[int]],
    n_numbers: Mapping[str, int],
    last: int,
) -> str:
    """The word of the file's last line, if that ends too early or within a number."""
    for word, numbers in line.items():
        if numbers and numbers[-1] == last:
            texts = rests[word][-1].split()
            *whole, ending = [is_number(text) for text in texts] or [False]
            early = len(texts) < n_numbers[word] or not ending
            return word if all(whole) and early and len(texts) <= n_numbers[word] else ""
    return ""


def _numbers(word: str, rests: list[str], line: list[int], n: int, path: Path) -> Array:
    """The numbers of all lines of a word."""
    parts = [np.empty((0, n))]
    for first in range(0, len(rests), AT_ONCE):
        texts = [rest.split() for rest in rests[first : first + AT_ONCE]]
        try:
            if any(len(own) != n for own in texts):
                raise ValueError
            flat = np.array([*map(float, chain.from_iterable(texts))])
        except ValueError:
            raise _fault(word, texts, line[first:], n, path) from None
        parts.append(flat.reshape(-1, n))
    numbers = np.concatenate(parts)
    ids = numbers[:, :N_IDS]
    whole = np.all((np.abs(ids) < MAX_ID) & (ids == np.floor(ids)), axis=1)
    if not np.all(whole):
        what = f"{word} needs whole numbers of poses or landmarks first"
        raise DataError(what, path, line[int(np.argmin(whole))])
    return numbers


def _fault(word: str, texts: list[list[str]], line: Sequence[int], n: int, path: Path) -> DataError:
    """What is wrong with the first line that is."""
    for number, own in zip(line, texts, strict=False):
        if len(own) != n:
            return DataError(
                f"{len(own)} numbers behind {word}, where {n} are needed", path, number
            )
        for text in own:
            if not is_number(text):
                return DataError(f"{word}: '{text[:40]}' is not a number", path, number)
    raise AssertionError("nobody asks of lines without a fault")


def informations(upper: Array, size: int, path: Path, line: IntArray) -> Array:
    """Information matrices of which the upper triangle is given row by row.

    Raises
    ------
    DataError
        Where one is not positive definite.
    """
    information = symmetric(upper, size)
    good = definite(information)
    if not np.all(good):
        number = int(line[np.argmin(good)])
        raise DataError("its information is not positive definite", path, number)
    return information
