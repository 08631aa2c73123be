"""A bound on what the chunks of bags unpack to: `rosbags` unpacks whatever they hold.

A few kilobytes of bzip2 become gigabytes. Recorders write chunks of up to some megabytes.
"""

from __future__ import annotations

import bz2
from collections.abc import Callable
from typing import Any

MAX_CHUNK_BYTES = 256 * 1024**2


def bound_chunks() -> None:
    """Let `rosbags` refuse a chunk that unpacks to more than `MAX_CHUNK_BYTES`."""
    from lz4.frame import LZ4FrameDecompressor
    from rosbags.rosbag1 import reader as ros1
    from rosbags.rosbag2 import storage_mcap as mcap

    ros1.decompressors |= {
        "bz2": lambda data: unpacked(bz2.BZ2Decompressor, data),
        "lz4": lambda data: unpacked(LZ4FrameDecompressor, data),
    }
    mcap.DECOMPRESSORS["lz4"] = lambda data, _size: unpacked(LZ4FrameDecompressor, data)
    zstd: Any = vars(mcap)["zstd"]  # of the standard library, or its backport
    mcap.DECOMPRESSORS["zstd"] = lambda data, _size: unpacked(zstd.ZstdDecompressor, data)


def unpacked(make: Callable[[], Any], data: bytes) -> bytes:
    """The contents of a compressed chunk, by what makes a decompressor.

    Raises
    ------
    ValueError
        Where it is cut off, or larger than is plausible.
    """
    unpacker = make()
    contents: bytes = unpacker.decompress(data, MAX_CHUNK_BYTES)
    if unpacker.eof:
        return contents
    if len(contents) >= MAX_CHUNK_BYTES:
        raise ValueError(f"a chunk unpacks to more than {MAX_CHUNK_BYTES} bytes")
    raise ValueError("a compressed chunk is cut off")
