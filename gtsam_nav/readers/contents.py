"""What a file of many streams holds, for those who must choose among them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Stream:
    """One stream of a file.

    Attributes
    ----------
    name, type : str
        Topic and message type of a bag, file and columns of CSV.
    n_messages : int or None
        None where they were not counted.
    rate_hz : float or None
        Of the median interval; None where it was not looked at.
    could_be : tuple of str
        Types of sensor that it can be read as; what is said in brackets is needed for it.
    clock : str
        Header against log time.
    """

    name: str
    type: str
    n_messages: int | None
    rate_hz: float | None
    could_be: tuple[str, ...]
    clock: str


@dataclass(frozen=True)
class Contents:
    """All streams, and a card that chooses among them (YAML), ready to be edited."""

    streams: tuple[Stream, ...]
    card: str
