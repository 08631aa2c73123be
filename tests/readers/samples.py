"""A small sample of every format that is read; a new reader must bring one.

`SAMPLES` are missions, by their reader's name. `SUBJECTS` are all that fuzzing reads: these,
further kinds of the same formats, and what the package reads besides missions.
"""

from __future__ import annotations

import bz2
import gzip
import re
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
import solutions
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
import test_spatial_graphs
import test_stpere
import test_toro
import test_waterlinked
from bags import messages_of, write_bag
from hostile import Files
from missions import every_sensor_mission
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import Writer as Writer1

from gtsam_nav.cards import Card, read_yaml, with_mission
from gtsam_nav.config import Config, load_config
from gtsam_nav.errors import GtsamNavError
from gtsam_nav.readers import describe, open_mission
from gtsam_nav.readers.clouds import load
from gtsam_nav.series import CloudSeries
from gtsam_nav.writers.exports import FORMATS, export_run
from gtsam_nav.writers.mission_folder import write_mission
from gtsam_nav.writers.run_folder import read_run, write_run
from gtsam_nav.writers.trajectories import read_trajectory

Maker = Callable[[Path], Path]
"""Writes a sample into a folder and returns the path to open."""


def folder(place: Path) -> Path:
    (place / "clouds").mkdir()
    write_mission(every_sensor_mission(place / "clouds"), place / "mission")
    return place / "mission"


def text(name: str, lines: list[str]) -> Maker:
    def make(place: Path) -> Path:
        (place / name).write_text("\n".join(lines) + "\n")
        return place / name

    return make


def bag(kind: str, n_messages: int | None = None) -> Maker:
    def make(place: Path) -> Path:
        messages = messages_of(test_rosbag.mission(), kind)
        if n_messages is not None:
            # a few of each sensor, so that a case takes little time
            messages = iter([*messages][:: max(1, 320 // n_messages)])
        return write_bag(place / "round", kind, islice(messages, None))

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
NMEA_OF_A_BOAT = [
    line
    for k in range(6)
    for line in (
        test_nmea.rmc(f"12000{k}.0", "010224"),
        test_nmea.hdg(10.0 * k, "2.5,W"),
        test_nmea.vhw(4.0 + k),
    )
]
CARMEN = [
    line
    for k in range(6)
    for line in (test_carmen.odom(k, 0.1 * k), test_carmen.laser(k, 1 + k, 2, 3, 4))
]

SAMPLES: dict[str, Maker] = {
    "mission folder": folder,
    "St. Pere logs": test_stpere.logs,
    "UTIAS MRCLAM": test_mrclam.files,
    "RTKLIB with an IMU": test_rtklib.log,
    "TORO graph": text("park.txt", test_toro.GRAPH.splitlines()),
    "Plaza": test_plaza.texts,
    "ROS bag": bag("ros1"),
    "NMEA 0183 log": text("log.nmea", NMEA),
    "Water Linked JSON": text("dvl.txt", [test_waterlinked.report(100, 0.1 * k) for k in range(6)]),
    "CARMEN log": text("log.clf", CARMEN),
    "Ping360 dump": test_ping360.dump,
    "g2o graph": text("park.g2o", test_g2o_graphs.GRAPH.splitlines()),
    "cloud files": test_cloud_files.files,
}
BY_CARD: dict[str, Maker] = {"CSV with a card": test_csv_files.files}
"""Readers that do not open anything without a card."""


@dataclass(frozen=True)
class Subject:
    """What is fuzzed: a sample, and what reads it.

    ``mend`` makes good what would hide damage further inside, such as checksums; ``share`` is how
    many cases it gets beside the others.
    """

    make: Maker
    read: Callable[[Path], object]
    mend: Callable[[bytes], bytes] = bytes
    share: float = 1.0


def open_whole(path: Path) -> None:
    """Open a mission, and all of its clouds, which are read late."""
    mission = open_mission(path)
    for sensor in mission.sensors.values():
        if isinstance(sensor.series, CloudSeries):
            for cloud in sensor.series.clouds:
                load(cloud)


def open_by_card(path: Path) -> None:
    """List the columns of CSV files, then read those that the card among them names."""
    describe(path)
    card = with_mission(path / "card.yaml")
    describe(path, card)
    open_mission(path, card=card)


def open_bag_and_list(path: Path) -> None:
    """List the topics of a bag, then read it."""
    describe(path)
    open_whole(path)


def read_settings(path: Path) -> None:
    """A file of settings, then the same as a data set's card."""
    for read in (load_config, lambda p: read_yaml(p, Card)):
        try:
            read(path)
        except GtsamNavError:
            continue


def read_exported(path: Path) -> None:
    """A run's folder, and what of it can be exported."""
    read_run(path)
    for name in FORMATS:
        export_run(path, [name])


def with_checksums(data: bytes) -> bytes:
    """NMEA sentences whose checksums are right again."""

    def summed(match: re.Match[bytes]) -> bytes:
        checksum = 0
        for byte in match[1].decode("utf-8", "replace"):
            checksum ^= ord(byte)
        return b"$%b*%02X" % (match[1], checksum & 0xFF)

    return re.sub(rb"\$([^*$\r\n]*)\*[0-9A-Fa-f]*", summed, data)


def card_and_files(place: Path) -> Path:
    sensors = {"imu": test_csv_files.IMU, "depth": test_csv_files.DEPTH}
    test_csv_files.card(place, **sensors)
    return test_csv_files.files(place)


def gzipped_nmea(place: Path) -> Path:
    (place / "log.nmea.gz").write_bytes(gzip.compress("\n".join(NMEA).encode(), mtime=0))
    return place / "log.nmea.gz"


def bzipped_carmen(place: Path) -> Path:
    (place / "log.clf.bz2").write_bytes(bz2.compress("\n".join(CARMEN).encode()))
    return place / "log.clf.bz2"


def packed(path: Path, compression: str) -> Path:
    """A ROS 1 bag again, with compressed chunks."""
    target = path.with_name(f"packed-{compression}.bag")
    writer = Writer1(target)
    writer.set_compression(Writer1.CompressionFormat[compression])
    with Reader1(path) as reader, writer:
        added = {
            c.id: writer.add_connection(c.topic, c.msgtype, msgdef=c.msgdef.data, md5sum=c.digest)
            for c in reader.connections
        }
        for connection, stamp, raw in reader.messages():
            writer.write(added[connection.id], stamp, raw)
    path.unlink()
    return target


def packed_bag(place: Path) -> Path:
    return packed(bag("ros1", 40)(place), "BZ2")


def ply_and_pcd(place: Path) -> Path:
    points = "".join(f"{k} {k / 2} {-k} {k / 10}\n" for k in range(8))
    (place / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\n"
        f"property float z\nproperty float t\nend_header\n{points}"
    )
    raw = np.arange(24, dtype="<f4").tobytes()
    header = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 8\nproperty float x\n"
        "property float y\nproperty float z\nend_header\n"
    )
    (place / "b.ply").write_bytes(header.encode() + raw)
    pcd = (
        "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 8\nHEIGHT 1\n"
        "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 8\nDATA "
    )
    (place / "c.pcd").write_bytes(f"{pcd}binary\n".encode() + raw)
    rows = "".join(f"{k} {k} {k}\n" for k in range(8))
    (place / "d.pcd").write_text(f"{pcd}ascii\n{rows}")
    return place


def settings(place: Path) -> Path:
    (place / "settings.yaml").write_text(Config().to_yaml())
    return place / "settings.yaml"


def data_card(place: Path) -> Path:
    path = Path(__file__).parents[2] / "datasets" / "stpere.yaml"
    (place / "card.yaml").write_text(path.read_text())
    return place / "card.yaml"


def trajectory(name: str) -> Maker:
    def make(place: Path) -> Path:
        run = write_run(solutions.dr_solution(), Config(), place)
        export_run(run, ["kitti"])
        kitti = run / "export" / "trajectory.kitti"
        lines = (kitti if name == "trajectory.kitti" else run / name).read_text().splitlines()[:20]
        target = place / "few"
        target.mkdir()
        (target / name).write_text("\n".join(lines) + "\n")
        (target / "times.txt").write_text("".join(f"{k}\n" for k in range(len(lines))))
        return target / name

    return make


def run_folder(place: Path) -> Path:
    return write_run(solutions.graph_solution(), Config(), place)


SUBJECTS: dict[str, Subject] = {
    **{name: Subject(make, open_whole) for name, make in SAMPLES.items()},
    "ROS bag": Subject(bag("ros1", 40), open_bag_and_list, share=0.15),
    "ROS bag, packed": Subject(packed_bag, open_whole, share=0.15),
    "ROS bag, db3": Subject(bag("sqlite3", 40), open_whole, share=0.15),
    "ROS bag, mcap": Subject(bag("mcap", 40), open_whole, share=0.15),
    "NMEA 0183 log": Subject(SAMPLES["NMEA 0183 log"], open_whole, with_checksums),
    "NMEA 0183 log of a boat": Subject(
        text("boat.nmea", NMEA_OF_A_BOAT), open_whole, with_checksums
    ),
    "NMEA, gzipped": Subject(gzipped_nmea, open_whole),
    "CARMEN, bzipped": Subject(bzipped_carmen, open_whole),
    "CSV with a card": Subject(card_and_files, open_by_card),
    "g2o graph in space": Subject(
        text("sphere.g2o", test_spatial_graphs.GRAPH.splitlines()), open_whole, share=0.5
    ),
    "TORO graph in space": Subject(
        text("sphere.txt", test_spatial_graphs.TORO_GRAPH.splitlines()), open_whole, share=0.5
    ),
    "Plaza, MATLAB": Subject(test_plaza.mat, open_whole),
    "cloud files": Subject(ply_and_pcd, open_whole),
    "settings": Subject(settings, read_settings, share=0.5),
    "data-set card": Subject(data_card, read_settings, share=0.5),
    "TUM trajectory": Subject(trajectory("trajectory.tum"), read_trajectory),
    "KITTI trajectory": Subject(trajectory("trajectory.kitti"), read_trajectory),
    "CSV trajectory": Subject(trajectory("trajectory.csv"), read_trajectory),
    "run": Subject(run_folder, read_exported, share=0.15),
}


def files_of(place: Path) -> Files:
    """What a sample has written, by name."""
    return {
        str(path.relative_to(place)): path.read_bytes()
        for path in sorted(place.rglob("*"))
        if path.is_file()
    }


def write_files(place: Path, files: Files, mend: Callable[[bytes], bytes] = bytes) -> None:
    """Write files, and the folders that they need."""
    for name, contents in files.items():
        path = place / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(mend(contents))
