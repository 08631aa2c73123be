"""Tables of numbers in MATLAB 5 files, plain or compressed; other variables are passed over.

Source: MathWorks, MAT-File Format, "Level 5 MAT-File Format".
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.readers._bytes import read_bytes

HEADER_BYTES, MAGIC = 128, b"MATLAB 5.0"
ORDERS = {b"IM": "<", b"MI": ">"}
MATRIX, COMPRESSED = 14, 15
NUMBERS = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
NUMERIC_CLASSES = range(6, 16)
"""From double to uint64; before them are cells, structures, objects, text and sparse matrices."""
MAX_MATRIX_BYTES = 100_000_000


@dataclass(frozen=True)
class _Element:
    kind: int
    contents: bytes


def read_tables(path: Path) -> dict[str, Array]:
    """The two-dimensional numeric variables of a file by name.

    Raises
    ------
    DataError
        Where the file is none of MATLAB 5, cut off, or larger than is plausible.
    """
    data = read_bytes(path)
    order = ORDERS.get(data[126:HEADER_BYTES])
    if not data.startswith(MAGIC) or order is None:
        raise DataError("not readable as a MATLAB file: its header is not that of MATLAB 5", path)
    tables: dict[str, Array] = {}
    try:
        for element in _elements(data[HEADER_BYTES:], order):
            found = _matrix(element, order)
            if found is not None:
                tables[found[0]] = found[1]
    except ValueError as error:
        raise DataError(f"not readable as a MATLAB file: {error}", path) from error
    return tables


def _elements(data: bytes, order: str) -> Iterator[_Element]:
    """The elements that stand one behind the other, each with a tag of kind and size."""
    place = 0
    while place + 8 <= len(data):
        first, second = (int(x) for x in np.frombuffer(data, f"{order}u4", 2, place))
        # an element of up to four bytes stands in its own tag
        small = first >> 16
        kind, size, begin = (
            (first & 0xFFFF, small, place + 4) if small else (first, second, place + 8)
        )
        if begin + size > len(data) or (small and size > 4):
            raise ValueError("it is cut off")
        yield _Element(kind, data[begin : begin + size])
        end = begin + size
        place = end if kind == COMPRESSED else end + -end % 8


def _matrix(element: _Element, order: str) -> tuple[str, Array] | None:
    """Name and table of an element; None of what is no table of numbers."""
    if element.kind == COMPRESSED:
        element = next(_elements(_unpacked(element.contents), order), _Element(0, b""))
    if element.kind != MATRIX:
        return None
    parts = []
    for part in _elements(element.contents, order):
        parts.append(part)
        if len(parts) == 4:  # an imaginary part is not asked for
            break
    if len(parts) < 4 or len(parts[0].contents) < 4:
        return None
    flags, shape, name, real = parts
    matrix_class = int(np.frombuffer(flags.contents, f"{order}u4", 1)[0]) & 0xFF
    if matrix_class not in NUMERIC_CLASSES or real.kind not in NUMBERS:
        return None
    rows_columns = _numbers(shape, order)
    values = _numbers(real, order).astype(float)
    if len(rows_columns) != 2 or np.prod(rows_columns.astype(float)) != len(values):
        return None
    text = name.contents.decode("latin-1")
    return text, values.reshape(rows_columns.astype(int), order="F")


def _numbers(element: _Element, order: str) -> Array:
    kind = np.dtype(f"{order}{NUMBERS.get(element.kind, 'u1')}")
    whole = len(element.contents) // kind.itemsize
    return np.frombuffer(element.contents, kind, whole)


def _unpacked(contents: bytes) -> bytes:
    stream = zlib.decompressobj()
    try:
        data = stream.decompress(contents, MAX_MATRIX_BYTES)
    except zlib.error as error:
        raise ValueError(f"a compressed variable is damaged: {error}") from error
    if stream.unconsumed_tail:
        raise ValueError(f"a variable holds more than {MAX_MATRIX_BYTES} bytes")
    return data
