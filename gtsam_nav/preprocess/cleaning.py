"""From raw columns to a valid series: every sample that does not make it is a `Rejection`.

The reasons, in the order in which they are tried:

=======================  =========================================================================
(the reader's own)       what only the format knows, such as ``no fix``
``non-finite <column>``  NaN or infinity; the component of a vector where not all of it is
``clock jump``           a stamp hours away from the stretch that most samples form
``implausible <column>`` outside what any vehicle does, or a sigma that is not positive
``no valid sample``      all samples of a DVL without any valid one
``no range, no bearing`` all sightings of landmarks where both are missing throughout
``repeated sample``      equal to an earlier one, stamp included
``duplicate stamp``      the stamp of an earlier sample that differs otherwise
=======================  =========================================================================

Samples out of order are sorted, not dropped. Fixes that jump are left to the estimators, which
know what the vehicle can do.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gtsam_nav.frames import Array
from gtsam_nav.mission import Rejection
from gtsam_nav.series import BoolArray, DvlSeries, IntArray, LandmarkSeries, Series

CLOCK_JUMP_S = 3600.0
"""A silence or a step back that is longer separates stretches of a clock."""

MAX_STRETCHES = 2000
"""A clock that jumps more often keeps only its longest stretches."""

INVALID_DVL_SIGMA_M_S = 1.0
"""Stands for the sigma of an invalid sample that states none; nothing reads it."""

LIMITS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "imu": {"gyro_i": (-100.0, 100.0), "accel_i": (-2000.0, 2000.0)},
    "odometry": {"v_b": (-100.0, 100.0), "yaw_rate": (-100.0, 100.0)},
    "gnss": {"p_n": (-1e7, 1e7), "v_n": (-1e3, 1e3)},
    "depth": {"depth_m": (-20.0, 12_000.0)},
    "heading": {"heading": (-4 * np.pi, 4 * np.pi)},
    "attitude": {
        "roll": (-np.pi - 1e-9, np.pi + 1e-9),
        "pitch": (-np.pi / 2 - 1e-9, np.pi / 2 + 1e-9),
    },
    "landmarks": {"id": (-1, 2**53), "range_m": (0.0, 1e5), "bearing": (-4 * np.pi, 4 * np.pi)},
    "beams": {"angle": (-1e4, 1e4)},
    "reference": {"p_n": (-1e7, 1e7)},
}
"""Least and largest value of a column that is not plainly an error, by sensor type."""

GOES_WITH: Mapping[str, tuple[str, ...]] = {
    "range_m": ("sigma_range",),
    "bearing": ("sigma_bearing", "elevation"),
}
"""What sightings of landmarks measure, and the columns that mean nothing without; the sigmas are
needed with it."""

Columns = Mapping[str, NDArray[Any]]
AnySeries = TypeVar("AnySeries", bound=Series)


def tidy(
    series_type: type[AnySeries],
    sensor_name: str,
    columns: Mapping[str, ArrayLike],
    *,
    refused: Mapping[str, BoolArray] | None = None,
    max_speed_m_s: float = np.inf,
    components: Mapping[str, Sequence[str]] | None = None,
    **constants: Any,
) -> tuple[AnySeries | None, list[Rejection]]:
    """Make a series of raw columns.

    A DVL sample that its instrument calls invalid stays: the estimators bridge it. What is not
    finite in it becomes zero (sigma: `INVALID_DVL_SIGMA_M_S`). An altitude that is missing from a
    valid sample becomes zero too, which no DVL can measure. An optional column without any finite
    value counts as absent.

    Parameters
    ----------
    series_type : type of Series
    sensor_name : str
    columns : mapping of str to array_like
        Columns of the series, ``t`` included, in the order of the file, one entry a sample.
    refused : mapping of str to ndarray of bool, optional
        Reasons of the format's own, with the samples that they hit.
    max_speed_m_s : float
        Largest plausible speed of a DVL.
    components : mapping of str to sequence of str, optional
        What the file calls the components of a vector.
    **constants
        Fields of the series that are no columns.

    Returns
    -------
    series : Series or None
        None where no sample is left.
    rejections : list of Rejection
        With the stamps of the file.
    """
    raw = _present(series_type, columns)
    if series_type is DvlSeries:
        raw = _settle_invalid(raw)
    if series_type is LandmarkSeries:
        raw = _of_what_is_measured(raw)
    kept, rejections = screen(
        series_type,
        sensor_name,
        raw,
        refused=refused,
        max_speed_m_s=max_speed_m_s,
        components=components,
    )
    if not len(kept):
        return None, rejections
    picked = {name: values[kept] for name, values in raw.items()}
    return series_type(row=kept, **picked, **constants), rejections


def screen(
    series_type: type[Series],
    sensor_name: str,
    columns: Columns,
    *,
    refused: Mapping[str, BoolArray] | None = None,
    max_speed_m_s: float = np.inf,
    components: Mapping[str, Sequence[str]] | None = None,
) -> tuple[IntArray, list[Rejection]]:
    """Indices of the usable samples in the order of time, and why the others are not."""
    t = np.asarray(columns["t"], dtype=float)
    reasons = np.full(len(t), "", dtype=object)

    def refuse(mask: BoolArray, reason: str) -> None:
        reasons[mask & (reasons == "")] = reason

    for reason, mask in (refused or {}).items():
        refuse(mask, reason)
    for name, values in columns.items():
        if values.dtype.kind == "f":
            for what, mask in _non_finite(name, values, (components or {}).get(name)):
                refuse(mask, f"non-finite {what}")
    usable = np.flatnonzero(reasons == "")
    refuse(_marked(usable[_displaced(t[usable])], len(t)), "clock jump")
    for name, mask in _implausible(series_type, columns, max_speed_m_s):
        refuse(mask, f"implausible {name}")
    if series_type is DvlSeries and not np.any(columns["valid"][reasons == ""]):
        refuse(np.ones(len(t), dtype=bool), "no valid sample")
    if series_type is LandmarkSeries and not columns.keys() & GOES_WITH.keys():
        refuse(np.ones(len(t), dtype=bool), "no range, no bearing")
    for reason, mask in _repeated(series_type, columns, np.flatnonzero(reasons == "")):
        refuse(mask, reason)

    usable = np.flatnonzero(reasons == "")
    dropped = np.flatnonzero(reasons != "")
    rejections = [
        Rejection(t=float(t[k]), sensor=sensor_name, index=int(k), reason=str(reasons[k]))
        for k in dropped
    ]
    return usable[np.argsort(t[usable], kind="stable")], rejections


def main_stretch(stamps: Iterable[Array]) -> tuple[float, float]:
    """First and last stamp of the stretch that holds most of a mission.

    Stretches are separated by `CLOCK_JUMP_S` in which no sensor has a sample; the one that holds
    the largest shares of the sensors' samples, summed over the sensors, is the mission.

    Parameters
    ----------
    stamps : iterable of ndarray
        Sorted, non-empty stamps of each sensor, s.
    """
    pieces: list[tuple[float, float, float]] = []
    for t in stamps:
        bounds = np.concatenate([[0], np.flatnonzero(np.diff(t) > CLOCK_JUMP_S) + 1, [len(t)]])
        pieces += [(float(t[a]), float(t[b - 1]), (b - a) / len(t)) for a, b in pairwise(bounds)]
    merged: list[tuple[float, float, float]] = []
    for start, stop, share in sorted(pieces):
        if merged and start - merged[-1][1] <= CLOCK_JUMP_S:
            first, last, sum_of_shares = merged[-1]
            merged[-1] = (first, max(last, stop), sum_of_shares + share)
        else:
            merged.append((start, stop, share))
    start, stop, _ = max(merged, key=lambda piece: (round(piece[2], 9), -piece[0]))
    return start, stop


def _present(series_type: type[Series], columns: Mapping[str, ArrayLike]) -> dict[str, Any]:
    """The columns as arrays, without optional ones that hold nothing finite."""
    specs = series_type.column_specs()
    needed = {first for first, *_ in GOES_WITH.values()} & columns.keys()
    arrays = {name: np.asarray(values) for name, values in columns.items()}
    return {
        name: values
        for name, values in arrays.items()
        if not specs[name]["optional"]
        or name in needed
        or values.dtype.kind != "f"
        or np.any(np.isfinite(values))
    }


def _settle_invalid(columns: Columns) -> dict[str, Any]:
    """DVL columns in which invalid samples and missing altitudes are finite."""
    # a NaN in ``valid`` itself is not settled here but refused later
    invalid = np.asarray(columns["valid"]) == 0
    settled = dict(columns)
    v_d, sigma = np.array(columns["v_d"], float), np.array(columns["sigma"], float)
    v_d[invalid[:, None] & ~np.isfinite(v_d)] = 0.0
    sigma[invalid & ~(np.isfinite(sigma) & (sigma > 0))] = INVALID_DVL_SIGMA_M_S
    settled |= {"v_d": v_d, "sigma": sigma}
    if "altitude_m" in columns:
        altitude = np.asarray(columns["altitude_m"], float)
        settled["altitude_m"] = np.where(np.isfinite(altitude), altitude, 0.0)
    return settled


def _of_what_is_measured(columns: Columns) -> dict[str, Any]:
    """Columns of sightings without the sigmas and elevations of what is not measured."""
    idle = {name for what, names in GOES_WITH.items() if what not in columns for name in names}
    return {name: values for name, values in columns.items() if name not in idle}


def _non_finite(
    name: str, values: NDArray[Any], components: Sequence[str] | None
) -> Iterator[tuple[str, BoolArray]]:
    """What of a column is not finite in which samples: all of a vector, or a component."""
    lacking = ~np.isfinite(values)
    if values.ndim != 2 or components is None:
        yield name, ~_whole_rows(~lacking)
        return
    yield name, np.all(lacking, axis=1)
    yield from zip(components, lacking.T, strict=True)


def _whole_rows(mask: BoolArray) -> BoolArray:
    return mask if mask.ndim == 1 else np.all(mask, axis=tuple(range(1, mask.ndim)))


def _marked(indices: IntArray, n: int) -> BoolArray:
    mask = np.zeros(n, dtype=bool)
    mask[indices] = True
    return mask


def _implausible(
    series_type: type[Series], columns: Columns, max_speed_m_s: float
) -> list[tuple[str, BoolArray]]:
    """Columns with the samples in which they are beyond their limits."""
    found: list[tuple[str, BoolArray]] = []
    for name, (low, high) in LIMITS.get(series_type.TYPE, {}).items():
        if name in columns:
            found.append((name, ~_whole_rows((columns[name] >= low) & (columns[name] <= high))))
    if series_type is DvlSeries:
        with np.errstate(over="ignore", invalid="ignore"):
            speed = np.linalg.norm(columns["v_d"], axis=1)
        found.append(("speed", (columns["valid"] != 0) & ~(speed <= max_speed_m_s)))
    for name, values in columns.items():
        if name.startswith("sigma"):
            # a simulated truth may be exact
            exact = series_type.TYPE == "reference"
            found.append((name, ~_whole_rows(values >= 0 if exact else values > 0)))
    return found


def _displaced(t: Array) -> BoolArray:
    """Stamps, in the order of the file, outside the largest chain of stretches that follow on.

    Only a step back of hours is evidence: what merely jumps ahead may be a pause, which
    `main_stretch` judges with all sensors at hand.
    """
    with np.errstate(over="ignore"):
        step = np.diff(t)
    displaced = np.zeros(len(t), dtype=bool)
    if not np.any(step < -CLOCK_JUMP_S):
        return displaced
    bounds = np.concatenate([[0], np.flatnonzero(np.abs(step) > CLOCK_JUMP_S) + 1, [len(t)]])
    sizes = np.diff(bounds)
    first = np.minimum.reduceat(t, bounds[:-1])
    last = np.maximum.reduceat(t, bounds[:-1])
    longest = np.sort(np.argsort(-sizes, kind="stable")[:MAX_STRETCHES])
    displaced[:] = True
    for k in longest[_heaviest_chain(first[longest], last[longest], sizes[longest])]:
        displaced[bounds[k] : bounds[k + 1]] = False
    return displaced


def _heaviest_chain(first: Array, last: Array, weight: IntArray) -> IntArray:
    """Intervals of the rising subsequence with the largest total weight."""
    total = weight.astype(float)
    before = np.full(len(weight), -1)
    for k in range(1, len(weight)):
        follows = (first[:k] < first[k]) & (last[:k] < last[k])
        best = int(np.argmax(np.where(follows, total[:k], -1.0)))
        if follows[best]:
            total[k] += total[best]
            before[k] = best
    chain = [int(np.argmax(total))]
    while before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    return np.array(chain[::-1])


def _repeated(
    series_type: type[Series], columns: Columns, usable: IntArray
) -> list[tuple[str, BoolArray]]:
    """Samples that repeat an earlier stamp, apart by whether they repeat all of it."""
    t = np.asarray(columns["t"], dtype=float)
    order = usable[np.argsort(t[usable], kind="stable")]
    again = np.flatnonzero(np.diff(t[order]) == 0) + 1
    exact: list[int] = []
    different: list[int] = []
    seen: dict[float, set[bytes]] = {}
    for position in again:
        k, first = int(order[position]), int(order[position - 1])
        contents = _contents(columns, k)
        earlier = seen.setdefault(float(t[k]), {_contents(columns, first)})
        if contents in earlier:
            exact.append(k)
        elif series_type.REPEATED_STAMPS:
            earlier.add(contents)
        else:
            different.append(k)
    return [
        ("repeated sample", _marked(np.array(exact, dtype=int), len(t))),
        ("duplicate stamp", _marked(np.array(different, dtype=int), len(t))),
    ]


def _contents(columns: Columns, k: int) -> bytes:
    """All of one sample, comparable."""
    return b"".join(values[k].tobytes() for values in columns.values())
