"""What every reader keeps to, on a small sample of its format; a new reader must bring one."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from samples import BY_CARD, SAMPLES, SUBJECTS

from gtsam_nav.mission import Mission
from gtsam_nav.readers import Reader, open_mission, readers
from gtsam_nav.writers.mission_folder import write_mission


def of(name: str) -> Reader:
    return next(reader for reader in readers() if name == reader.NAME)


def same(one: Mission, two: Mission, atol: float = 0.0) -> None:
    assert one.sensors.keys() == two.sensors.keys()
    for name, sensor in one.sensors.items():
        other = two.sensors[name]
        assert sensor.type == other.type
        np.testing.assert_allclose(sensor.R_bs, other.R_bs, atol=max(atol, 1e-12))
        np.testing.assert_allclose(sensor.xyz_b, other.xyz_b, atol=atol)
        columns = [c for c in sensor.series.column_specs() if c != "row" or atol == 0.0]
        columns += [c for c in ("first", "points_b") if hasattr(sensor.series, c)]
        for column in columns:
            a, b = getattr(sensor.series, column), getattr(other.series, column)
            assert (a is None) == (b is None), (name, column)
            if a is not None:
                np.testing.assert_allclose(a, b, atol=atol, rtol=atol, err_msg=f"{name} {column}")
    assert (one.edges is None) == (two.edges is None)
    if one.edges is not None and two.edges is not None:
        for column in ("t", "q", "cov"):
            a, b = getattr(one.edges, column), getattr(two.edges, column)
            np.testing.assert_allclose(a, b, atol=atol, rtol=atol, err_msg=f"edges {column}")


def test_every_reader_brings_a_sample() -> None:
    assert {reader.NAME for reader in readers()} == {*SAMPLES, *BY_CARD}
    assert {*SAMPLES, *BY_CARD} <= {*SUBJECTS}


@pytest.mark.parametrize("name", SAMPLES)
def test_a_sample_is_its_reader_s_and_opens_the_same_twice(name: str, tmp_path: Path) -> None:
    path = SAMPLES[name](tmp_path)
    assert next(r.NAME for r in readers() if r.can_open(path)) == name
    told: list[float] = []
    first = of(name).read(path, lambda _, fraction: told.append(fraction))
    assert told
    assert told[-1] == 1.0
    assert all(0.0 <= fraction <= 1.0 for fraction in told)
    assert all(source.is_file() for source in first.sources)
    again = open_mission(path)
    same(first, again)
    assert first.rejections == again.rejections or str(first.rejections) == str(again.rejections)


@pytest.mark.parametrize("name", SAMPLES)
def test_a_sample_becomes_a_mission_folder_that_reads_back_equal(name: str, tmp_path: Path) -> None:
    (tmp_path / "sample").mkdir()
    read = open_mission(SAMPLES[name](tmp_path / "sample"))
    write_mission(read, tmp_path / "converted")
    back = open_mission(tmp_path / "converted")
    # latitude and longitude hold a position to 1e-8 m
    same(read, back, atol=1e-7)
    assert back.start_utc == read.start_utc
    assert back.origin == read.origin
    assert back.dropped == read.dropped


@pytest.mark.parametrize(
    ("name", "file"),
    [("NMEA 0183 log", "log.nmea"), ("Water Linked JSON", "dvl.txt"), ("CARMEN log", "log.clf")],
)
def test_gzipped_text_is_the_same(name: str, file: str, tmp_path: Path) -> None:
    path = SAMPLES[name](tmp_path)
    packed = tmp_path / f"{file}.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    same(open_mission(path), open_mission(packed))
    packed.write_bytes(packed.read_bytes()[:-9])
    cut = of(name).read(packed)
    assert sum(len(sensor.series) for sensor in cut.sensors.values()) > 0
    assert any("the archive is cut off" in said for said in cut.warnings)
