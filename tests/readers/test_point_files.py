"""PLY and PCD files: every storage, and Open3D's own files where it is here; damage is named."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from gtsam_nav.errors import DataError
from gtsam_nav.readers.clouds import read_cloud

POINTS = np.array([[1.0, 2.0, -3.0], [0.5, 0.0, 7.25]], dtype="<f4")
TIMES = np.array([0.0, 0.125], dtype="<f4")
PLY = (
    "ply\r\nformat {} 1.0\ncomment made by hand\nelement vertex {}\nproperty float x\n"
    "property float y\nproperty float z\nproperty uchar red\nproperty float t\n"
    "element face 1\nproperty list uchar int vertex_index\nend_header\n"
)
PCD = (
    "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z _ t\nSIZE 4 4 4 1 4\nTYPE F F F U F\nCOUNT 1 1 1 3 1\n"
    "WIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {}\nDATA {}\n"
)


def ply(kind: str, n: int = 2) -> bytes:
    if kind == "ascii":
        rows = [f"{x} {y} {z} 9 {t}\n" for (x, y, z), t in zip(POINTS, TIMES, strict=True)]
        body = ("".join(rows) + "3 0 1 1\n").encode()
    else:
        order = "<" if "little" in kind else ">"
        rows = zip(POINTS.tolist(), TIMES.tolist(), strict=True)
        body = b"".join(struct.pack(f"{order}fffBf", *p, 9, t) for p, t in rows)
        body += b"\x03" + bytes(12)
    return PLY.format(kind, n).encode() + body


def compressed(fields: bytes) -> bytes:
    """LZF with both kinds of tokens: runs as they are, and a reference to the zeros before."""
    packed = b"".join(
        bytes([len(run) - 1]) + run
        for run in (fields[k : k + 32] for k in range(0, len(fields), 32))
    )
    return struct.pack("<II", len(packed), len(fields)) + packed


def pcd(kind: str, n: int = 2) -> bytes:
    if kind == "ascii":
        rows = [f"{x} {y} {z} 1 2 3 {t}\n" for (x, y, z), t in zip(POINTS, TIMES, strict=True)]
        body = "".join(rows).encode()
    elif kind == "binary":
        rows = zip(POINTS.tolist(), TIMES.tolist(), strict=True)
        body = b"".join(struct.pack("<fff3xf", *p, t) for p, t in rows)
    else:
        body = compressed(POINTS.T.tobytes() + bytes(6) + TIMES.tobytes())
    return PCD.format(n, kind).encode() + body


@pytest.mark.parametrize(
    ("suffix", "data"),
    [
        *((".ply", ply(k)) for k in ("ascii", "binary_little_endian", "binary_big_endian")),
        *((".pcd", pcd(k)) for k in ("ascii", "binary", "binary_compressed")),
    ],
)
def test_points_and_times_are_read(tmp_path: Path, suffix: str, data: bytes) -> None:
    path = tmp_path / f"cloud{suffix}"
    path.write_bytes(data)
    cloud = read_cloud(path)
    np.testing.assert_array_equal(cloud.points_s, POINTS)
    assert cloud.offset_s is not None
    np.testing.assert_array_equal(cloud.offset_s, TIMES)


def test_padding_of_a_text_repeats_its_name(tmp_path: Path) -> None:
    path = tmp_path / "padded.pcd"
    header = "FIELDS x _ y _ z\nSIZE 4 4 4 4 4\nTYPE F F F F F\nWIDTH 2\nHEIGHT 1\nPOINTS 2\n"
    path.write_text(f"{header}DATA ascii\n1 9 2 9 3\n4 9 5 9 6\n")
    np.testing.assert_array_equal(read_cloud(path).points_s, [[1, 2, 3], [4, 5, 6]])


def test_a_compressed_reference_repeats_what_was_before(tmp_path: Path) -> None:
    path = tmp_path / "zeros.pcd"
    header = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 10\nHEIGHT 1\nPOINTS 10\n"
    # one zero, then 119 more by a reference to it: seven and a byte for lengths beyond eight
    packed = bytes([0, 0, 7 << 5, 119 - 9, 0])
    sizes = struct.pack("<II", len(packed), 120)
    path.write_bytes(f"{header}DATA binary_compressed\n".encode() + sizes + packed)
    np.testing.assert_array_equal(read_cloud(path).points_s, np.zeros((10, 3)))


@pytest.mark.parametrize(
    ("suffix", "data", "message"),
    [
        (".ply", b"ply\n1 2 3", "no PLY file"),
        (".ply", b"ply\nformat ascii 1.0\nelement vertex 7\nend_header\n1 2", "no vertices with"),
        (".ply", ply("binary_little_endian", 10**11), "ends before the 100000000000 vertices"),
        (".ply", ply("ascii", 10**9), "holds 3 points of 1000000000|not of numbers"),
        (".ply", ply("ascii").replace(b"property float y", b"property quad y"), ":6: 'property"),
        (".ply", ply("ascii").replace(b"float y", b"float v"), "without y; they have: x, v, z"),
        (".pcd", b"VERSION .7", "no PCD file"),
        (".pcd", pcd("binary", 10**11), "not plausible"),
        (".pcd", pcd("binary", 10**7), "ends before the 10000000 points"),
        (".pcd", pcd("ascii", 3), "holds 2 points of 3"),
        (".pcd", pcd("binary").replace(b"TYPE F", b"TYPE V"), "one type for each field"),
        (".pcd", pcd("binary_compressed", 3), "ends early, or its points do not take 38 bytes"),
        (".pcd", pcd("binary_compressed")[:-4], "ends early"),
    ],
)  # fmt: skip
def test_what_is_damaged_is_named(tmp_path: Path, suffix: str, data: bytes, message: str) -> None:
    path = tmp_path / f"cloud{suffix}"
    path.write_bytes(data)
    with pytest.raises(DataError, match=message) as caught:
        read_cloud(path)
    assert caught.value.path == path


def test_compressed_points_that_refer_to_nothing_are_damaged(tmp_path: Path) -> None:
    data = bytearray(pcd("binary_compressed"))
    data[data.index(b"compressed\n") + 11 + 8] = 0xFF
    path = tmp_path / "cloud.pcd"
    path.write_bytes(data)
    with pytest.raises(DataError, match="compressed points are damaged"):
        read_cloud(path)


@pytest.mark.usefixtures("open3d_here")
@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
@pytest.mark.parametrize("as_text", [False, True])
@pytest.mark.parametrize("compress", [False, True])
def test_open3d_s_files_are_read(
    tmp_path: Path, suffix: str, as_text: bool, compress: bool
) -> None:
    import open3d as o3d

    points = np.random.default_rng(1).normal(size=(500, 3)).round(1)
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(points.astype(np.float32)))
    path = tmp_path / f"cloud{suffix}"
    kinds = {"write_ascii": as_text, "compressed": compress}
    assert o3d.t.io.write_point_cloud(str(path), cloud, **kinds)
    np.testing.assert_allclose(read_cloud(path).points_s, points, atol=1e-6)
