"""Tracks on the globe."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import solutions

from gtsam_nav.frames import Origin, ned_from_geodetic
from gtsam_nav.writers.geo import _cut_at_antimeridian, write_geojson, write_kml


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


def test_a_track_over_the_antimeridian_is_cut_there(tmp_path: Path) -> None:
    trajectory = solutions.true_trajectory(np.arange(0.0, 60.0))
    east = np.linspace(-50.0, 50.0, len(trajectory))
    there_and_back = replace(trajectory, p_n=np.column_stack([0 * east, 50 - abs(east), 0 * east]))
    origin = Origin(-17.0, 180.0 - 25.0 / (111.3e3 * np.cos(np.radians(17.0))))
    write_geojson(there_and_back, origin, "fiji", tmp_path / "track.geojson")
    document = json.loads((tmp_path / "track.geojson").read_text(encoding="utf-8"))
    (feature,) = document["features"]
    assert feature["geometry"]["type"] == "MultiLineString"
    parts, times = feature["geometry"]["coordinates"], feature["properties"]["t"]
    assert [part[-1][0] for part in parts[:-1]] == [180.0, -180.0]
    assert [part[0][0] for part in parts[1:]] == [-180.0, 180.0]
    assert [len(part) for part in parts] == [len(t) for t in times]
    assert sum(len(part) for part in parts) == len(trajectory) + 4
    for part, t in zip(parts, times, strict=True):
        assert np.max(np.abs(np.diff([vertex[0] for vertex in part]))) < 1e-3
        assert np.all(np.diff(t) >= 0.0)


def test_a_track_that_leaps_from_edge_to_edge_has_no_place_that_is_none() -> None:
    vertices = np.array([[180.0, 1.0, 0.0, 0.0], [-180.0, 2.0, 0.0, 1.0]])
    assert all(np.all(np.isfinite(part)) for part in _cut_at_antimeridian(vertices))
