"""Magnetic declination by date and place: the World Magnetic Model (NOAA/NCEI and BGS)."""

from __future__ import annotations

from datetime import UTC, datetime
from functools import lru_cache

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Origin

MODEL_YEARS = 5
FIRST_YEAR, LAST_YEAR = 2010, 2030
"""Years that the models cover, the last excluded."""


@lru_cache(maxsize=8)
def declination_deg(origin: Origin, utc_s: float) -> float:
    """How far magnetic north is east of true north, degrees.

    Parameters
    ----------
    origin : Origin
        The place on WGS-84.
    utc_s : float
        POSIX seconds.

    Raises
    ------
    DataError
        Where no model covers the date.
    """
    from pygeomag import GeoMag

    date = datetime.fromtimestamp(utc_s, UTC)
    if not FIRST_YEAR <= date.year < LAST_YEAR:
        raise DataError(
            f"the magnetic declination of {date:%Y-%m-%d} is unknown: the World Magnetic Models"
            f" cover {FIRST_YEAR} to {LAST_YEAR}; state declination_deg instead"
        )
    begin, end = (datetime(year, 1, 1, tzinfo=UTC) for year in (date.year, date.year + 1))
    decimal_year = date.year + (date - begin) / (end - begin)
    model = GeoMag(base_year=date.year - date.year % MODEL_YEARS)
    field = model.calculate(
        glat=origin.latitude_deg,
        glon=origin.longitude_deg,
        alt=origin.height_m / 1000.0,
        time=decimal_year,
    )
    return float(field.d)
