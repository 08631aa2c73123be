"""Measurements that may be outliers, or whose factors are made anew at each estimate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from gtsam_nav.graph.robust import GatedRobustness
from gtsam_nav.mission import Rejection

StateAt = Callable[[int], Any]
"""Gives the present value of a NavState variable."""

Maker = Callable[[Sequence[int], StateAt], list[Any]]
"""Makes the native factors of some of a sensor's readings, by their rows, at the present states:
many cost little more than one."""


@dataclass(frozen=True)
class Reading:
    """A measurement whose factor is made anew at each estimate, and which may be an outlier.

    Attributes
    ----------
    t, sensor, index : float, str, int
        As in `Rejection`.
    maker : callable
        Makes its native factor, with Gaussian noise, among those of its like.
    row : int
        Which of the maker's it is.
    robustness : GatedRobustness
        When it is an outlier, and the kernel that it keeps in the final solution where it is none.
    reason : str
        What is said of an outlier.
    """

    t: float
    sensor: str
    index: int
    maker: Maker
    row: int
    robustness: GatedRobustness
    reason: str

    @property
    def is_gated(self) -> bool:
        """Whether it may be left out as an outlier."""
        return self.robustness.gate_probability is not None

    def rejection(self, normalised_residual: float) -> Rejection:
        """The record of an outlier."""
        return Rejection(self.t, self.sensor, self.index, self.reason, normalised_residual)


def as_given(given: Sequence[Any]) -> Maker:
    """Of factors that are the same at every estimate."""
    return lambda rows, _: [given[row] for row in rows]


def made(readings: Sequence[Reading], state_at: StateAt) -> list[Any]:
    """The factors of readings at the present states, all of a kind together."""
    alike: dict[int, list[int]] = {}
    for i, reading in enumerate(readings):
        alike.setdefault(id(reading.maker), []).append(i)
    found: list[Any] = [None] * len(readings)
    for members in alike.values():
        rows = [readings[i].row for i in members]
        for i, factor in zip(members, readings[members[0]].maker(rows, state_at), strict=True):
            found[i] = factor
    return found
