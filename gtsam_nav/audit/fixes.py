"""Lines of a sensor's card that mend what a check found."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gtsam_nav.card_lines import scale as scale
from gtsam_nav.frames import Array, rotation_from_rpy, rpy_from_rotation


def columns(exchanged: Mapping[str, str]) -> str:
    """Read columns under each other's names."""
    return f"columns: {{{', '.join(f'{own}: {theirs}' for own, theirs in exchanged.items())}}}"


EXCHANGED_DEGREES = columns({"lat_deg": "lon_deg", "lon_deg": "lat_deg"})
"""Read latitudes and longitudes under each other's names."""


def mounting(R_bs: Array) -> str:
    """Mount the sensor so."""
    rpy_deg = np.round(np.degrees(rpy_from_rotation(R_bs)), 1) + 0.0
    rpy_deg[rpy_deg == -180.0] = 180.0
    return f"rpy_deg: [{', '.join(f'{angle:g}' for angle in rpy_deg)}]"


def turned_mounting(yaw: float, R_bs: Array) -> str:
    """Turn the mounting clockwise by an angle, rad."""
    return mounting(rotation_from_rpy([0.0, 0.0, yaw]) @ R_bs)


def heading_turned_by(yaw_deg: float) -> str:
    """Add an angle to the headings: the compass stands turned by as much the other way."""
    return f"rpy_deg: [0, 0, {-yaw_deg:g}] (added to the yaw that it has)"


def position(xyz_b: Array) -> str:
    """Mount the sensor there."""
    return f"xyz_m: [{', '.join(f'{x:g}' for x in np.round(xyz_b, 3) + 0.0)}]"


def later(offset_s: float) -> str:
    """Add seconds to the stamps."""
    return f"time_offset_s: {offset_s:+.2f} (added to what it has)"
