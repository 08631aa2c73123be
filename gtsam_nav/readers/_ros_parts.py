"""Whether the bags of a folder are parts of one recording."""

from __future__ import annotations

from pathlib import Path

from gtsam_nav.errors import DataError
from gtsam_nav.readers._ros_bag import Bag

APART_S = 60.0
"""Parts of one recording overlap, or follow each other within this."""


def check_one_recording(bag: Bag, place: Path) -> None:
    """Raise a DataError where the files of a folder are recordings of several outings."""
    end_ns = None
    outings: list[list[str]] = []
    for start, end, name in bag.spans_ns:
        if end_ns is None or start - end_ns > APART_S * 1e9:
            outings.append([])
            end_ns = end
        outings[-1].append(name)
        end_ns = max(end_ns, end)
    if len(outings) > 1:
        names = "; ".join(" + ".join(parts) for parts in outings)
        raise DataError(
            f"holds {len(outings)} missions, more than {APART_S:.0f} s apart; name one, or keep the"
            f" parts of each in a folder of their own: {names}",
            place,
        )
