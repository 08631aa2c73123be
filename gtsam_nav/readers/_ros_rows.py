"""From the numbers of messages to series."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gtsam_nav.frames import FLU_FROM_FRD, Array
from gtsam_nav.mission import Rejection
from gtsam_nav.preprocess.cleaning import screen, tidy
from gtsam_nav.readers._ros_dialects import Columns
from gtsam_nav.readers._ros_messages import Sample
from gtsam_nav.readers._ros_mounting import Mounting
from gtsam_nav.readers.layout import LAYOUTS
from gtsam_nav.series import BeamSeries, BoolArray, ScanSeries, Series

Cleaned = tuple[Series | None, list[Rejection]]


@dataclass
class Rows:
    """Messages of one sensor as they come: their numbers, or why there are none."""

    samples: list[Sample | None] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)

    def add(self, sample: Sample | str) -> None:
        """One message."""
        self.samples.append(None if isinstance(sample, str) else sample)
        self.reasons.append(sample if isinstance(sample, str) else "")

    def refused(self) -> dict[str, BoolArray]:
        """Messages without numbers, by reason."""
        reasons = np.array(self.reasons, dtype=object)
        return {reason: reasons == reason for reason in sorted({*self.reasons} - {""})}

    def objects(self, name: str) -> list[Any]:
        """What one key of the samples holds; None where there is no sample."""
        return [None if sample is None else sample[name] for sample in self.samples]

    def stacked(self, names: Sequence[str] | None = None) -> Columns:
        """The samples' numbers, one row a message, NaN where there are none."""
        first = next((sample for sample in self.samples if sample is not None), {})
        columns: Columns = {}
        for name in names if names is not None else first:
            shape = np.shape(first.get(name, 0.0))
            values = np.full((len(self.samples), *shape), np.nan)
            for k, sample in enumerate(self.samples):
                if sample is not None:
                    values[k] = sample[name]
            columns[name] = values
        return columns


def with_usual_noise(kind: str, columns: Columns, noise: Any) -> Columns:
    """The columns with the noise model's sigma where a message states none."""
    filled = dict(columns)
    for spec in LAYOUTS[kind]:
        if not spec.noise or spec.series not in filled:
            continue
        usual = np.array([getattr(noise, figure) for figure in spec.noise], dtype=float)
        usual = np.radians(usual) if spec.degrees else usual
        values = filled[spec.series]
        filled[spec.series] = np.where(
            np.isnan(values), usual if values.ndim > 1 else usual[0], values
        )
    return filled


def beams(name: str, t: Array, rows: Rows) -> Cleaned:
    """Beams of the commonest number of bins and range; a series holds but one."""
    columns = rows.stacked(("angle", "range_m"))
    echoes = rows.objects("intensity")
    bins = np.array([0 if e is None else len(e) for e in echoes])
    kinds = Counter(
        (int(bins[k]), float(columns["range_m"][k])) for k in np.flatnonzero(bins).tolist()
    )
    if not kinds:
        n_bins, range_m = 1, 1.0
    else:
        n_bins, range_m = min(kinds, key=lambda kind: (-kinds[kind], kind))
    odd = (bins > 0) & ((bins != n_bins) | (columns["range_m"] != range_m))
    intensity = np.zeros((len(t), n_bins), dtype=np.uint8)
    for k in np.flatnonzero((bins > 0) & ~odd).tolist():
        intensity[k] = echoes[k]
    return tidy(
        BeamSeries,
        name,
        {"t": t, "angle": columns["angle"], "intensity": intensity},
        refused={**rows.refused(), "another range or number of bins": odd},
        resolution_m=range_m / n_bins,
    )


def scans(name: str, t: Array, rows: Rows, mounting: Mounting) -> Cleaned:
    R_bs, xyz_b = mounting
    kept, rejections = screen(ScanSeries, name, {"t": t}, refused=rows.refused())
    if not len(kept):
        return None, rejections
    points = rows.objects("points")
    seen = [(points[k] @ FLU_FROM_FRD @ R_bs.T + xyz_b)[:, :2] for k in kept]
    first = np.concatenate([[0], np.cumsum([len(p) for p in seen])]).astype(np.int64)
    series = ScanSeries(t=t[kept], row=kept, first=first, points_b=np.concatenate(seen))
    return series, rejections
