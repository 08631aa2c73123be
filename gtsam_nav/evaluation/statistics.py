"""Errors of a trajectory in figures: statistics by alignment, relative errors by length."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from pydantic import Field

from gtsam_nav.evaluation.relative import RelativeError
from gtsam_nav.frames import Array


@dataclass(frozen=True, kw_only=True)
class ErrorStatistics:
    """Statistics of errors that are not negative, in their unit."""

    mean: float
    rmse: float
    median: float
    std: float
    min: float
    max: float
    p95: float

    @classmethod
    def of(cls, errors: Array, **more: float) -> Self:
        """Statistics of errors of shape (m,), m > 0."""
        return cls(
            mean=float(np.mean(errors)),
            rmse=float(np.sqrt(np.mean(errors**2))),
            median=float(np.median(errors)),
            std=float(np.std(errors)),
            min=float(np.min(errors)),
            max=float(np.max(errors)),
            p95=float(np.percentile(errors, 95)),
            **more,
        )


@dataclass(frozen=True, kw_only=True)
class StartStatistics(ErrorStatistics):
    """Errors after the initial stretch of ``stretch_s`` that was fitted."""

    stretch_s: float


@dataclass(frozen=True, kw_only=True)
class Se2Statistics(ErrorStatistics):
    """Errors after the SE(2) fit, with the ``determinant`` of its rotation: never a reflection."""

    determinant: float


@dataclass(frozen=True, kw_only=True)
class AbsoluteErrors:
    """Absolute trajectory error (m) by alignment; None where it cannot be told."""

    none: ErrorStatistics | None = None
    start: StartStatistics | None = None
    se2: Se2Statistics | None = None
    se3: ErrorStatistics | None = None


@dataclass(frozen=True, kw_only=True)
class RelativeErrors:
    """Relative error over 10 m, 50 m and a tenth of the path; None where the path is shorter."""

    per_10_m: Annotated[RelativeError | None, Field(alias="10_m")] = None
    per_50_m: Annotated[RelativeError | None, Field(alias="50_m")] = None
    per_10_percent: Annotated[RelativeError | None, Field(alias="10_percent")] = None
