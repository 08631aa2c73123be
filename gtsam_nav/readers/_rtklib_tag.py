"""The time tag that RTKLIB's stream server writes beside a log: which byte came when.

A header of 60 bytes; the tick count of the computer at the start (uint32, ms), the GPS time of the
start (uint32 s since 1970, float64 fraction); then pairs of uint32: ms since the start, bytes of
the log so far. Little endian.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.readers._bytes import read_bytes

MAGIC = b"TIMETAG RTKLIB"
HEADER_BYTES = 60
START = np.dtype([("tick", "<u4"), ("time", "<u4"), ("fraction", "<f8")])
PAIR = np.dtype([("tick", "<u4"), ("offset", "<u4")])

MAX_CLOCK_RATE_ERROR = 0.01
MAX_MISSING_S = 0.5
"""Of the instrument's clock against the computer's, and of its log against the ticks, in lines that
were cut off; more means that the two files do not belong together."""


@dataclass(frozen=True)
class TimeTag:
    """When a log began (GPS time, s since 1970), and the first and last tick behind it (s)."""

    path: Path
    start: float
    first_tick: float
    last_tick: float

    def stamps(self, t_ms: Array, log: Path) -> Array:
        """GPS time of samples with an instrument's own time; NaN where there are no two.

        The instrument's first and last sample are those of the first and last tick.

        Raises
        ------
        DataError
            Where the tag and the log do not span the same time.
        """
        whole = t_ms[np.isfinite(t_ms)]
        if len(whole) < 2:
            return np.full(len(t_ms), np.nan)
        span = float(whole[-1] - whole[0]) / 1e3
        ticked = self.last_tick - self.first_tick
        if not abs(ticked - span) <= MAX_CLOCK_RATE_ERROR * ticked + MAX_MISSING_S:
            raise DataError(
                f"spans {ticked:.1f} s, but {log.name} spans {span:.1f} s: not of one log",
                self.path,
            )
        since_first = (t_ms - whole[0]) * (ticked / (whole[-1] - whole[0]))
        return np.asarray(self.start + self.first_tick + since_first)


def read_time_tag(path: Path) -> TimeTag:
    """Read a time tag, plain or gzipped.

    Raises
    ------
    DataError
        Where the file is no time tag or holds no two ticks.
    """
    data = read_bytes(path)
    if not data.startswith(MAGIC):
        raise DataError(f"is no time tag of RTKLIB: it does not begin with {MAGIC.decode()}", path)
    n_pairs = (len(data) - HEADER_BYTES - START.itemsize) // PAIR.itemsize
    if n_pairs < 2:
        raise DataError("the time tag is cut off: it holds no two ticks", path)
    start = np.frombuffer(data, START, 1, HEADER_BYTES)[0]
    pairs = np.frombuffer(data, PAIR, n_pairs, HEADER_BYTES + START.itemsize)
    if not 0 <= start["fraction"] < 1:
        raise DataError(f"the fraction of the start's second is {start['fraction']}", path)
    if pairs["tick"][-1] <= pairs["tick"][0]:
        raise DataError("the ticks do not increase", path)
    return TimeTag(
        path=path,
        start=float(start["time"]) + float(start["fraction"]),
        first_tick=float(pairs["tick"][0]) / 1e3,
        last_tick=float(pairs["tick"][-1]) / 1e3,
    )
