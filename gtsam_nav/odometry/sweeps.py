"""The clouds of a mission as an odometry takes them: in body axes, timed by their last point."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Rejection, Sensor
from gtsam_nav.readers.clouds import load
from gtsam_nav.series import CloudSeries


@dataclass(frozen=True)
class Sweep:
    """A cloud in body axes.

    Attributes
    ----------
    t : float
        When its last point was taken, s.
    points_b : ndarray, shape (k, 3)
        At their own times, m.
    offset_s : ndarray, shape (k,), or None
        These times after some stamp, where they are known, s.
    index : int
        Of the cloud in its series.

    Raises
    ------
    ValueError
        Where a point or a time is not finite.
    """

    t: float
    points_b: Array
    offset_s: Array | None = None
    index: int = 0

    def __post_init__(self) -> None:
        for values in (self.points_b, self.offset_s):
            if values is not None and not np.all(np.isfinite(values)):
                raise ValueError("a point or its time is not finite")

    @property
    def span_s(self) -> float:
        """How long it took, as far as the times tell; zero of a cloud that cannot be deskewed."""
        return 0.0 if self.offset_s is None else float(np.ptp(self.offset_s))


def usable_sweeps(
    sensor: Sensor, has_enough: Callable[[Array], bool], rejections: list[Rejection]
) -> Iterator[Sweep]:
    """The clouds of a sensor one after the other; why others are none is added to the rejections.

    Parameters
    ----------
    sensor : Sensor
        With 3-D clouds.
    has_enough : callable
        Whether points (k, 3) in body axes are enough to be placed.
    rejections : list of Rejection
    """
    series = sensor.series
    assert isinstance(series, CloudSeries)
    last = -np.inf
    for k in range(len(series)):
        t = float(series.t[k])
        try:
            sweep = _sweep(sensor, series, k)
        except DataError as error:
            reason = str(error)
        else:
            t, reason = sweep.t, _fault(sweep, has_enough, last)
        if reason:
            rejections.append(Rejection(t, sensor.name, int(series.row[k]), reason))
            continue
        last = t
        yield sweep


def _sweep(sensor: Sensor, series: CloudSeries, k: int) -> Sweep:
    cloud = load(series.clouds[k])
    points_b = np.asarray(cloud.points_s.astype(float) @ sensor.R_bs.T + sensor.xyz_b)
    if cloud.offset_s is None or not len(cloud):
        return Sweep(float(series.t[k]), points_b, index=k)
    offset_s = cloud.offset_s.astype(float)
    return Sweep(float(series.t[k]) + float(offset_s.max()), points_b, offset_s, k)


def _fault(sweep: Sweep, has_enough: Callable[[Array], bool], last: float) -> str:
    """Why a cloud cannot be placed; empty where it can."""
    if not has_enough(sweep.points_b):
        return "a cloud of too few points in range"
    return "a cloud that ends before the one before it" if sweep.t <= last else ""
