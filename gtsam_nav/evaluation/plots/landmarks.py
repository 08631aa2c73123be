"""Landmarks on the plan view: as estimated, with what the estimate says of itself, as surveyed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gtsam_nav.evaluation.plots.style import INK, REFERENCE
from gtsam_nav.mission import LandmarkMap
from gtsam_nav.solution import LandmarkEstimates

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DRAWN_SIGMAS = 3
MOST_NAMED = 60
"""Landmarks that are drawn with their number; more would hide each other."""


@dataclass(frozen=True)
class DrawnLandmarks:
    """Landmarks where they are drawn, in the colour of the method that found them."""

    landmarks: LandmarkEstimates
    colour: str


def draw_landmarks(ax: Axes, drawn: DrawnLandmarks) -> None:
    """Crosses with their 3-sigma ellipses and numbers."""
    from matplotlib.collections import EllipseCollection

    ids, (n, e, _) = drawn.landmarks.id, drawn.landmarks.p_n.T
    variance, axes = np.linalg.eigh(drawn.landmarks.cov_n[:, :2, :2])
    minor, major = 2 * DRAWN_SIGMAS * np.sqrt(np.maximum(variance, 0.0)).T
    counter_clockwise_from_east = np.degrees(np.arctan2(axes[:, 0, 1], axes[:, 1, 1]))
    ax.add_collection(
        EllipseCollection(
            major,
            minor,
            counter_clockwise_from_east,
            units="xy",
            offsets=np.column_stack([e, n]),
            transOffset=ax.transData,
            facecolors="none",
            edgecolors=drawn.colour,
            linewidths=0.9,
        )
    )
    ax.plot(
        e,
        n,
        "+",
        color=drawn.colour,
        markersize=6,
        label=f"landmarks, {DRAWN_SIGMAS} sigma ({len(ids)})",
    )
    if len(ids) <= MOST_NAMED:
        for name, east, north in zip(ids, e, n, strict=True):
            ax.annotate(
                f"{name:d}",
                (east, north),
                xytext=(4, 4),
                textcoords="offset points",
                fontsize=7,
                color=INK,
            )


def draw_survey(ax: Axes, survey: LandmarkMap) -> None:
    """Open squares where the landmarks were surveyed."""
    n, e, _ = survey.p_n.T
    ax.plot(
        e,
        n,
        "s",
        color=REFERENCE,
        markerfacecolor="none",
        markersize=7,
        markeredgewidth=0.8,
        label="surveyed landmarks",
    )
