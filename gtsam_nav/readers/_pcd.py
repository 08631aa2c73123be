"""Points of PCD files (Point Cloud Library, version 0.7): ASCII, binary and compressed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.readers._bytes import MAX_BYTES, read_bytes
from gtsam_nav.readers._rows import number_columns

KINDS = {"I": "i", "U": "u", "F": "f"}
SIZES = {"i": (1, 2, 4, 8), "u": (1, 2, 4, 8), "f": (4, 8)}
MAX_HEADER_BYTES = 100_000
MAX_NUMBERS = 1000
"""Of a point."""


@dataclass(frozen=True)
class _Header:
    """What the header states: a name, a type and a count of numbers for each field."""

    names: tuple[str, ...]
    types: tuple[str, ...]
    counts: tuple[int, ...]
    n_points: int
    storage: str

    @property
    def record(self) -> np.dtype[np.void]:
        """A point; fields go by their place, since padding repeats its name."""
        rows = zip(self.types, self.counts, strict=True)
        return np.dtype([(str(k), kind, (n,)) for k, (kind, n) in enumerate(rows)])

    def columns(self, fields: list[Array]) -> dict[str, Array]:
        """The fields of one number a point by name."""
        rows = zip(self.names, self.counts, fields, strict=True)
        return {name: field[:, 0].astype(float) for name, n, field in rows if n == 1}


def read_pcd(path: Path) -> dict[str, Array]:
    """The fields of the points by name, each of shape (k,); those of several numbers are left out.

    Raises
    ------
    DataError
        Where the file is no PCD, or holds less than it states.
    """
    data = read_bytes(path)
    place = data.find(b"\nDATA ", 0, MAX_HEADER_BYTES)
    start = data.find(b"\n", place + 1) + 1
    if place < 0 or start == 0:
        raise DataError("is no PCD file: no header that ends with a line DATA", path)
    header = _parse_header(data[:start].decode("latin-1"), path)
    if header.storage == "ascii":
        fields = enumerate(zip(header.names, header.counts, strict=True))
        # by their place too: padding repeats its name
        names = [f"{place} {name} {k}" for place, (name, n) in fields for k in range(n)]
        lines = data[start:].decode("latin-1").split("\n")
        table = np.column_stack([*number_columns(lines, header.n_points, names, path).values()])
        return header.columns(np.split(table, np.cumsum(header.counts)[:-1], axis=1))
    size = header.n_points * header.record.itemsize
    if header.storage == "binary":
        if len(data) - start < size:
            raise DataError(f"ends before the {header.n_points} points that it states", path)
        points = np.frombuffer(data, header.record, header.n_points, start)
        return header.columns([points[name] for name in header.record.names or ()])
    return header.columns(_by_field(_decompressed(data[start:], size, path), header))


def _by_field(data: bytes, header: _Header) -> list[Array]:
    """The fields of a compressed file, which stand one behind the other."""
    fields = []
    offset = 0
    for kind, n in zip(header.types, header.counts, strict=True):
        values = np.frombuffer(data, kind, header.n_points * n, offset)
        fields.append(values.reshape(header.n_points, n))
        offset += values.nbytes
    return fields


def _parse_header(header: str, path: Path) -> _Header:
    stated = {words[0]: words[1:] for line in header.splitlines() if (words := line.split())}
    names = stated.get("FIELDS", [])
    types = [
        f"<{KINDS[kind]}{size}"
        for kind, size in zip(stated.get("TYPE", []), stated.get("SIZE", []), strict=False)
        if kind in KINDS and size in map(str, SIZES[KINDS[kind]])
    ]
    counts = _whole(stated.get("COUNT", ["1"] * len(names)))
    points = _whole(stated.get("POINTS", []))
    storage = " ".join(stated["DATA"])
    if not names or not len(names) == len(types) == len(counts) or min(counts) < 1:
        raise DataError("FIELDS, SIZE, TYPE and COUNT do not state one type for each field", path)
    if len(points) != 1 or storage not in ("ascii", "binary", "binary_compressed"):
        raise DataError("POINTS or DATA (ascii, binary, binary_compressed) are not stated", path)
    if sum(counts) > MAX_NUMBERS or sum(counts) * points[0] > MAX_BYTES:
        raise DataError(f"states {points[0]} points of {sum(counts)} numbers: not plausible", path)
    return _Header(tuple(names), tuple(types), tuple(counts), points[0], storage)


def _whole(words: list[str]) -> list[int]:
    return [int(word) for word in words if word.isdecimal() and len(word) < 13]


def _decompressed(data: bytes, size: int, path: Path) -> bytes:
    """The contents of a compressed file: two sizes, then runs of bytes and references (LZF)."""
    if len(data) < 8:
        raise DataError("ends before its compressed points", path)
    packed, unpacked = (int.from_bytes(data[k : k + 4], "little") for k in (0, 4))
    source = data[8 : 8 + packed]
    if len(source) < packed or unpacked != size:
        raise DataError(f"ends early, or its points do not take {unpacked} bytes", path)
    out = bytearray()
    k = 0
    while k < packed and len(out) <= size:
        control = source[k]
        k += 1
        if control < 32:
            out += source[k : k + control + 1]
            k += control + 1
            continue
        length = control >> 5
        if length == 7:
            length += source[k] if k < packed else 0
            k += 1
        back = ((control & 31) << 8 | (source[k] if k < packed else 0)) + 1
        k += 1
        length += 2
        if back > len(out):
            break
        run = out[len(out) - back :][:length]
        out += (run * (length // len(run) + 1))[:length]
    if len(out) != size:
        raise DataError("its compressed points are damaged", path)
    return bytes(out)
