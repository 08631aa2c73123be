"""The grammar of fault specifications: ``gnss:outliers=0.3,size=20:100,burst=5`` and the like.

::

    SENSOR:outliers=SHARE[,size=FROM:TO][,burst=N][,coherent]   fixes of a GNSS receiver; sizes in m
    SENSOR:drop=SHARE                                           samples at random
    SENSOR:drop=FROM:TO      SENSOR:gap=FROM:TO                 all samples of a span, s
    SENSOR:bias=DEG[@FROM:TO]                                   of a compass, for good or for a span
    clock:SENSOR=SECONDS                                        added to its stamps
    loops:false=SHARE[,group=N]                                 loop closures, N that agree

SENSOR is a sensor's name or a type of sensors, ``sonar`` a scanning sonar of either type.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TypeVar

from gtsam_nav.errors import ConfigError
from gtsam_nav.simulation.faults import (
    ClockOffset,
    Dropout,
    FalseLoops,
    Fault,
    HeadingBias,
    Outliers,
    Silence,
    Span,
)

T = TypeVar("T")

CLOCK = "clock"
CHOICES = (
    "SENSOR:outliers=SHARE[,size=FROM:TO][,burst=N][,coherent]",
    "SENSOR:drop=SHARE",
    "SENSOR:drop=FROM:TO",
    "SENSOR:gap=FROM:TO",
    "SENSOR:bias=DEG[@FROM:TO]",
    "clock:SENSOR=SECONDS",
    "loops:false=SHARE[,group=N]",
)


def parse_fault(spec: str) -> Fault:
    """Read a fault's specification.

    Raises
    ------
    ConfigError
        Where it is not of the grammar, or a figure is out of range.
    """
    try:
        return _parsed(spec)
    except ValueError as error:
        choices = " ".join(CHOICES)
        raise ConfigError(f"fault '{spec}': {error}; the choices are: {choices}") from None


def _parsed(spec: str) -> Fault:
    target, colon, body = (part.strip() for part in spec.partition(":"))
    first, *more = (item.strip() for item in body.split(","))
    kind, equals, value = (part.strip() for part in first.partition("="))
    if not (target and colon and kind and equals):
        raise ValueError("is not of the form TARGET:FAULT=VALUE")
    options = _options(more)
    if target == CLOCK:
        fault: Fault = ClockOffset(kind, _number(value))
    elif target == FalseLoops.TARGET:
        if kind != "false":
            raise ValueError(f"loops have no '{kind}'")
        fault = FalseLoops(_share(value), _take(options, "group", _count, 1))
        if fault.share == 1.0:
            raise ValueError("false loops come among true ones: their share must be below 1")
    elif kind in _SENSOR_FAULTS:
        fault = _SENSOR_FAULTS[kind](target, value, options)
    else:
        raise ValueError(f"unknown fault '{kind}'")
    if options:
        raise ValueError(f"{kind} takes no '{next(iter(options))}'")
    return fault


def _outliers(target: str, value: str, options: dict[str, str]) -> Outliers:
    fault = Outliers(
        target,
        _share(value),
        size_m=_take(options, "size", _sizes, Outliers.size_m),
        burst=_take(options, "burst", _count, 1),
        coherent=_take(options, "coherent", _flag, False),
    )
    if fault.size_m[0] < 0:
        raise ValueError("a size must not be negative")
    return fault


def _drop(target: str, value: str, _options: dict[str, str]) -> Silence | Dropout:
    if ":" in value:
        return Silence(target, _span(value))
    return Dropout(target, _share(value))


def _gap(target: str, value: str, _options: dict[str, str]) -> Silence:
    return Silence(target, _span(value), "gap")


def _bias(target: str, value: str, _options: dict[str, str]) -> HeadingBias:
    bias_deg, at, window = value.partition("@")
    return HeadingBias(target, _number(bias_deg), _span(window) if at else None)


_SENSOR_FAULTS: Mapping[str, Callable[[str, str, dict[str, str]], Fault]] = {
    "outliers": _outliers,
    "drop": _drop,
    "gap": _gap,
    "bias": _bias,
}
"""What a sensor can suffer; each takes its options out of those given."""


def _options(items: list[str]) -> dict[str, str]:
    """``key=value`` items by key; a bare key has an empty value."""
    found: dict[str, str] = {}
    for item in items:
        key, _, value = (part.strip() for part in item.partition("="))
        if not key or key in found:
            raise ValueError(f"'{item}' is empty or said twice")
        found[key] = value
    return found


def _take(options: dict[str, str], key: str, read: Callable[[str], T], absent: T) -> T:
    """The value of an option, which is then dealt with."""
    return read(options.pop(key)) if key in options else absent


def _flag(text: str) -> bool:
    if text:
        raise ValueError(f"a flag takes no value, but has '{text}'")
    return True


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"'{text}' is not a number")
    return value


def _share(text: str) -> float:
    value = _number(text)
    if not 0.0 <= value <= 1.0:
        raise ValueError(f"the share is {text}; it must lie in [0, 1]")
    return value


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise ValueError(f"'{text}' is not a whole number above zero")
    return int(text)


def _sizes(text: str) -> Span:
    """As a span, but that both ends may be the same."""
    smallest, _, largest = text.partition(":")
    same = _number(smallest) == _number(largest)
    return (_number(smallest), _number(largest)) if same else _span(text)


def _span(text: str) -> Span:
    start, _, stop = text.partition(":")
    span = _number(start), _number(stop)
    if not span[0] < span[1]:
        raise ValueError(f"the span {text} is empty; it is FROM:TO")
    return span
