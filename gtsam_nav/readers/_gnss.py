"""Geodetic fixes as a series in local NED."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from gtsam_nav.frames import Array, Origin, ned_from_geodetic
from gtsam_nav.mission import Rejection
from gtsam_nav.preprocess.cleaning import screen, tidy
from gtsam_nav.readers.layout import GEODETIC_COLUMNS, HEIGHT_COLUMN
from gtsam_nav.sensors.noise import GnssNoise
from gtsam_nav.series import BoolArray, GnssSeries

NO_HEIGHT_SIGMA_M = 100.0
"""Of a vertical that nothing tells."""
NO_HEIGHTS = "no heights: they tell north and east"
OFF_THE_GLOBE = "latitude or longitude out of range"
OFF_THE_GLOBE_MENDED = (
    "; where they are exchanged, columns: {lat_deg: lon_deg, lon_deg: lat_deg} mends it, where they"
    " are in 1e-7 deg, scale: {lat_deg: 1.0e-7, lon_deg: 1.0e-7}"
)
"""What a card says where all fixes are off the globe."""


@dataclass(frozen=True)
class Fixes:
    """Raw fixes in the order of the file.

    ``sigma`` and ``v_n`` have shape (n, 3) in NED, m and m/s; angles are degrees on WGS-84.
    ``has_fix`` is what the receiver says of itself, ``unread`` what the reader could not read, by
    reason.
    """

    t: Array
    latitude_deg: Array
    longitude_deg: Array
    height_m: Array
    sigma: Array
    v_n: Array | None = None
    has_fix: BoolArray | None = None
    unread: Mapping[str, BoolArray] = field(default_factory=dict)

    def refused(self) -> dict[str, BoolArray]:
        """Fixes that are none, by reason."""
        lat, lon = self.latitude_deg, self.longitude_deg
        null_island = (lat == 0) & (lon == 0)
        return {
            **self.unread,
            "no fix": null_island if self.has_fix is None else null_island | ~self.has_fix,
            OFF_THE_GLOBE: (np.abs(lat) > 90) | (lon < -180) | (lon > 360),
        }

    def first_usable(self, height_m: float | None = None) -> Origin | None:
        """The earliest fix that survives cleaning as an origin, at its own or a given height."""
        geodetic = np.column_stack([self.latitude_deg, self.longitude_deg, self.height_m])
        columns = {"t": self.t, "p_n": geodetic, "sigma": self.sigma}
        kept, _ = screen(GnssSeries, "", columns, refused=self.refused())
        if not len(kept):
            return None
        latitude, longitude, own_height = (float(x) for x in geodetic[kept[0]])
        return Origin(latitude, longitude, own_height if height_m is None else height_m)

    def series(self, sensor_name: str, origin: Origin) -> tuple[GnssSeries | None, list[Rejection]]:
        """The fixes in local NED, cleaned."""
        reasons = self.refused()
        geodetic = np.column_stack([self.latitude_deg, self.longitude_deg, self.height_m])
        usable = np.all(np.isfinite(geodetic), axis=1) & ~np.any([*reasons.values()], axis=0)
        p_n = np.full_like(geodetic, np.nan)
        latitude, longitude, height = geodetic[usable].T
        p_n[usable] = ned_from_geodetic(latitude, longitude, height, origin)
        columns = {"t": self.t, "p_n": p_n, "sigma": self.sigma}
        if self.v_n is not None:
            columns["v_n"] = self.v_n
        return tidy(GnssSeries, sensor_name, columns, refused=reasons)


def geodetic_fixes(
    columns: Mapping[str, Array], sigma: Array, v_n: Array | None
) -> tuple[Fixes, bool]:
    """Fixes of a table's columns, and whether it has their heights."""
    latitude_deg, longitude_deg = (columns[name] for name in GEODETIC_COLUMNS)
    height_m = columns.get(HEIGHT_COLUMN, np.full(len(sigma), np.nan))
    fixes = Fixes(columns["t"], latitude_deg, longitude_deg, height_m, sigma, v_n)
    return fixes, bool(np.any(np.isfinite(height_m)))


def without_heights(fixes: Fixes, noise: GnssNoise, origin: Origin | None) -> Fixes:
    """Fixes of unknown height: near that of the origin, if anywhere, or as sure as a card says."""
    is_stated = "sigma_vertical_m" in noise.model_fields_set
    vertical = noise.sigma_vertical_m if is_stated else NO_HEIGHT_SIGMA_M
    return replace(
        fixes,
        height_m=np.full(len(fixes.t), origin.height_m if origin is not None else 0.0),
        sigma=np.column_stack([fixes.sigma[:, :2], np.full(len(fixes.t), vertical)]),
    )
