"""Lines of text files: few or many, and what is left of one that was cut off."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from gtsam_nav.errors import DataError
from gtsam_nav.readers._bytes import CUT_OFF, read_chunks

TRUNCATED = "truncated line"


def first_lines(path: Path, count: int) -> list[str]:
    """The first lines of a file, to know it by; none where it cannot be read. Never raises."""
    try:
        if not path.is_file():
            return []
        head = next(iter(read_chunks(path, whole=False)), (b"", 0.0))[0]
    except (DataError, OSError, ValueError):
        return []
    return list(islice(head.decode("latin-1").splitlines(), count))


def stream_lines(path: Path, *, whole: bool = True) -> Iterator[tuple[str, float]]:
    """Line after line of a text file of any size, with the share of it that has been read.

    Bytes that are no UTF-8 are replaced: what they stand in will not be understood; nor will the
    line where an archive is cut off, which ends in ``CUT_OFF`` unless it is to be whole.
    """
    rest = b""
    fraction = 0.0
    for chunk, fraction in read_chunks(path, whole=whole):
        *ended, rest = (rest + chunk).split(b"\n")
        for line in ended:
            yield line.decode("utf-8", "replace").rstrip("\r"), fraction
    if rest:
        yield rest.decode("utf-8", "replace"), fraction


def said_of_end(last_line: str) -> Iterator[str]:
    """What is said of a text whose archive is cut off within its last line."""
    if last_line.endswith(CUT_OFF.decode()):
        yield "the archive is cut off: it is read as far as it goes"


def read_lines(path: Path, encoding: str = "utf-8-sig", *, whole: bool = True) -> list[str]:
    """The lines of a text file; the last is empty where the file ends with a line break.

    Bytes at the file's end that are no text are one line, and are replaced: it will not be
    understood.

    Raises
    ------
    DataError
        Where the file cannot be read, or holds what is no text before its end.
    """
    data = b"".join(chunk for chunk, _ in read_chunks(path, whole=whole))
    if data.endswith(CUT_OFF):
        begin = data.rfind(b"\n") + 1
        if begin == 0:
            raise DataError("the archive is cut off within its first line", path)
        data = data[:begin] + CUT_OFF
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        # a byte order mark is not counted
        start = error.start + len(data) - len(error.object)
        begin = data.rfind(b"\n", 0, start) + 1
        later = data[start:].split(b"\n")[1:]
        if begin == 0 or any(_is_text(line) for line in later):
            what = f"is not {encoding.removesuffix('-sig')} text: {error}"
            raise DataError(what, path, data.count(b"\n", 0, begin) + 1) from error
        damaged = data[begin:].replace(b"\n", b" ").decode("ascii", "replace")
        text = data[:begin].decode(encoding) + damaged
    return text.replace("\r\n", "\n").split("\n")


def _is_text(line: bytes) -> bool:
    """Whether a line holds characters, and no others than those."""
    content = b" ".join(line.split())
    return bool(content) and content.isascii() and content.decode("ascii").isprintable()
