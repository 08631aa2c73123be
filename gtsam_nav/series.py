"""Samples of one sensor each: a series is a frozen set of equally long columns.

It is validated when it is made: right shapes, finite values, strictly increasing time. Readers tidy
raw columns first (``preprocess.cleaning``), so that each sample that did not make it is a
`Rejection` with a reason.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from gtsam_nav.frames import Array

IntArray = NDArray[np.int64]


BoolArray = NDArray[np.bool_]


def column(*shape: int, dtype: type = float, optional: bool = False) -> Any:
    """A column of a series: one entry of this shape and type a sample."""
    metadata = {"shape": shape, "dtype": dtype, "optional": optional}
    return field(default=None, metadata=metadata) if optional else field(metadata=metadata)


@dataclass(frozen=True, kw_only=True)
class Series:
    """Samples of one sensor in the mission's time.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Seconds since the mission's zero, strictly increasing.
    row : ndarray of int, shape (n,)
        Zero-based sample number in the source file, for `Rejection.index`.

    Raises
    ------
    ValueError
        Where a column has the wrong shape, a value is not finite or time does not increase.
    """

    TYPE: ClassVar[str] = ""
    REPEATED_STAMPS: ClassVar[bool] = False

    t: Array = column()
    row: IntArray = column(dtype=int, optional=True)

    def __post_init__(self) -> None:
        n = np.size(self.t)
        if getattr(self, "row", None) is None:
            object.__setattr__(self, "row", np.arange(n))
        for name, spec in self.column_specs().items():
            value = getattr(self, name)
            if value is None and spec["optional"]:
                continue
            values = np.asarray(value, dtype=spec["dtype"])
            wanted = (n, *spec["shape"])
            if len(wanted) != values.ndim or any(
                w not in (-1, k) for w, k in zip(wanted, values.shape, strict=True)
            ):
                raise ValueError(
                    f"{type(self).__name__}.{name} has shape {values.shape}; {wanted} is needed"
                )
            if values.dtype.kind == "f" and not np.all(np.isfinite(values)):
                raise ValueError(f"{type(self).__name__}.{name} holds NaN or infinity")
            object.__setattr__(self, name, values)
        steps = np.diff(self.t)
        if np.any(steps < 0) or (not self.REPEATED_STAMPS and np.any(steps == 0)):
            raise ValueError(f"{type(self).__name__}.t does not strictly increase")

    @classmethod
    def column_specs(cls) -> dict[str, Mapping[str, Any]]:
        """Shape, type and optionality of each column, by name."""
        return {f.name: f.metadata for f in fields(cls) if "shape" in f.metadata}

    def __len__(self) -> int:
        return len(self.t)

    def row_nearest(self, t: float) -> int:
        """Sample number in the source of the sample nearest to a time."""
        return int(self.row[np.argmin(np.abs(self.t - t))])

    def select(self, which: BoolArray | IntArray | slice) -> Self:
        """The samples that a mask, an index array in time order, or a slice picks."""
        picked = {
            name: getattr(self, name)[which]
            for name in self.column_specs()
            if getattr(self, name) is not None
        }
        return replace(self, **picked)

    def crop(self, start_s: float, stop_s: float) -> Self:
        """The samples with start <= t < stop."""
        return self.select(slice(*np.searchsorted(self.t, [start_s, stop_s])))

    def shift(self, offset_s: float) -> Self:
        """The same samples with an offset added to their time."""
        return replace(self, t=self.t + offset_s)


@dataclass(frozen=True, kw_only=True)
class ImuSeries(Series):
    """Angular rate (rad/s) and specific force (m/s^2) in the IMU's axes."""

    TYPE: ClassVar[str] = "imu"
    gyro_i: Array = column(3)
    accel_i: Array = column(3)


@dataclass(frozen=True, kw_only=True)
class DvlSeries(Series):
    """Velocity (m/s, instrument axes) over ground (``bottom_lock``) or through the water."""

    TYPE: ClassVar[str] = "dvl"
    v_d: Array = column(3)
    sigma: Array = column()
    valid: BoolArray = column(dtype=bool)
    bottom_lock: BoolArray = column(dtype=bool)
    altitude_m: Array | None = column(optional=True)


@dataclass(frozen=True, kw_only=True)
class OdometrySeries(Series):
    """Body-frame speed (forward, starboard; m/s) and yaw rate (rad/s, clockwise positive)."""

    TYPE: ClassVar[str] = "odometry"
    v_b: Array = column(2)
    yaw_rate: Array = column()
    sigma_v: Array = column()
    sigma_yaw_rate: Array = column()


@dataclass(frozen=True, kw_only=True)
class GnssSeries(Series):
    """Antenna positions in local NED (m), with velocities (m/s) where the receiver gives them.

    ``offset_sigma`` is the part of each axis's ``sigma`` that a fix shares with the others of the
    same value: of a poorer solution, or on the wrong side of a jump.
    """

    TYPE: ClassVar[str] = "gnss"
    p_n: Array = column(3)
    sigma: Array = column(3)
    v_n: Array | None = column(3, optional=True)
    offset_sigma: Array | None = column(optional=True)


@dataclass(frozen=True, kw_only=True)
class DepthSeries(Series):
    """Depth below the surface, m."""

    TYPE: ClassVar[str] = "depth"
    depth_m: Array = column()
    sigma: Array = column()


@dataclass(frozen=True, kw_only=True)
class HeadingSeries(Series):
    """Heading of the instrument's x axis, rad clockwise from true north."""

    TYPE: ClassVar[str] = "heading"
    heading: Array = column()
    sigma: Array = column()


@dataclass(frozen=True, kw_only=True)
class AttitudeSeries(Series):
    """Roll and pitch, rad."""

    TYPE: ClassVar[str] = "attitude"
    roll: Array = column()
    pitch: Array = column()
    sigma: Array = column()


@dataclass(frozen=True, kw_only=True)
class LandmarkSeries(Series):
    """Range (m) and bearing (rad, clockwise from the bow) to landmarks; ``id`` -1 is unknown.

    Either may be missing, with its sigma: a sensor of ranges only, or of bearings only.
    """

    TYPE: ClassVar[str] = "landmarks"
    REPEATED_STAMPS: ClassVar[bool] = True
    id: IntArray = column(dtype=int)
    range_m: Array | None = column(optional=True)
    bearing: Array | None = column(optional=True)
    elevation: Array | None = column(optional=True)
    sigma_range: Array | None = column(optional=True)
    sigma_bearing: Array | None = column(optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        ranges, bearings = self.range_m is not None, self.bearing is not None
        if not (ranges or bearings):
            raise ValueError("LandmarkSeries needs range_m or bearing")
        if ranges != (self.sigma_range is not None) or bearings != (self.sigma_bearing is not None):
            raise ValueError("LandmarkSeries.range_m and bearing each go with their sigma")
        if self.elevation is not None and not bearings:
            raise ValueError("LandmarkSeries.elevation goes with bearing")


@dataclass(frozen=True, kw_only=True)
class BeamSeries(Series):
    """Echo profiles of a mechanically scanned sonar.

    ``angle`` is the head angle in rad, clockwise seen from above; bin k spans the ranges from
    ``k * resolution_m`` to ``(k + 1) * resolution_m``.
    """

    TYPE: ClassVar[str] = "beams"
    angle: Array = column()
    intensity: NDArray[np.uint8] = column(-1, dtype=np.uint8)  # -1: any number of bins
    resolution_m: float = 0.1

    def __post_init__(self) -> None:
        if not (np.isfinite(self.resolution_m) and self.resolution_m > 0):
            raise ValueError(f"BeamSeries.resolution_m is {self.resolution_m}; it must be positive")
        super().__post_init__()


@dataclass(frozen=True, kw_only=True)
class ScanSeries(Series):
    """Scans that were extracted elsewhere: points in the body frame at their scan's time.

    The points of scan k are ``points_b[first[k]:first[k + 1]]``, metres, shape (n, 2 or 3).
    """

    TYPE: ClassVar[str] = "scans"
    first: IntArray = field(kw_only=True)
    points_b: Array = field(kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        first, points = np.asarray(self.first, dtype=np.int64), np.asarray(self.points_b, float)
        if first.shape != (len(self.t) + 1,) or np.any(np.diff(first) < 0) or first[0] != 0:
            raise ValueError("ScanSeries.first must hold one rising offset a scan and a last one")
        if points.ndim != 2 or points.shape[1] not in (2, 3) or len(points) != first[-1]:
            raise ValueError(f"ScanSeries.points_b has shape {points.shape}")
        if not np.all(np.isfinite(points)):
            raise ValueError("ScanSeries.points_b holds NaN or infinity")
        object.__setattr__(self, "first", first)
        object.__setattr__(self, "points_b", points)

    def select(self, which: BoolArray | IntArray | slice) -> Self:
        """The scans that a mask, an index array in time order, or a slice picks."""
        kept = np.arange(len(self.t))[which]
        sizes = np.diff(self.first)[kept]
        points = [self.points_b[self.first[k] : self.first[k + 1]] for k in kept]
        return replace(
            self,
            t=self.t[kept],
            row=self.row[kept],
            first=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
            points_b=np.concatenate(points) if points else self.points_b[:0],
        )


@dataclass(frozen=True, eq=False)
class Cloud:
    """One sweep of a ranging sensor.

    Attributes
    ----------
    points_s : ndarray, shape (k, 3)
        Points in the sensor's axes at their own times, m; float32 or float64.
    offset_s : ndarray, shape (k,), optional
        When each was taken, after the sweep's stamp (before it where negative), s. Without it all
        count as taken at the stamp: nothing takes the motion out of the sweep.

    Raises
    ------
    ValueError
        Where a shape is wrong or a value is not finite: who makes a cloud drops such points.
    """

    points_s: NDArray[np.floating[Any]]
    offset_s: NDArray[np.floating[Any]] | None = None

    def __post_init__(self) -> None:
        if self.points_s.ndim != 2 or self.points_s.shape[1] != 3:
            raise ValueError(f"Cloud.points_s has shape {self.points_s.shape}; (k, 3) is needed")
        if self.offset_s is not None and self.offset_s.shape != self.points_s.shape[:1]:
            raise ValueError("Cloud.offset_s must hold one time a point")
        for values in (self.points_s, self.offset_s):
            if values is not None and not np.all(np.isfinite(values)):
                raise ValueError("Cloud holds NaN or infinity")

    def __len__(self) -> int:
        return len(self.points_s)


class StoredCloud(Protocol):
    """A cloud inside a larger file."""

    def read(self) -> Cloud:
        """The cloud, or `DataError` where it cannot be read."""


@dataclass(frozen=True, kw_only=True)
class CloudSeries(Series):
    """3-D point clouds, one a stamp: in memory, or the place that holds it.

    That is a file of its own (.npy, .ply, .pcd) or a message of a bag; ``readers.clouds.load``
    gives the `Cloud` of any of them. A mission of hours does not fit in memory.
    """

    TYPE: ClassVar[str] = "clouds"
    clouds: tuple[Path | Cloud | StoredCloud, ...] = field(kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.clouds) != len(self.t):
            raise ValueError(f"CloudSeries has {len(self.t)} stamps and {len(self.clouds)} clouds")

    def select(self, which: BoolArray | IntArray | slice) -> Self:
        """The clouds that a mask, an index array in time order, or a slice picks."""
        kept = np.arange(len(self.t))[which]
        clouds = tuple(self.clouds[k] for k in kept)
        return replace(self, t=self.t[kept], row=self.row[kept], clouds=clouds)


@dataclass(frozen=True, kw_only=True)
class ReferenceSeries(Series):
    """Ground truth of an antenna in local NED; never read by an estimator.

    ``vertical_usable`` says whether ``p_n[:, 2]`` may be scored.
    """

    TYPE: ClassVar[str] = "reference"
    p_n: Array = column(3)
    rpy: Array | None = column(3, optional=True)
    sigma: Array | None = column(optional=True)
    vertical_usable: bool = True


SERIES_TYPES: dict[str, type[Series]] = {
    cls.TYPE: cls
    for cls in (
        ImuSeries,
        DvlSeries,
        OdometrySeries,
        GnssSeries,
        DepthSeries,
        HeadingSeries,
        AttitudeSeries,
        LandmarkSeries,
        BeamSeries,
        ScanSeries,
        CloudSeries,
        ReferenceSeries,
    )
}
"""Sensor type (as in mission.yaml) to series class."""
