"""sensor_msgs/PointCloud2 to a `Cloud`: fields found by name, NaN dropped, odd layouts refused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.series import Cloud

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""sensor_msgs/PointField datatypes."""
_COORDINATES = ("x", "y", "z")
NANOSECOND_S = 1e-9


@dataclass(frozen=True)
class _TimeField:
    """How a maker of lidars names the time of a point, and what it counts."""

    name: str
    kinds: str
    unit_s: float
    absolute: bool = False


_TIME_FIELDS = (
    _TimeField("t", "ui", NANOSECOND_S),  # Ouster
    _TimeField("t", "f", 1.0),
    _TimeField("time", "f", 1.0),  # Velodyne
    _TimeField("offset_time", "ui", NANOSECOND_S),  # Livox
    _TimeField("timestamp", "f", 1.0, absolute=True),  # Hesai, RoboSense
)
MAX_OFFSET_S = 10.0
"""No sweep is longer: times beyond it count something else."""


class PointField(Protocol):
    """One entry of a message's ``fields``."""

    name: str
    offset: int
    datatype: int
    count: int


class PointCloud2(Protocol):
    """The parts of a message that matter here."""

    height: int
    width: int
    fields: list[PointField]
    is_bigendian: bool
    point_step: int
    row_step: int
    data: NDArray[np.uint8]


def cloud_of_message(message: PointCloud2, stamp_s: float) -> Cloud:
    """The finite points of a message, in the axes that it has them in.

    Parameters
    ----------
    message : PointCloud2
        As ``rosbags`` deserialises it.
    stamp_s : float
        Its header's stamp, POSIX seconds: absolute times of points become offsets from it.

    Raises
    ------
    DataError
        Where x, y or z is missing or is no floating-point number, or where the sizes that the
        message states do not fit its data.
    """
    table = _table(message)
    points = np.column_stack([table[axis] for axis in _COORDINATES])
    offset_s = _offsets(table, stamp_s)
    finite = np.all(np.isfinite(points), axis=1)
    if offset_s is not None:
        finite &= np.isfinite(offset_s)
    return Cloud(points[finite], None if offset_s is None else offset_s[finite])


def _table(message: PointCloud2) -> NDArray[Any]:
    """The points as records of the fields that can be told, shape (k,)."""
    names = [f.name for f in message.fields]
    missing = [axis for axis in _COORDINATES if axis not in names]
    if missing:
        raise DataError(
            f"PointCloud2 without {', '.join(missing)}; its fields are:"
            f" {', '.join(names) or 'none'}"
        )
    order = ">" if message.is_bigendian else "<"
    wanted = {*_COORDINATES, *(spec.name for spec in _TIME_FIELDS)}
    told = [f for f in message.fields if f.name in wanted and f.datatype in _TYPES]
    for f in told:
        if f.name in _COORDINATES and (f.datatype not in (7, 8) or f.count > 1):
            raise DataError(
                f"PointCloud2 field '{f.name}' has datatype {f.datatype}, count {f.count};"
                " one float32 (7) or float64 (8) is needed"
            )
    row = message.width * message.point_step
    if message.row_step < row or len(message.data) < message.height * message.row_step:
        raise DataError(
            f"PointCloud2 states {message.height} rows of {message.row_step} bytes with"
            f" {message.width} points of {message.point_step}; it holds {len(message.data)} bytes"
        )
    records = np.dtype(
        {
            "names": [f.name for f in told],
            "formats": [order + _TYPES[f.datatype] for f in told],
            "offsets": [f.offset for f in told],
            "itemsize": message.point_step,
        }
    )
    data = np.asarray(message.data, dtype=np.uint8)[: message.height * message.row_step]
    rows = data.reshape(message.height, message.row_step)[:, :row]
    return np.frombuffer(np.ascontiguousarray(rows).tobytes(), dtype=records)


def _offsets(table: NDArray[Any], stamp_s: float) -> Array | None:
    """Time of each point after the stamp, s; None where no field tells it."""
    assert table.dtype.names is not None
    for spec in _TIME_FIELDS:
        if spec.name not in table.dtype.names or table.dtype[spec.name].kind not in spec.kinds:
            continue
        told = table[spec.name].astype(float) * spec.unit_s
        offsets = np.asarray(told - stamp_s if spec.absolute else told)
        usual = offsets[np.isfinite(offsets)]
        if len(usual) and np.max(np.abs(usual)) <= MAX_OFFSET_S:
            return offsets
    return None
