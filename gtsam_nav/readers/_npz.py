"""Beams and scans from .npz archives that nobody vouches for."""

from __future__ import annotations

import struct
import tokenize
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtsam_nav.errors import DataError
from gtsam_nav.mission import Rejection
from gtsam_nav.preprocess.cleaning import screen, tidy
from gtsam_nav.readers._bytes import MAX_BYTES
from gtsam_nav.readers._mended_table import past_midnight
from gtsam_nav.series import BeamSeries, ScanSeries

# what zipfile and NumPy raise on damaged archives and headers
NUMPY_FAULTS = (
    tokenize.TokenError,
    RecursionError,
    OSError,
    ValueError,
    TypeError,
    LookupError,
    EOFError,
    RuntimeError,
    MemoryError,
    OverflowError,
    SyntaxError,
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
)


def read_beams(
    name: str, path: Path, stamp_s: float
) -> tuple[BeamSeries | None, list[Rejection], bool]:
    """Beams of an archive with t (in units of ``stamp_s``), angle, intensity and resolution_m; and
    whether their stamps pass midnight."""
    arrays = _read_arrays(path, ("t", "angle", "intensity", "resolution_m"))
    t, angle, intensity = (arrays[k] for k in ("t", "angle", "intensity"))
    if t.ndim != 1 or angle.shape != t.shape or intensity.ndim != 2 or len(intensity) != len(t):
        raise DataError(
            f"t {t.shape}, angle {angle.shape} and intensity {intensity.shape} "
            "do not fit; needed are (n,), (n,) and (n, bins)",
            path,
        )
    if intensity.dtype != np.uint8:
        raise DataError(f"intensity holds {intensity.dtype}; uint8 is needed", path)
    resolution = arrays["resolution_m"]
    if resolution.size != 1 or not (np.isfinite(resolution) & (resolution > 0)).all():
        raise DataError("resolution_m must be one positive number", path)
    stamps, passed = past_midnight(stamp_s * t.astype(float))
    columns = {"t": stamps, "angle": angle.astype(float), "intensity": intensity}
    return *tidy(BeamSeries, name, columns, resolution_m=float(resolution.reshape(()))), passed


def read_scans(
    name: str, path: Path, stamp_s: float
) -> tuple[ScanSeries | None, list[Rejection], bool]:
    """Scans of an archive with t (in units of ``stamp_s``), first and points, and whether their
    stamps pass midnight; one with a point that is not finite is none."""
    arrays = _read_arrays(path, ("t", "first", "points"))
    t, points = arrays["t"].astype(float), arrays["points"].astype(float)
    first = arrays["first"].astype(np.int64)
    if t.ndim != 1 or first.shape != (len(t) + 1,) or first[0] != 0 or np.any(np.diff(first) < 0):
        raise DataError("first must hold one rising offset a scan, from 0, and a last one", path)
    if points.ndim != 2 or points.shape[1] not in (2, 3) or len(points) != first[-1]:
        raise DataError(
            f"points has shape {points.shape}; ({first[-1]}, 2 or 3) is needed, as first says", path
        )
    t, passed = past_midnight(stamp_s * t)
    finite = np.all(np.isfinite(points), axis=1)
    bad = np.diff(np.concatenate([[0], np.cumsum(~finite)])[first]) > 0
    kept, rejections = screen(ScanSeries, name, {"t": t}, refused={"non-finite points": bad})
    if not len(kept):
        return None, rejections, passed
    sizes = np.diff(first)[kept]
    picked = np.concatenate([points[first[k] : first[k + 1]] for k in kept])
    offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    return ScanSeries(t=t[kept], row=kept, first=offsets, points_b=picked), rejections, passed


def _read_arrays(path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """The named arrays of an archive; each must hold finite or NaN numbers.

    Raises
    ------
    DataError
        Where the archive is missing or damaged, an array is not in it or holds no numbers.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > MAX_BYTES:
            raise DataError(f"{size} bytes after decompression; {MAX_BYTES} are allowed", path)
        with np.load(path, allow_pickle=False) as arrays:
            missing = [name for name in names if name not in arrays.files]
            if missing:
                raise DataError(
                    f"array '{missing[0]}' is missing; needed are {', '.join(names)}; "
                    f"the file holds {', '.join(arrays.files) or 'none'}",
                    path,
                )
            loaded = {name: np.asarray(arrays[name]) for name in names}
    except FileNotFoundError as error:
        raise DataError("no such file", path) from error
    except NUMPY_FAULTS as error:
        raise DataError(f"not a readable .npz archive: {error}", path) from error
    for name, values in loaded.items():
        if values.dtype.kind not in "fiub":
            raise DataError(f"array '{name}' holds {values.dtype}, not numbers", path)
    return loaded
