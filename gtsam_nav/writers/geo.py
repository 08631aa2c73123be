"""Tracks on the globe: GeoJSON and KML."""

from __future__ import annotations

import json
from pathlib import Path
from xml.sax.saxutils import escape

from gtsam_nav.frames import Origin, geodetic_from_ned
from gtsam_nav.trajectory import Trajectory


def write_geojson(trajectory: Trajectory, origin: Origin, name: str, path: Path) -> None:
    """Write the track as one LineString of longitude, latitude (deg), height (m), RFC 7946.

    The feature's ``t`` holds the mission time of each vertex.
    """
    latitude, longitude, height = geodetic_from_ned(trajectory.p_n, origin)
    feature = {
        "type": "Feature",
        "properties": {"name": name, "t": trajectory.t.tolist()},
        "geometry": {
            "type": "LineString",
            "coordinates": [
                [round(lon, 9), round(lat, 9), round(h, 3)]
                for lon, lat, h in zip(
                    longitude.tolist(), latitude.tolist(), height.tolist(), strict=True
                )
            ],
        },
    }
    document = {"type": "FeatureCollection", "features": [feature]}
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":"))
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


def write_kml(trajectory: Trajectory, origin: Origin, name: str, path: Path) -> None:
    """Write the track as a KML line on the surface (KML heights refer to another datum)."""
    latitude, longitude, _ = geodetic_from_ned(trajectory.p_n, origin)
    pairs = zip(longitude.tolist(), latitude.tolist(), strict=True)
    coordinates = "\n".join(f"{lon:.9f},{lat:.9f},0" for lon, lat in pairs)
    text = f"""<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2">
<Document>
<name>{escape(name)}</name>
<Style id="track"><LineStyle><color>ffb24d1f</color><width>3</width></LineStyle></Style>
<Placemark>
<name>{escape(name)}</name>
<styleUrl>#track</styleUrl>
<LineString>
<tessellate>1</tessellate>
<altitudeMode>clampToGround</altitudeMode>
<coordinates>
{coordinates}
</coordinates>
</LineString>
</Placemark>
</Document>
</kml>
"""
    path.write_text(text, encoding="utf-8", newline="\n")
