"""What every reader keeps to, on a small sample of its format; a new reader must bring one."""

from __future__ import annotations

import gzip
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import test_carmen
import test_cloud_files
import test_csv_files
import test_g2o_graphs
import test_mrclam
import test_nmea
import test_ping360
import test_plaza
import test_rosbag
import test_rtklib
import test_stpere
import test_toro
import test_waterlinked
from bags import messages_of, write_bag
from hypothesis import given, settings
from hypothesis import strategies as st
from missions import every_sensor_mission

from gtsam_nav.errors import DataError, GtsamNavError
from gtsam_nav.mission import Mission
from gtsam_nav.readers import Reader, open_mission, readers
from gtsam_nav.writers.mission_folder import write_mission


def folder(place: Path) -> Path:
    (place / "clouds").mkdir()
    write_mission(every_sensor_mission(place / "clouds"), place / "mission")
    return place / "mission"


def text(name: str, lines: list[str]) -> Callable[[Path], Path]:
    def make(place: Path) -> Path:
        (place / name).write_text("\n".join(lines) + "\n")
        return place / name

    return make


NMEA = [
    line
    for k in range(6)
    for line in (
        test_nmea.rmc(f"12000{k}.0", "010224"),
        test_nmea.gga(f"12000{k}.0", minutes=30 + 0.01 * k),
        test_nmea.hdt(10.0 * k),
    )
]
CARMEN = [
    line
    for k in range(6)
    for line in (test_carmen.odom(k, 0.1 * k), test_carmen.laser(k, 1 + k, 2, 3, 4))
]

SAMPLES: dict[str, Callable[[Path], Path]] = {
    "mission folder": folder,
    "St. Pere logs": test_stpere.logs,
    "UTIAS MRCLAM": test_mrclam.files,
    "RTKLIB with an IMU": test_rtklib.log,
    "TORO graph": text("park.txt", test_toro.GRAPH.splitlines()),
    "Plaza": test_plaza.texts,
    "ROS bag": lambda place: write_bag(
        place / "round", "ros1", messages_of(test_rosbag.mission(), "ros1")
    ),
    "NMEA 0183 log": text("log.nmea", NMEA),
    "Water Linked JSON": text("dvl.txt", [test_waterlinked.report(100, 0.1 * k) for k in range(6)]),
    "CARMEN log": text("log.clf", CARMEN),
    "Ping360 dump": test_ping360.dump,
    "g2o graph": text("park.g2o", test_g2o_graphs.GRAPH.splitlines()),
    "cloud files": test_cloud_files.files,
}
BY_CARD = {"CSV with a card": test_csv_files.files}
"""Readers that do not open anything without a card."""


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


def test_every_reader_brings_a_sample() -> None:
    assert {reader.NAME for reader in readers()} == {*SAMPLES, *BY_CARD}


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


@pytest.mark.parametrize("name", SAMPLES)
@settings(max_examples=12)
@given(data=st.data())
def test_damage_is_an_error_or_is_counted(
    name: str, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """Whatever becomes of the bytes, nothing but this package's own errors comes out."""
    place = tmp_path_factory.mktemp("damaged")
    path = SAMPLES[name](place)
    files = sorted(p for p in place.rglob("*") if p.is_file())
    file = data.draw(st.sampled_from(files))
    whole = bytearray(file.read_bytes())
    for _ in range(data.draw(st.integers(0, 4))):
        whole[data.draw(st.integers(0, max(len(whole) - 1, 0)))] = data.draw(st.integers(0, 255))
    kept = data.draw(st.integers(0, len(whole)))
    file.write_bytes(bytes(whole[:kept]))
    try:
        open_mission(path)
    except GtsamNavError:
        pass
    finally:
        shutil.rmtree(place)


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
    with pytest.raises(DataError, match="gzip archive is cut off"):
        of(name).read(packed)
