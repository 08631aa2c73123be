"""Arrays from .npz archives that nobody vouches for."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtsam_nav.errors import DataError
from gtsam_nav.readers._text import MAX_BYTES

# what zipfile and NumPy raise on damaged archives and headers
_FAULTS = (
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


def read_arrays(path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
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
    except _FAULTS as error:
        raise DataError(f"not a readable .npz archive: {error}", path) from error
    for name, values in loaded.items():
        if values.dtype.kind not in "fiub":
            raise DataError(f"array '{name}' holds {values.dtype}, not numbers", path)
    return loaded
