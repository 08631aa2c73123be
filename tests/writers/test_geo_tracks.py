"""Tracks on the globe."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import solutions

from gtsam_nav.frames import ned_from_geodetic
from gtsam_nav.writers.geo import write_geojson, write_kml


def test_geojson_round_trip(tmp_path: Path) -> None:
    trajectory = solutions.true_trajectory(np.arange(0.0, 60.0))
    write_geojson(trajectory, solutions.ORIGIN, 'a "name"', tmp_path / "track.geojson")
    document = json.loads((tmp_path / "track.geojson").read_text(encoding="utf-8"))
    (feature,) = document["features"]
    assert document["type"] == "FeatureCollection"
    assert feature["geometry"]["type"] == "LineString"
    assert feature["properties"]["name"] == 'a "name"'
    np.testing.assert_array_equal(feature["properties"]["t"], trajectory.t)
    longitude, latitude, height = np.array(feature["geometry"]["coordinates"]).T
    p_n = ned_from_geodetic(latitude, longitude, height, solutions.ORIGIN)
    np.testing.assert_allclose(p_n, trajectory.p_n, atol=1e-3)


def test_kml_round_trip(tmp_path: Path) -> None:
    trajectory = solutions.true_trajectory(np.arange(0.0, 60.0))
    write_kml(trajectory, solutions.ORIGIN, "a <b> & c", tmp_path / "track.kml")
    tree = ElementTree.parse(tmp_path / "track.kml").getroot()
    names = [node.text for node in tree.iter("{http://www.opengis.net/kml/2.2}name")]
    assert set(names) == {"a <b> & c"}
    (line,) = tree.iter("{http://www.opengis.net/kml/2.2}coordinates")
    assert line.text is not None
    longitude, latitude, _ = np.array([row.split(",") for row in line.text.split()], dtype=float).T
    p_n = ned_from_geodetic(latitude, longitude, -trajectory.p_n[:, 2], solutions.ORIGIN)
    np.testing.assert_allclose(p_n[:, :2], trajectory.p_n[:, :2], atol=1e-3)
