"""The columns of the mission folder's CSV files, for reading and writing alike."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Field:
    """Where one column of a series stands in a file.

    Attributes
    ----------
    series : str
        Name in the series.
    columns : tuple of str
        Names in the file; several make a vector.
    degrees : bool
        Whether the file holds degrees where the series holds radians.
    required : bool
        Whether a file without these columns is malformed.
    noise : tuple of str
        Figures of the noise model that serve where the columns are absent.
    words : mapping of str to float
        Words that the file writes for the numbers.
    absent : float or None
        What the series holds where the columns are absent; None leaves the series without.
    integer : bool
        Whether the file writes whole numbers.
    """

    series: str
    columns: tuple[str, ...]
    degrees: bool = False
    required: bool = True
    noise: tuple[str, ...] = ()
    words: Mapping[str, float] | None = None
    absent: float | None = None
    integer: bool = False


LOCK_WORDS = {"bottom": 1.0, "water": 0.0}

NED_COLUMNS = ("n", "e", "d")

GEODETIC_COLUMNS = ("lat_deg", "lon_deg")
"""Stand for n, e, d in a GNSS file."""
HEIGHT_COLUMN = "h_m"
"""Goes with these; loggers of boats leave it out."""

LAYOUTS: dict[str, tuple[Field, ...]] = {
    "imu": (
        Field("gyro_i", ("gx", "gy", "gz")),
        Field("accel_i", ("ax", "ay", "az")),
    ),
    "dvl": (
        Field("v_d", ("vx", "vy", "vz")),
        Field("sigma", ("sigma",), required=False, noise=("sigma_m_s",)),
        Field("valid", ("valid",), required=False, absent=1.0, integer=True),
        Field("bottom_lock", ("lock",), required=False, words=LOCK_WORDS, absent=1.0),
        Field("altitude_m", ("altitude",), required=False),
    ),
    "odometry": (
        Field("v_b", ("vx", "vy")),
        Field("yaw_rate", ("wz",)),
        Field("sigma_v", ("sigma_v",), required=False, noise=("sigma_v_m_s",)),
        Field("sigma_yaw_rate", ("sigma_w",), required=False, noise=("sigma_yaw_rate_rad_s",)),
    ),
    "gnss": (
        Field("p_n", NED_COLUMNS),
        Field(
            "sigma",
            ("sigma_n", "sigma_e", "sigma_d"),
            required=False,
            noise=("sigma_horizontal_m", "sigma_horizontal_m", "sigma_vertical_m"),
        ),
        Field("v_n", ("vn", "ve", "vd"), required=False),
    ),
    "depth": (
        Field("depth_m", ("depth_m",)),
        Field("sigma", ("sigma",), required=False, noise=("sigma_m",)),
    ),
    "heading": (
        Field("heading", ("heading_deg",), degrees=True),
        Field("sigma", ("sigma_deg",), degrees=True, required=False, noise=("sigma_deg",)),
    ),
    "attitude": (
        Field("roll", ("roll_deg",), degrees=True),
        Field("pitch", ("pitch_deg",), degrees=True),
        Field("sigma", ("sigma_deg",), degrees=True, required=False, noise=("sigma_deg",)),
    ),
    "landmarks": (
        Field("id", ("id",), integer=True),
        # one of them must be there
        Field("range_m", ("range_m",), required=False),
        Field("bearing", ("bearing_deg",), degrees=True, required=False),
        Field("elevation", ("elevation_deg",), degrees=True, required=False),
        Field("sigma_range", ("sigma_range",), required=False, noise=("sigma_range_m",)),
        Field(
            "sigma_bearing",
            ("sigma_bearing_deg",),
            degrees=True,
            required=False,
            noise=("sigma_bearing_deg",),
        ),
    ),
    "reference": (
        Field("p_n", NED_COLUMNS),
        Field("rpy", ("roll_deg", "pitch_deg", "yaw_deg"), degrees=True, required=False),
        Field("sigma", ("sigma",), required=False),
    ),
}
"""Sensor type to the fields of its file, in the order in which they are written."""
