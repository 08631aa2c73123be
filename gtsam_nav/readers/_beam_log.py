"""Logs of scanning-sonar beams as text: tens of megabytes, parsed while they are decompressed."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Rejection
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.readers._bytes import read_chunks
from gtsam_nav.readers._table import truncation
from gtsam_nav.series import BeamSeries, BoolArray
from gtsam_nav.solution import Progress

LEADING = ("stamp", "sensor time", "head angle")
"""Fields of a line before its bins."""

MAX_LINE_BYTES = 10_000_000

NEWLINE, SPACE, ZERO = np.uint8(10), np.uint8(32), np.uint8(48)


@dataclass(frozen=True)
class _Block:
    """Beams of a run of whole lines.

    ``refused`` marks beams with an echo outside 0..255; ``fault`` is the number, inside the block,
    of the first line that is malformed, and ``ends_so`` says that no other follows it.
    """

    n_lines: int
    t: Array
    angle: Array
    intensity: NDArray[np.uint8]
    refused: BoolArray
    fault: int | None = None
    ends_so: bool = False
    fault_stamp: float = np.nan


def read_beams(
    path: Path, sensor_name: str, resolution_m: float, progress: Progress
) -> tuple[BeamSeries | None, list[Rejection]]:
    """Beams of a log whose lines are ``t s, sensor time ms, head angle rad, bins 0..255``.

    Raises
    ------
    DataError
        Where the file is missing or a line is malformed. A last line that is damaged is rejected.
    """
    texts = _whole_lines(path, progress)
    leading, n_bins = [b""], 0
    while n_bins == 0 and (text := next(texts, b"")):
        leading.append(text)
        n_bins = _bins_of_first_beam(text)
    parse = partial(_parse_block, n_bins=n_bins)
    with ThreadPoolExecutor(max_workers=1) as pool:
        # NumPy parses one block while the next is decompressed
        blocks = list(pool.map(parse, chain(leading, texts)))
    cut_stamp = _check(blocks, n_bins, path)
    n = sum(len(block.t) for block in blocks)
    series, rejections = tidy(
        BeamSeries,
        sensor_name,
        {
            "t": np.concatenate([block.t for block in blocks]),
            "angle": np.concatenate([block.angle for block in blocks]),
            "intensity": np.concatenate([block.intensity for block in blocks]),
        },
        refused={"echo outside 0..255": np.concatenate([block.refused for block in blocks])},
        resolution_m=resolution_m,
    )
    return series, rejections + truncation(sensor_name, n, cut_stamp)


def _whole_lines(path: Path, progress: Progress) -> Iterator[bytes]:
    """The text in pieces that end with a line; the last may lack its line break."""
    rest = b""
    for chunk, fraction in read_chunks(path):
        progress("read sonar", fraction)
        end = chunk.rfind(b"\n") + 1
        if end:
            yield rest + chunk[:end]
            rest = chunk[end:]
        else:
            rest += chunk
        if len(rest) > MAX_LINE_BYTES:
            raise DataError(f"no line break in {MAX_LINE_BYTES} bytes: no log of beams", path)
    if rest:
        yield rest


def _bins_of_first_beam(text: bytes) -> int:
    """Bins of the first line that is no comment; none where there is no such line."""
    first = next((line for line in text.split(b"\n") if _is_beam(line)), b"")
    return max(len(first.split()) - len(LEADING), 0)


def _is_beam(line: bytes) -> bool:
    return not (line.isspace() or not line or line.startswith(b"%"))


def _parse_block(text: bytes, n_bins: int) -> _Block:
    """Parse whole lines at once; line by line where that does not work out."""
    lines = text.split(b"\n")
    heads = [line.split(None, len(LEADING)) for line in lines if _is_beam(line)]
    if n_bins == 0 or any(len(head) != len(LEADING) + 1 for head in heads):
        return _parse_lines(lines, n_bins)
    echoes = _parse_echoes(b"\n".join([head[-1] for head in heads]), len(heads), n_bins)
    if echoes is None:
        return _parse_lines(lines, n_bins)
    try:
        t = np.array([float(head[0]) for head in heads])
        angle = np.array([float(head[2]) for head in heads])
    except ValueError:
        return _parse_lines(lines, n_bins)
    refused = np.any(echoes > 255, axis=1)
    return _Block(len(lines) - 1, t, angle, echoes.astype(np.uint8), refused)


def _parse_echoes(text: bytes, n_beams: int, n_bins: int) -> NDArray[np.uint16] | None:
    """Lines of numbers of up to three digits, shape (n_beams, n_bins); None for any others."""
    if n_beams == 0:
        return np.empty((0, n_bins), dtype=np.uint16)
    byte = np.frombuffer(text, dtype=np.uint8)
    digit = byte - ZERO  # wraps: what is no digit exceeds 9
    is_digit = digit < 10
    if not np.all(is_digit | (byte <= SPACE)):
        return None
    if np.any(is_digit[3:] & is_digit[2:-1] & is_digit[1:-2] & is_digit[:-3]):
        return None
    ends = is_digit.copy()
    ends[:-1] &= ~is_digit[1:]
    line_starts = np.append(0, np.flatnonzero(byte == NEWLINE) + 1)
    counts = np.add.reduceat(ends, line_starts, dtype=np.int64)
    if len(counts) != n_beams or np.any(counts != n_bins):
        return None
    digit *= is_digit
    value = digit.astype(np.uint16)
    value[1:] += np.multiply(digit[:-1], 10, dtype=np.uint16)
    value[2:] += np.multiply(digit[:-2] * is_digit[1:-1], 100, dtype=np.uint16)
    return np.asarray(value[ends].reshape(n_beams, n_bins))


def _parse_lines(lines: list[bytes], n_bins: int) -> _Block:
    """The slow way: stops at the first malformed line."""
    t: list[float] = []
    angle: list[float] = []
    echoes: list[list[int]] = []
    fault: int | None = None
    fields: list[bytes] = []
    for number, line in enumerate(lines):
        if not _is_beam(line):
            continue
        fields = line.split()
        try:
            stamp, _, head = (float(field) for field in fields[: len(LEADING)])
            beam = [min(max(int(field), -1), 256) for field in fields[len(LEADING) :]]
        except ValueError:
            fault = number
            break
        if n_bins == 0 or len(beam) != n_bins:
            fault = number
            break
        t.append(stamp)
        angle.append(head)
        echoes.append(beam)
    wide = np.array(echoes, dtype=np.int64).reshape(len(t), n_bins)
    outside = (wide < 0) | (wide > 255)
    return _Block(
        n_lines=len(lines) - 1,
        t=np.array(t),
        angle=np.array(angle),
        intensity=np.where(outside, 0, wide).astype(np.uint8),
        refused=np.any(outside, axis=1),
        fault=fault,
        ends_so=fault is not None and not any(_is_beam(line) for line in lines[fault + 1 :]),
        fault_stamp=_stamp(fields),
    )


def _stamp(fields: list[bytes]) -> float:
    try:
        # the only field of a cut line may be cut itself
        return float(fields[0]) if len(fields) > 1 else float("nan")
    except ValueError:
        return float("nan")


def _check(blocks: list[_Block], n_bins: int, path: Path) -> float | None:
    """The stamp of a last line that is damaged; any other malformed line is an error."""
    line = 1
    # the only line may be cut short, but one that is otherwise odd tells of another format
    bearable = n_bins == 0 or any(len(block.t) for block in blocks)
    for k, block in enumerate(blocks):
        if block.fault is not None:
            followed = any(len(later.t) or later.fault is not None for later in blocks[k + 1 :])
            if bearable and block.ends_so and not followed:
                return block.fault_stamp
            raise DataError(
                f"malformed beam; needed are {', '.join(LEADING)} and {n_bins} bins of 0 to 255",
                path,
                line + block.fault,
            )
        line += block.n_lines
    return None
