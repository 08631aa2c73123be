"""Whose time counts: that of the messages' headers, or that of the bag's log."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

from gtsam_nav.frames import Array
from gtsam_nav.readers._ros_bag import Clock
from gtsam_nav.readers._ros_choice import Choice

Stamp = Literal["header", "log"]

APART_S = 5.0
"""Headers whose clock is further from the others' tell another time."""


def choose_stamps(choices: Iterable[Choice], clocks: dict[str, Clock]) -> dict[str, Stamp]:
    """Header or log, for each sensor by name; what a card states counts.

    A header's time is when the sample was taken, the log's when it was written: the header counts
    where its clock goes with the others'. Sensors without headers live on the log's clock; where
    every sensor has headers that agree, their common distance to the log (a bag that was recorded
    from another) does not matter.
    """
    listed = list(choices)
    lags = {choice.topic.name: clocks[choice.topic.name].lag_s for choice in listed}
    known = [lag for lag in lags.values() if lag is not None]
    on_headers = known and len(known) == len(lags)
    common = _commonest(known) if on_headers else 0.0
    found: dict[str, Stamp] = {}
    for choice in listed:
        lag = lags[choice.topic.name]
        fits = lag is not None and abs(lag - common) <= APART_S
        found[choice.name] = choice.entry.stamp or ("header" if fits else "log")
    return found


def _commonest(lags: list[float]) -> float:
    """The lag that most others are near to; of several such, the one nearest the log."""
    return min(lags, key=lambda own: (-sum(abs(lag - own) <= APART_S for lag in lags), abs(own)))


def stamps_of(clock: Clock, stamp: Stamp) -> Array:
    """The times that count, s since the bag's zero; NaN where a header tells none."""
    if stamp == "header" and clock.header_s is not None:
        return clock.header_s
    return clock.log_s


def clock_text(clock: Clock) -> str:
    """Header against log time, in words."""
    if clock.header_s is None:
        return "log only"
    if clock.lag_s is None:
        return "headers hold no time: log"
    text = f"log {1e3 * clock.lag_s:.1f} ms behind the header, jitter {1e3 * clock.jitter_s:.1f} ms"
    if abs(clock.lag_s) > APART_S:
        text = f"log {clock.lag_s:.1f} s behind the header: another clock"
    if clock.drift_ppm is not None:
        text += f", drift {clock.drift_ppm:.0f} ppm"
    return text


def clock_warnings(choices: Iterable[Choice], clocks: dict[str, Clock]) -> list[str]:
    """What to say of sensors whose headers do not count though they have some."""
    found = []
    stamps = choose_stamps(listed := list(choices), clocks)
    for choice in listed:
        clock = clocks[choice.topic.name]
        if choice.entry.stamp is None and choice.topic.stamped and stamps[choice.name] == "log":
            found.append(
                f"sensor '{choice.name}': its headers are not used ({clock_text(clock)});"
                " 'stamp: header' in a card would"
            )
    return found
