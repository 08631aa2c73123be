"""Points of PLY files: the properties of ``element vertex``, ASCII or binary (Turk 1994)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.readers._bytes import read_bytes
from gtsam_nav.readers._rows import number_columns

TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
END = b"end_header"
MAX_HEADER_BYTES = 100_000


def read_ply(path: Path) -> dict[str, Array]:
    """The properties of the vertices by name, each of shape (k,).

    Raises
    ------
    DataError
        Where the file is no PLY, holds less than it states, or does not begin with its vertices.
    """
    data = read_bytes(path)
    end = data.find(END, 0, MAX_HEADER_BYTES)
    start = data.find(b"\n", end) + 1
    if not data.startswith(b"ply") or end < 0 or start == 0:
        raise DataError(f"is no PLY file: no header from 'ply' to '{END.decode()}'", path)
    order, n_points, types = _parse_header(data[:end].decode("latin-1"), path)
    if order is None:
        lines = data[start:].decode("latin-1").split("\n")
        return number_columns(lines, n_points, list(types), path)
    record = np.dtype([(name, order + kind) for name, kind in types.items()])
    if len(data) - start < n_points * record.itemsize:
        raise DataError(f"ends before the {n_points} vertices that its header states", path)
    points = np.frombuffer(data, record, n_points, start)
    return {name: points[name].astype(float) for name in types}


def _parse_header(header: str, path: Path) -> tuple[str | None, int, dict[str, str]]:
    """Byte order (None of text), number of vertices, and the type of each of their properties."""
    order: str | None = None
    n_points = -1
    types: dict[str, str] = {}
    element = ""
    for number, line in enumerate(header.splitlines(), start=1):
        match line.split():
            case ["format", kind, *_] if kind in ORDERS:
                order = ORDERS[kind] or None
            case ["element", "vertex", count] if count.isdecimal() and len(count) < 13:
                if element:
                    raise DataError(
                        f"the vertices come after the element '{element}'", path, number
                    )
                element, n_points = "vertex", int(count)
            case ["element", name, _]:
                element = name
            case ["property", kind, name] if kind in TYPES and name not in types:
                if element == "vertex":
                    types[name] = TYPES[kind]
            case ["property", "list", *_] if element != "vertex":
                continue
            case ["ply"] | ["comment", *_] | ["obj_info", *_] | []:
                continue
            case _:
                raise DataError(f"'{line[:60]}' is not understood", path, number)
    if n_points < 0 or not types:
        raise DataError("states no vertices with properties", path)
    return order, n_points, types
