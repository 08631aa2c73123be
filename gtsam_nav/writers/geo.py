"""Tracks on the globe: GeoJSON and KML."""

from __future__ import annotations

import json
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from gtsam_nav.frames import Array, Origin, geodetic_from_ned
from gtsam_nav.trajectory import Trajectory


def write_geojson(trajectory: Trajectory, origin: Origin, name: str, path: Path) -> None:
    """Write the track as one LineString of longitude, latitude (deg), height (m), RFC 7946.

    Where it crosses the antimeridian it is cut there into a MultiLineString, as the RFC asks. The
    feature's ``t`` holds the mission time of each vertex, a list for each part.
    """
    latitude, longitude, height = geodetic_from_ned(trajectory.p_n, origin)
    parts = _cut_at_antimeridian(np.column_stack([longitude, latitude, height, trajectory.t]))
    times = [part[:, 3].tolist() for part in parts]
    lines = [
        [[round(lon, 9), round(lat, 9), round(h, 3)] for lon, lat, h in part[:, :3].tolist()]
        for part in parts
    ]
    whole = len(parts) == 1
    feature = {
        "type": "Feature",
        "properties": {"name": name, "t": times[0] if whole else times},
        "geometry": {
            "type": "LineString" if whole else "MultiLineString",
            "coordinates": lines[0] if whole else lines,
        },
    }
    document = {"type": "FeatureCollection", "features": [feature]}
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":"))
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


def _cut_at_antimeridian(vertices: Array) -> list[Array]:
    """Parts of a track (n, 4) of longitudes, deg, and what goes with them; cut where it crosses."""
    parts, begin = [], vertices[:0]
    last = 0
    for k in np.flatnonzero(np.abs(np.diff(vertices[:, 0])) > 180.0) + 1:
        before, after = vertices[k - 1], vertices[k].copy()
        side = np.sign(before[0]) * 180.0
        after[0] += 2 * side
        share = (side - before[0]) / ((after[0] - before[0]) or 1.0)
        crossing = before + share * (after - before)
        crossing[0] = side
        parts.append(np.vstack([begin, vertices[last:k], crossing]))
        begin = crossing[None] * [-1.0, 1.0, 1.0, 1.0]
        last = int(k)
    return [*parts, np.vstack([begin, vertices[last:]])]


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
