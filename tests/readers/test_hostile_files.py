"""Hostile files end in this package's own errors: some of `benchmarks.fuzz`, what it found."""

from __future__ import annotations

import gzip
import shutil
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random

import lz4.frame
import numpy as np
import pytest
import solutions
import test_ping360
import test_waterlinked
from bags import Messages, write_bag
from hostile import Files, hostile
from hypothesis import given, settings
from hypothesis import strategies as st
from missions import one_sensor_folder
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import storage_mcap
from samples import SUBJECTS, files_of, packed, write_files

from gtsam_nav.config import Config, load_config
from gtsam_nav.errors import ConfigError, DataError, GtsamNavError
from gtsam_nav.readers import _ros_archives, open_mission
from gtsam_nav.readers._ros_archives import bound_chunks
from gtsam_nav.readers.clouds import read_cloud
from gtsam_nav.writers.exports import export_run
from gtsam_nav.writers.run_folder import read_run, write_run

LONG = "9" * 400
SLOW = pytest.mark.slow


@dataclass(frozen=True)
class Sample:
    opened: Path
    files: Files
    place: Path


@pytest.fixture(scope="module")
def sample(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Sample:
    place = tmp_path_factory.mktemp("sample")
    opened = SUBJECTS[request.param].make(place).relative_to(place)
    return Sample(opened, files_of(place), tmp_path_factory.mktemp("hostile"))


@pytest.mark.parametrize(
    ("name", "sample"),
    [pytest.param(n, n, marks=SLOW if s.share < 0.5 else ()) for n, s in SUBJECTS.items()],
    indirect=["sample"],
)
@settings(max_examples=6)
@given(random=st.randoms(use_true_random=False))
def test_only_this_package_s_errors_come_out(name: str, sample: Sample, random: Random) -> None:
    subject = SUBJECTS[name]
    case = sample.place / "case"
    shutil.rmtree(case, ignore_errors=True)
    case.mkdir()
    write_files(case, hostile(sample.files, random), subject.mend)
    with suppress(GtsamNavError):
        subject.read(case / sample.opened)


def test_a_case_is_told_by_its_number() -> None:
    files = {"a.txt": b"t,depth_m\n0,1\n1,2\n", "b.bin": bytes(range(200))}
    cases = [hostile(files, Random(f"x 0 {k}")) for k in range(50)]
    assert cases == [hostile(files, Random(f"x 0 {k}")) for k in range(50)]
    assert sum(case != files for case in cases) > 45


@pytest.mark.parametrize("key", ["time", "vx", "altitude"])
def test_a_report_with_a_number_beyond_floats_does_not_stop_the_log(
    tmp_path: Path, key: str
) -> None:
    lines = [test_waterlinked.report(100, 0.1 * k) for k in range(4)]
    lines.append(test_waterlinked.report(100, 0.5).replace(f'"{key}":', f'"{key}": {LONG}, "x":'))
    (tmp_path / "dvl.txt").write_text("\n".join(lines) + "\n")
    mission = open_mission(tmp_path / "dvl.txt")
    assert len(mission.sensors["dvl"].series) >= 4


@pytest.mark.parametrize(
    ("file", "line"), [("timestamp.dat", f"-{'f' * 400}"), ("sample_period.dat", "5e-324")]
)
def test_a_beam_with_an_impossible_field_is_left_out(tmp_path: Path, file: str, line: str) -> None:
    path = test_ping360.dump(tmp_path)
    whole = len(open_mission(path).sensors["sonar"].series)
    lines = (path / file).read_text().splitlines()
    lines[0] = line if file != "timestamp.dat" else " ".join([line] * 9)
    (path / file).write_text("\n".join(lines) + "\n")
    assert len(open_mission(path).sensors["sonar"].series) == whole - 1


def test_a_dump_without_a_plausible_period_is_an_error(tmp_path: Path) -> None:
    path = test_ping360.dump(tmp_path)
    n = len((path / "sample_period.dat").read_text().splitlines())
    (path / "sample_period.dat").write_text("5e-324\n" * n)
    with pytest.raises(DataError, match="no beam holds echoes and a sample period"):
        open_mission(path)


HEADERS = ("{'descr': '<f8', 'fortran_order': False, 'shape': (3, 3), ", "(" * 150, "{" * 150)


@pytest.mark.parametrize("header", HEADERS)
def test_a_header_of_numpy_that_does_not_end_is_an_error(tmp_path: Path, header: str) -> None:
    text = header.encode().ljust(246) + b"\n"
    path = tmp_path / "cloud.npy"
    path.write_bytes(b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text)
    with pytest.raises(DataError, match="cannot read the cloud"):
        read_cloud(path)


def test_a_cloud_that_claims_more_than_memory_holds_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "cloud.npy"
    with path.open("wb") as stream:
        header = {"descr": "<f8", "fortran_order": False, "shape": (2**45, 3)}
        np.lib.format.write_array_header_1_0(stream, header)
    with pytest.raises(DataError, match="cannot read the cloud"):
        read_cloud(path)


def test_a_bag_whose_summary_makes_no_sense_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    m = Messages("ros1")
    path = write_bag(tmp_path / "x", "ros1", [("/imu", "sensor_msgs/msg/Imu", 0.0, m.imu(0.0))])
    monkeypatch.setattr(AnyReader, "start_time", property(lambda _: min(0, "never")))
    with pytest.raises(DataError, match="the bag cannot be opened"):
        open_mission(path)


def test_no_code_comes_from_the_names_in_a_bag(tmp_path: Path) -> None:
    """The reader of bags makes Python classes of message definitions: of those alone."""
    marker = tmp_path / "owned"
    attack = f"open({str(marker)!r}, 'w')"
    names = (f"a/msg/B:\n    {attack}\nclass C", f'a/msg/B"""\n    {attack}\n    """')
    for k, name in enumerate((*names, "a/msg/B")):
        path = tmp_path / f"{k}.bag"
        definition = "uint8 x" if name in names else f"uint8 x: int = {attack}"
        with Writer1(path) as writer:
            connection = writer.add_connection("/x", name, msgdef=definition, md5sum="*")
            writer.write(connection, 10**9, b"\0")
        with pytest.raises(DataError):
            open_mission(path)
    assert not marker.exists()


@pytest.mark.parametrize("compression", ["BZ2", "LZ4"])
def test_a_chunk_of_a_bag_that_unpacks_without_end_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compression: str
) -> None:
    m = Messages("ros1")
    messages = [("/imu", "sensor_msgs/msg/Imu", 0.1 * k, m.imu(0.1 * k)) for k in range(90)]
    path = packed(write_bag(tmp_path / "x", "ros1", messages), compression)
    assert len(open_mission(path).sensors["imu"].series) == 90
    monkeypatch.setattr(_ros_archives, "MAX_CHUNK_BYTES", 10_000)
    with pytest.raises(DataError, match="a chunk unpacks to more than 10000 bytes"):
        open_mission(path)


@pytest.mark.parametrize("compression", ["LZ4", "ZSTD"])
def test_nor_is_a_chunk_of_mcap(monkeypatch: pytest.MonkeyPatch, compression: str) -> None:
    data = {"LZ4": lz4.frame.compress, "ZSTD": storage_mcap.zstd.compress}
    bomb = data[compression](bytes(1_000_000))
    bound_chunks()
    unpack = storage_mcap.DECOMPRESSORS[compression.lower()]
    assert len(unpack(bomb, 1_000_000)) == 1_000_000
    monkeypatch.setattr(_ros_archives, "MAX_CHUNK_BYTES", 10_000)
    with pytest.raises(ValueError, match="more than 10000 bytes"):
        unpack(bomb, 1_000_000)


@pytest.mark.parametrize("text", ["seed: " + "9" * 5000, "[" * 1000, "a: " * 1000, "- " * 1000])
def test_settings_that_break_the_parser_are_an_error(tmp_path: Path, text: str) -> None:
    path = tmp_path / "settings.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"settings\.yaml"):
        load_config(path)


def bombs() -> Iterator[str]:
    """Maps merged into each other, and lists of aliases: a billion values by some hundred words."""
    merged = [f"a{k}: &a{k} {{<<: [*a{k - 1}, *a{k - 1}]}}" for k in range(1, 31)]
    yield "\n".join(["a0: &a0 {k: 1, l: 2}", *merged, "noise: {<<: *a30}"])
    listed = [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 11)]
    yield "\n".join(["a0: &a0 [x]", *listed, "noise: *a10"])


@pytest.mark.parametrize("bomb", [*bombs()])
@pytest.mark.parametrize("place", ["name", "initial", "noise"])
def test_yaml_that_unfolds_without_end_is_refused_at_once(
    tmp_path: Path, bomb: str, place: str
) -> None:
    last = bomb.splitlines()[-1].removeprefix("noise: ")
    sensor = f"{{file: x.csv, noise: {last if place == 'noise' else '{}'}}}"
    head = "\n".join(bomb.splitlines()[:-1])
    text = f"{head}\nsensors: {{depth: {sensor}}}\n" + (
        f"{place}: {last}" if place != "noise" else ""
    )
    folder = one_sensor_folder(tmp_path, "depth", "t,depth_m\n0,1\n")
    (folder / "mission.yaml").write_text(text)
    with pytest.raises(DataError) as caught:
        open_mission(folder)
    assert len(str(caught.value)) < 2000
    # the same where the rest is right
    body = f"sensors:\n  always: {{type: depth, file: always.csv}}\n{place}: {last}\n"
    (folder / "mission.yaml").write_text(body.replace("noise:", "name:"))
    with pytest.raises(DataError):
        open_mission(folder)


def test_a_description_as_large_as_a_log_is_refused(tmp_path: Path) -> None:
    folder = one_sensor_folder(tmp_path, "depth", "t,depth_m\n0,1\n")
    with (folder / "mission.yaml").open("a") as stream:
        stream.write("#" * 200_000)
    with pytest.raises(DataError, match="larger than 100000 bytes"):
        open_mission(folder)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return write_run(solutions.graph_solution(), Config(), tmp_path)


@pytest.mark.parametrize(
    ("file", "contents", "message"),
    [
        ("graph.g2o", b"\xff\xfe", "cannot be read"),
        ("graph.g2o", b"\n\n", "'' with 0 numbers"),
        ("graph.g2o", b"EDGE_SE3:QUAT nan" + b" 1" * 29, "not finite"),
        ("vertex_times.csv", b"vertex,time\n0,1\n", "0 times of"),
    ],
)
def test_a_damaged_pose_graph_is_named(run: Path, file: str, contents: bytes, message: str) -> None:
    (run / file).write_bytes(contents)
    with pytest.raises(DataError, match=message):
        export_run(run, ["g2o"])


def test_a_run_whose_trajectories_differ_in_length_is_an_error(run: Path) -> None:
    lines = (run / "trajectory.csv").read_text().splitlines(keepends=True)
    (run / "trajectory.csv").write_text("".join(lines[:5]))
    with pytest.raises(DataError, match=r"trajectory\.csv has 4 poses"):
        read_run(run)


def test_gzipped_text_in_an_archive_of_an_archive_is_no_way_in(tmp_path: Path) -> None:
    twice = gzip.compress(gzip.compress(b"t,depth_m\n0,1\n"))
    with pytest.raises(DataError, match=r"not utf-8|column"):
        open_mission(one_sensor_folder(tmp_path, "depth", twice))
