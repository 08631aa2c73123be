"""Faults of sensors, and what each does to a sensor's samples.

A fault changes what a sensor reports and nothing that it says of itself: the estimator has to find
out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from gtsam_nav.errors import ConfigError
from gtsam_nav.frames import wrap_angle
from gtsam_nav.series import GnssSeries, HeadingSeries, IntArray, Series

Span = tuple[float, float]


@dataclass(frozen=True)
class SensorFault:
    """A fault of every sensor that ``target`` names, or is the type of."""

    target: str

    def __str__(self) -> str:
        """The specification that `parse_fault` reads as this fault."""
        raise NotImplementedError

    def altered(self, series: Series, rng: np.random.Generator) -> Series:
        """What the faulty sensor reports instead of a series."""
        raise NotImplementedError


@dataclass(frozen=True)
class Outliers(SensorFault):
    """Horizontal offsets of GNSS fixes, ``target:outliers=share[,size=a:b][,burst=n][,coherent]``.

    The share of the fixes is met to the nearest fix. Sizes are uniform in their interval,
    directions uniform over the compass; height, velocity and stated sigma stay. Offsets in a burst
    are independent, as those of a receiver that takes up wrong satellites anew at each fix.
    With ``coherent`` one offset lasts for the burst, as that of a reflecting wall does for as long
    as the geometry lasts: then the fixes of a burst agree among themselves.

    Attributes
    ----------
    share : float
        Of all fixes.
    size_m : (float, float)
        Smallest and largest offset.
    burst : int
        How many successive fixes are offset at a time.
    coherent : bool
    """

    share: float
    size_m: Span = (20.0, 100.0)
    burst: int = 1
    coherent: bool = False

    def __str__(self) -> str:
        size = f"size={_text(self.size_m[0])}:{_text(self.size_m[1])}"
        together = ",coherent" if self.coherent else ""
        share = f"outliers={_text(self.share)}"
        return f"{self.target}:{share},{size},burst={self.burst}{together}"

    def altered(self, series: Series, rng: np.random.Generator) -> GnssSeries:
        """The fixes, some of them offset."""
        if not isinstance(series, GnssSeries):
            raise ConfigError(f"'{self}': outliers are of gnss; '{self.target}' is {series.TYPE}")
        burst = bursts_of(len(series), round(self.share * len(series)), self.burst, rng)
        hit = np.flatnonzero(burst >= 0)
        drawn = burst[hit] if self.coherent else np.arange(len(hit))
        n = int(drawn.max(initial=-1)) + 1
        size, angle = rng.uniform(*self.size_m, size=n), rng.uniform(0.0, 2 * np.pi, size=n)
        offset_n = size[:, None] * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
        p_n = series.p_n.copy()
        p_n[hit] += offset_n[drawn]
        return replace(series, p_n=p_n)


@dataclass(frozen=True)
class Dropout(SensorFault):
    """A share of the samples never arrives, each at random: ``target:drop=share``."""

    share: float

    def __str__(self) -> str:
        return f"{self.target}:drop={_text(self.share)}"

    def altered(self, series: Series, rng: np.random.Generator) -> Series:
        """The samples that arrive."""
        return series.select(rng.uniform(size=len(series)) >= self.share)


@dataclass(frozen=True)
class Silence(SensorFault):
    """No sample in a half-open span of mission time, s: ``target:drop=from:to``, or ``gap``."""

    window_s: Span
    word: Literal["drop", "gap"] = "drop"

    def __str__(self) -> str:
        return f"{self.target}:{self.word}={_span_text(self.window_s)}"

    def altered(self, series: Series, rng: np.random.Generator) -> Series:
        """The samples outside the span."""
        del rng
        return series.select((series.t < self.window_s[0]) | (series.t >= self.window_s[1]))


@dataclass(frozen=True)
class HeadingBias(SensorFault):
    """A compass that is wrong for a span, or for good: ``target:bias=degrees[@from:to]``."""

    bias_deg: float
    window_s: Span | None = None

    def __str__(self) -> str:
        when = "" if self.window_s is None else f"@{_span_text(self.window_s)}"
        return f"{self.target}:bias={_text(self.bias_deg)}{when}"

    def altered(self, series: Series, rng: np.random.Generator) -> HeadingSeries:
        """The headings, turned clockwise by the bias."""
        del rng
        if not isinstance(series, HeadingSeries):
            raise ConfigError(f"'{self}': a bias is of heading; '{self.target}' is {series.TYPE}")
        start, stop = self.window_s or (-np.inf, np.inf)
        wrong = (series.t >= start) & (series.t < stop)
        turn = np.where(wrong, np.radians(self.bias_deg), 0.0)
        return replace(series, heading=wrap_angle(series.heading + turn))


@dataclass(frozen=True)
class ClockOffset(SensorFault):
    """A clock that is fast: seconds added to every stamp, ``clock:target=seconds``."""

    offset_s: float

    def __str__(self) -> str:
        return f"clock:{self.target}={_text(self.offset_s)}"

    def altered(self, series: Series, rng: np.random.Generator) -> Series:
        """The samples with wrong stamps."""
        del rng
        return series.shift(self.offset_s)


@dataclass(frozen=True)
class FalseLoops:
    """False loop closures, ``loops:false=share[,group=n]``: no sensor's fault, but the graph's own.

    Attributes
    ----------
    share : float
        Of all closures, the false ones included.
    group : int
        How many of them agree with each other.
    """

    TARGET: ClassVar[str] = "loops"

    share: float
    group: int = 1

    def __str__(self) -> str:
        return f"{self.TARGET}:false={_text(self.share)},group={self.group}"


Fault = SensorFault | FalseLoops


def bursts_of(n: int, count: int, length: int, rng: np.random.Generator) -> IntArray:
    """Spread a number of hits over samples in runs of a length, the last maybe shorter.

    Returns
    -------
    ndarray of int, shape (n,)
        Which run, from zero, hits each sample; -1 for none.
    """
    whole, rest = divmod(count, length)
    runs = [length] * whole + [rest] * (rest > 0)
    pieces = rng.permutation(np.array(runs + [0] * (n - count), dtype=np.int64))
    number = np.where(pieces > 0, np.cumsum(pieces > 0) - 1, -1)
    return np.repeat(number, np.maximum(pieces, 1))


def _text(value: float) -> str:
    """The shortest text that reads back as the same number."""
    return repr(float(value)).removesuffix(".0")


def _span_text(span: Span) -> str:
    return f"{_text(span[0])}:{_text(span[1])}"
