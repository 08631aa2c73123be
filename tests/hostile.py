"""Files as no instrument writes them: damaged, spliced, and made of a sample's own words.

`hostile` turns the files of a sample into such, by the choices of a `random.Random`: hypothesis
hands one out that it can shrink, `benchmarks.fuzz` one that starts from the number of a case.
"""

from __future__ import annotations

import gzip
import io
import re
import zipfile
import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from random import Random

Files = Mapping[str, bytes]
"""Contents by the file's name below the sample's folder."""

TOKEN = re.compile(rb"[^\s,;:*={}\[\]\"]+")

ODD_WORDS: tuple[bytes, ...] = (
    *(b"", b"0", b"-0", b"-1", b"1", b"nan", b"NaN", b"inf", b"-inf", b"1e308", b"-1e308"),
    *(b"1e400", b"5e-324", b"0x1F", b"1_0", b"1.2.3", b"--1", b"+", b".", b"e5", b"1e", b"true"),
    *(b"255", b"256", b"65535", b"2147483648", b"4294967295", b"9223372036854775808"),
    *(b"9" * 400, b"9" * 5000, b"-" + b"8" * 330, b"1" + b"0" * 310, b"#", b"%", b"$", b"null"),
    *(b"\xff\xfe", b"\x00", "ü٣".encode(), b"../../etc/passwd", b"/dev/zero", b"2024-13-40"),
    *(b"&a", b"*a", b"!!python/object:os.system", b"<<", b"- -", b"{}", b"[[", b"'", b'"'),
)  # fmt: skip
BOUNDARIES = (0, 1, -1, 127, 128, 255, 256, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63)

DAMAGED_ARCHIVE = (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, RuntimeError)
"""What opening one raises that was damaged before."""

MOST_BYTES = 400_000
"""No file grows beyond this: what is looked for is not size."""


def hostile(files: Files, random: Random) -> dict[str, bytes]:
    """The files of a sample, one to three times altered."""
    altered = dict(files)
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        if not altered:
            break
        name = random.choice(sorted(altered))
        if random.random() < 0.05:
            _rearrange(altered, name, random)
        else:
            altered[name] = altered_contents(altered[name], files, random)[:MOST_BYTES]
    return altered


def _rearrange(files: dict[str, bytes], name: str, random: Random) -> None:
    """A file that is missing, or that holds what another should."""
    if random.random() < 0.5:
        del files[name]
    else:
        other = random.choice(sorted(files))
        files[name], files[other] = files[other], files[name]


def altered_contents(data: bytes, files: Files, random: Random) -> bytes:
    """One file's contents; the inside of an archive is altered and packed again."""
    if random.random() < 0.6:
        with suppress(*DAMAGED_ARCHIVE):
            if data.startswith(b"PK"):
                return _altered_zip(data, files, random)
            if data.startswith(b"\x1f\x8b"):
                inside = gzip.decompress(data)
                return gzip.compress(altered_contents(inside, files, random), 1, mtime=0)
    alter = random.choice(ON_TEXT if _is_text(data) and random.random() < 0.8 else ON_BYTES)
    return alter(data, files, random)


def _is_text(data: bytes) -> bool:
    return b"\0" not in data[:512]


def _altered_zip(data: bytes, files: Files, random: Random) -> bytes:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    if members:
        name = random.choice(sorted(members))
        members[name] = altered_contents(members[name], files, random)[:MOST_BYTES]
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, contents in members.items():
            archive.writestr(name, contents)
    return packed.getvalue()


def _place(data: bytes, random: Random) -> int:
    return random.randrange(len(data) + 1)


def _span(data: bytes, random: Random) -> tuple[int, int]:
    first = _place(data, random)
    return first, min(len(data), first + random.choice((1, 4, 16, 100, 1000)))


def _flip(data: bytes, _files: Files, random: Random) -> bytes:
    damaged = bytearray(data)
    for _ in range(random.choice((1, 2, 8)) if data else 0):
        damaged[random.randrange(len(data))] ^= 1 << random.randrange(8)
    return bytes(damaged)


def _cut(data: bytes, _files: Files, random: Random) -> bytes:
    place = _place(data, random)
    return random.choice((data[:place], data[place:]))


def _drop(data: bytes, _files: Files, random: Random) -> bytes:
    first, last = _span(data, random)
    return data[:first] + data[last:]


def _repeat(data: bytes, _files: Files, random: Random) -> bytes:
    first, last = _span(data, random)
    return data[:last] + data[first:last] * random.choice((1, 2, 50)) + data[last:]


def _splice(data: bytes, files: Files, random: Random) -> bytes:
    """A piece of another file, or of this one, where it does not belong."""
    other = files[random.choice(sorted(files))]
    first, last = _span(other, random)
    place = _place(data, random)
    return data[:place] + other[first:last] + data[random.choice((place, place + last - first)) :]


def _number(data: bytes, _files: Files, random: Random) -> bytes:
    """A binary number at its bounds, where a length or an offset may stand."""
    size, order = random.choice((1, 2, 4, 8)), random.choice(("little", "big"))
    value = random.choice(BOUNDARIES) % 2 ** (8 * size)
    place = _place(data, random) // size * size
    return data[:place] + value.to_bytes(size, order) + data[place + size :]


def _odd_words(data: bytes, _files: Files, random: Random) -> bytes:
    for _ in range(random.choice((1, 1, 3))):
        words = list(TOKEN.finditer(data))
        if not words:
            return data + random.choice(ODD_WORDS)
        word = random.choice(words)
        data = data[: word.start()] + random.choice(ODD_WORDS) + data[word.end() :]
    return data


def _lines(data: bytes, _files: Files, random: Random) -> bytes:
    """Lines in another order, repeated or left out."""
    lines = data.splitlines(keepends=True)
    if not lines:
        return b"\n"
    k, m = random.randrange(len(lines)), random.randrange(len(lines))
    kind = random.choice(("swap", "drop", "repeat", "reverse", "move to the front"))
    if kind == "swap":
        lines[k], lines[m] = lines[m], lines[k]
    elif kind == "drop":
        del lines[k]
    elif kind == "repeat":
        lines[k:k] = [lines[m]] * random.choice((1, 3, 300))
    elif kind == "reverse":
        lines.reverse()
    else:
        lines.insert(0, lines.pop(k))
    return b"".join(lines)


def _fields(data: bytes, _files: Files, random: Random) -> bytes:
    """A separator too many, or one that is none."""
    separators = list(re.finditer(rb"[,; \t*]", data))
    if not separators:
        return data
    place = random.choice(separators).start()
    return data[:place] + random.choice((b"", b",,", b";", b"\t \t", b"\r")) + data[place + 1 :]


def _invented(data: bytes, files: Files, random: Random) -> bytes:
    """Lines of the file's own shapes, with any of the sample's words in any place."""
    shapes = data.splitlines()[:200] or [b""]
    other = files[random.choice(sorted(files))]
    words = [*TOKEN.findall(data)[:300], *TOKEN.findall(other)[:100], *ODD_WORDS]
    share = random.choice((0.05, 0.3, 1.0))

    def another(match: re.Match[bytes]) -> bytes:
        return random.choice(words) if random.random() < share else match.group()

    head = data.splitlines()[: random.choice((0, 1, 3))]
    body = [TOKEN.sub(another, random.choice(shapes)) for _ in range(random.choice((1, 5, 30)))]
    return b"\n".join([*head, *body]) + random.choice((b"\n", b""))


def _endless(data: bytes, _files: Files, random: Random) -> bytes:
    """A word, a run of blanks or of brackets that does not end."""
    place = _place(data, random)
    return (
        data[:place]
        + random.choice((b"7", b" ", b"\n", b"[", b"{a: ", b"\0")) * 20_000
        + data[place:]
    )


Alteration = Callable[[bytes, Files, Random], bytes]

ON_BYTES: tuple[Alteration, ...] = (
    _flip, _flip, _cut, _drop, _repeat, _splice, _number, _number, _number,
)  # fmt: skip
ON_TEXT: tuple[Alteration, ...] = (
    _odd_words, _odd_words, _odd_words, _lines, _fields, _invented, _invented, _splice, _cut, _flip,
    _endless,
)  # fmt: skip
