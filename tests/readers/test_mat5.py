"""MATLAB 5 files: what SciPy writes is read back, and archives in them are bounded."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from gtsam_nav.errors import DataError
from gtsam_nav.readers import _mat5
from gtsam_nav.readers._mat5 import read_tables

TABLES: dict[str, Any] = {
    "DR": np.arange(12.0).reshape(4, 3),
    "small": np.array([[1, 2]], dtype=np.uint8),
    "a_name_that_takes_more_than_eight_bytes": np.array([[1.5]], dtype=np.float32),
}


@pytest.mark.parametrize("packed", [False, True])
def test_tables_are_read_back(tmp_path: Path, packed: bool) -> None:
    others = {"word": "text", "cells": np.array([1, "a"], dtype=object), "s": {"x": 1.0}}
    savemat(tmp_path / "x.mat", {**others, **TABLES}, do_compression=packed)
    read = read_tables(tmp_path / "x.mat")
    assert read.keys() == TABLES.keys()
    for name, table in TABLES.items():
        np.testing.assert_array_equal(read[name], table)


def test_a_file_in_the_other_byte_order_is_read(tmp_path: Path) -> None:
    def element(kind: int, data: bytes) -> bytes:
        return struct.pack(">II", kind, len(data)) + data + bytes(-len(data) % 8)

    parts = (
        element(6, struct.pack(">II", 6, 0)),
        element(5, struct.pack(">ii", 1, 2)),
        element(1, b"DR"),
        element(9, struct.pack(">dd", 3.0, 4.0)),
    )
    header = b"MATLAB 5.0".ljust(124) + b"\x01\x00MI"
    (tmp_path / "x.mat").write_bytes(header + element(14, b"".join(parts)))
    np.testing.assert_array_equal(read_tables(tmp_path / "x.mat")["DR"], [[3.0, 4.0]])


def test_a_variable_that_unpacks_without_end_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_mat5, "MAX_MATRIX_BYTES", 100_000)
    packed = zlib.compress(struct.pack("<II", 14, 10_000_000) + bytes(10_000_000))
    header = b"MATLAB 5.0".ljust(124) + b"\x00\x01IM"
    (tmp_path / "x.mat").write_bytes(header + struct.pack("<II", 15, len(packed)) + packed)
    with pytest.raises(DataError, match="a variable holds more than 100000 bytes"):
        read_tables(tmp_path / "x.mat")


@pytest.mark.parametrize(
    "tail",
    [
        b"\x0e\x00\x00\x00\xff\xff\xff\xff",
        b"\x0f\x00\x00\x00\x04\x00\x00\x00oops",
        b"\x0f\x00\x00\x00\x00\x00\x00\x00",
    ],
)
def test_damage_is_named_or_leaves_nothing(tmp_path: Path, tail: bytes) -> None:
    (tmp_path / "x.mat").write_bytes(b"MATLAB 5.0".ljust(124) + b"\x00\x01IM" + tail)
    try:
        assert read_tables(tmp_path / "x.mat") == {}
    except DataError as error:
        assert "not readable as a MATLAB file" in str(error)  # noqa: PT017
