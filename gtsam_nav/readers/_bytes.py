"""What files hold, plain, gzipped or bzipped: piece by piece, and never without bounds."""

from __future__ import annotations

import bz2
import zlib
from collections.abc import Iterable, Iterator
from functools import partial
from itertools import chain
from pathlib import Path

from gtsam_nav.errors import DataError

CUT_OFF = b"<archive-cut-off>"
"""What ends the readable part of an archive that a recorder never closed: no field reads so."""

MAX_BYTES = 1024**3
"""Most that a file may hold once it is decompressed."""

CHUNK_BYTES = 1_000_000
MAX_PIECE_BYTES = 4_000_000
"""What is read, and at most decompressed, at a time."""

GZIP_MAGIC, BZIP2_MAGIC = b"\x1f\x8b", b"BZh"


def read_chunks(path: Path, *, whole: bool = True) -> Iterator[tuple[bytes, float]]:
    """The contents of a file piece by piece, decompressed where it is gzipped or bzipped.

    Parameters
    ----------
    path : Path
    whole : bool
        Refuse an archive that is cut off; else ``CUT_OFF`` stands at the end of what is there.

    Yields
    ------
    chunk : bytes
    fraction : float
        How much of the file has been read.

    Raises
    ------
    DataError
        Where the file is missing, unreadable, not whole or absurdly large.
    """
    try:
        size = max(path.stat().st_size, 1)
        with path.open("rb") as stream:
            raw = iter(partial(stream.read, CHUNK_BYTES), b"")
            first = next(raw, b"")
            pieces = chain([first], raw)
            contents: Iterable[bytes] = pieces
            if first.startswith(GZIP_MAGIC):
                contents = _gunzip(pieces, path, whole)
            elif first.startswith(BZIP2_MAGIC):
                contents = _bunzip(pieces, path, whole)
            total = 0
            for chunk in contents:
                total += len(chunk)
                if total > MAX_BYTES:
                    raise DataError(f"holds more than {MAX_BYTES} bytes", path)
                yield chunk, min(stream.tell() / size, 1.0)
    except FileNotFoundError as error:
        raise DataError("no such file", path) from error
    except OSError as error:
        raise DataError(f"cannot be read: {error}", path) from error


def _gunzip(pieces: Iterable[bytes], path: Path, whole: bool) -> Iterator[bytes]:
    member = zlib.decompressobj(wbits=31)
    for piece in pieces:
        compressed = piece
        while compressed:
            if member.eof:  # an archive may hold several members, and padding behind the last
                if not compressed.strip(b"\0"):
                    break
                member = zlib.decompressobj(wbits=31)
            try:
                yield member.decompress(compressed, MAX_PIECE_BYTES)
            except zlib.error as error:
                raise DataError(f"the gzip archive is damaged: {error}", path) from error
            compressed = member.unused_data if member.eof else member.unconsumed_tail
    if not member.eof:
        yield _cut_off("gzip", path, whole)


def _bunzip(pieces: Iterable[bytes], path: Path, whole: bool) -> Iterator[bytes]:
    member = bz2.BZ2Decompressor()
    for piece in pieces:
        compressed = piece
        while compressed or not (member.needs_input or member.eof):
            if member.eof:  # an archive may hold several members
                member = bz2.BZ2Decompressor()
            try:
                yield member.decompress(compressed, MAX_PIECE_BYTES)
            except OSError as error:
                raise DataError(f"the bzip2 archive is damaged: {error}", path) from error
            compressed = member.unused_data if member.eof else b""
    if not member.eof:
        yield _cut_off("bzip2", path, whole)


def _cut_off(kind: str, path: Path, whole: bool) -> bytes:
    if whole:
        raise DataError(f"the {kind} archive is cut off", path)
    return CUT_OFF


def read_bytes(path: Path) -> bytes:
    """The whole contents of a file; raises as `read_chunks` does."""
    return b"".join(chunk for chunk, _ in read_chunks(path))
