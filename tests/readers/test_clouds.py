"""Clouds from files and messages: what is read, what is dropped, and what is refused."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from gtsam_nav.errors import DataError
from gtsam_nav.readers._pointcloud2 import cloud_of_message
from gtsam_nav.readers.clouds import cloud_table, load, read_cloud
from gtsam_nav.series import Cloud

POINTS = np.array([[1.0, 2.0, 3.0], [np.nan, 0.0, 0.0], [4.0, 5.0, 6.0]])
TIMES = np.array([0.0, 0.01, 0.02])


@dataclass
class Field:
    name: str
    offset: int
    datatype: int
    count: int = 1


@dataclass
class Message:
    """A PointCloud2, as a bag's reader gives it."""

    fields: list[Field]
    data: np.ndarray
    point_step: int
    width: int
    height: int = 1
    is_bigendian: bool = False
    row_step: int = field(default=0)

    def __post_init__(self) -> None:
        self.row_step = self.row_step or self.width * self.point_step


def message(time_name: str = "t", time_format: str = "<u4", times: object = None) -> Message:
    """Velodyne's layout: x, y, z, four bytes that nobody names, a time, and a ring."""
    at = [0, 4, 8, 16, 24]
    order = time_format[0]
    formats = [f"{order}f4"] * 3 + [time_format, f"{order}u2"]
    names = ["x", "y", "z", time_name, "ring"]
    records = np.zeros(
        3, np.dtype({"names": names, "formats": formats, "offsets": at, "itemsize": 32})
    )
    for axis, column in zip("xyz", POINTS.T, strict=True):
        records[axis] = column
    records[time_name] = np.array([0, 10_000_000, 20_000_000]) if times is None else times
    codes = {"u4": 6, "f4": 7, "f8": 8}
    kinds = [7, 7, 7, codes[time_format[1:]], 4]
    return Message(
        [Field(*about) for about in zip(names, at, kinds, strict=True)],
        np.frombuffer(records.tobytes(), np.uint8),
        32,
        3,
        is_bigendian=order == ">",
    )


@pytest.mark.parametrize("columns", [3, 4])
def test_npy_with_and_without_times(tmp_path: Path, columns: int) -> None:
    table = np.column_stack([POINTS, TIMES])[:, :columns]
    np.save(tmp_path / "cloud.npy", table)
    cloud = read_cloud(tmp_path / "cloud.npy")
    np.testing.assert_array_equal(cloud.points_s, POINTS[[0, 2]])
    assert (cloud.offset_s is None) == (columns == 3)
    np.testing.assert_array_equal(cloud_table(cloud), table[[0, 2]])


def test_a_cloud_in_memory_is_loaded_as_it_is() -> None:
    cloud = Cloud(POINTS[[0, 2]])
    assert load(cloud) is cloud


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (np.zeros((3, 2)), r"shape \(k, 3\).*not \(3, 2\)"),
        (np.zeros((3, 3), dtype=int), "floating-point"),
        (b"not numpy", "cannot read the cloud"),
        (None, "cannot read the cloud"),
    ],
)
def test_a_bad_npy_is_named(tmp_path: Path, content: object, complaint: str) -> None:
    path = tmp_path / "cloud.npy"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        np.save(path, content)
    with pytest.raises(DataError, match=complaint) as caught:
        read_cloud(path)
    assert caught.value.path == path


def test_other_endings_are_refused_with_the_choices(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"\.npy, \.ply, \.pcd"):
        read_cloud(tmp_path / "cloud.las")


@pytest.mark.usefixtures("open3d_here")
@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
def test_ply_and_pcd_with_times(tmp_path: Path, suffix: str) -> None:
    import open3d as o3d

    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(POINTS[[0, 2]].astype(np.float32)))
    cloud.point["t"] = o3d.core.Tensor(TIMES[[0, 2], None].astype(np.float32))
    path = tmp_path / f"cloud{suffix}"
    assert o3d.t.io.write_point_cloud(str(path), cloud)
    read = read_cloud(path)
    np.testing.assert_allclose(read.points_s, POINTS[[0, 2]])
    assert read.offset_s is not None
    np.testing.assert_allclose(read.offset_s, TIMES[[0, 2]], atol=1e-6)


@pytest.mark.parametrize(
    ("points", "offsets"),
    [(np.zeros((3, 2)), None), (np.zeros((3, 3)), np.zeros(2)), (POINTS, None)],
)
def test_a_cloud_is_validated(points: np.ndarray, offsets: np.ndarray | None) -> None:
    with pytest.raises(ValueError, match="Cloud"):
        Cloud(points, offsets)


@pytest.mark.parametrize(
    ("name", "form", "times"),
    [
        ("t", "<u4", None),
        ("t", ">u4", None),
        ("time", "<f4", TIMES),
        ("offset_time", "<u4", None),
        ("timestamp", "<f8", 1.7e9 + TIMES),
    ],
)
def test_messages_of_several_makers(name: str, form: str, times: object) -> None:
    cloud = cloud_of_message(message(name, form, times), 1.7e9)
    np.testing.assert_array_equal(cloud.points_s, POINTS[[0, 2]])
    assert cloud.offset_s is not None
    np.testing.assert_allclose(cloud.offset_s, TIMES[[0, 2]], atol=1e-6)


def test_times_that_count_something_else_are_not_taken() -> None:
    cloud = cloud_of_message(message("timestamp", "<f8", 55.0 + TIMES), 1.7e9)
    assert cloud.offset_s is None


def test_rows_may_be_padded() -> None:
    flat = message()
    padded = np.concatenate([flat.data, np.zeros(8, np.uint8)])
    rows = Message(flat.fields, np.tile(padded, 2), 32, 3, height=2, row_step=104)
    assert len(cloud_of_message(rows, 0.0)) == 4


def test_a_message_without_z_names_its_fields() -> None:
    flat = message()
    flat.fields = flat.fields[:2]
    with pytest.raises(DataError, match="without z; its fields are: x, y"):
        cloud_of_message(flat, 0.0)


def test_a_message_of_integers_is_refused() -> None:
    flat = message()
    flat.fields[0].datatype = 5
    with pytest.raises(DataError, match="field 'x' has datatype 5"):
        cloud_of_message(flat, 0.0)


def test_a_cut_message_is_refused() -> None:
    flat = message()
    flat.data = flat.data[:-1]
    with pytest.raises(DataError, match="it holds 95 bytes"):
        cloud_of_message(flat, 0.0)
