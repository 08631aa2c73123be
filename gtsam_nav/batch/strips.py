"""Distributions as SVG: a row a variant, a dot a run, a box over its quartiles."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from xml.etree.ElementTree import Element

import numpy as np

from gtsam_nav.batch.markup import element
from gtsam_nav.frames import Array

WIDTH, ROW, MARGIN, LABEL = 1060, 34, 26, 300
"""Pixels; names stand left of ``LABEL``."""


def strip_chart(values: Mapping[str, Sequence[tuple[str, float]]]) -> Element | None:
    """Values by variant on a common logarithmic axis; each dot tells its mission.

    Parameters
    ----------
    values : mapping of str to sequence of (str, float)
        Mission and value, by the variant's name. What is not positive is left out.

    Returns
    -------
    Element or None
        None without a value.
    """
    kept = {name: [(m, v) for m, v in pairs if v > 0.0] for name, pairs in values.items()}
    everything = [v for pairs in kept.values() for _, v in pairs]
    if not everything:
        return None
    axis = _LogAxis(everything)
    height = ROW * len(kept) + 2 * MARGIN
    ticks = [piece for tick in axis.ticks for piece in _tick(axis, tick, height)]
    rows = [
        piece
        for k, (name, pairs) in enumerate(kept.items())
        for piece in _row(axis, MARGIN + ROW * (k + 0.5), name, pairs)
    ]
    return element("svg", *ticks, *rows, viewBox=f"0 0 {WIDTH} {height}", class_="strips")


class _LogAxis:
    """Maps values to pixels, and knows round values in between."""

    def __init__(self, values: Sequence[float]) -> None:
        low, high = math.log10(min(values)), math.log10(max(values))
        spare = max(0.05 * (high - low), 0.05)
        self._low, self._high = low - spare, high + spare

    def __call__(self, value: float) -> float:
        share = (math.log10(value) - self._low) / (self._high - self._low)
        return LABEL + share * (WIDTH - LABEL - MARGIN)

    @property
    def ticks(self) -> list[float]:
        decades = range(math.floor(self._low), math.ceil(self._high) + 1)
        steps = (1.0, 2.0, 5.0) if self._high - self._low < 3.0 else (1.0,)
        round_values = [step * 10.0**decade for decade in decades for step in steps]
        return [v for v in round_values if self._low <= math.log10(v) <= self._high]


def _tick(axis: _LogAxis, value: float, height: float) -> list[Element]:
    x = f"{axis(value):.1f}"
    line = element("line", x1=x, x2=x, y1=MARGIN, y2=height - MARGIN, class_="tick")
    return [line, element("text", f"{value:g}", x=x, y=height - 8, text_anchor="middle")]


def _row(axis: _LogAxis, y: float, name: str, pairs: Sequence[tuple[str, float]]) -> list[Element]:
    label = element("text", name, x=LABEL - 14, y=f"{y + 4:.1f}", text_anchor="end", class_="name")
    if not pairs:
        return [label]
    values: Array = np.array([value for _, value in pairs])
    low, middle, high = (axis(v) for v in np.percentile(values, (25, 50, 75)))
    box = element(
        "rect",
        x=f"{low:.1f}",
        y=f"{y - 10:.1f}",
        width=f"{high - low:.1f}",
        height=20,
        class_="box",
    )
    median = element(
        "line",
        x1=f"{middle:.1f}",
        x2=f"{middle:.1f}",
        y1=f"{y - 10:.1f}",
        y2=f"{y + 10:.1f}",
        class_="median",
    )
    dots = (
        element(
            "circle",
            element("title", f"{mission}: {value:.3g}"),
            cx=f"{axis(value):.1f}",
            cy=f"{y + 6 * math.sin(2.4 * k):.1f}",  # off the line, so that equals do not hide
            r=3,
        )
        for k, (mission, value) in enumerate(pairs)
    )
    return [label, box, median, *dots]
