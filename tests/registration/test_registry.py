"""Every registration method of the registry keeps the same promises."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gtsam_nav.errors import ConfigError, PackageError
from gtsam_nav.frames import Array
from gtsam_nav.registration import packages, register, registrations
from gtsam_nav.registration.result import RelativePose

SIGMA = np.r_[[np.radians(3.0)] * 3, [0.4] * 3]
PLANAR = [2, 3, 4]


@pytest.fixture(params=registrations())
def method(request: pytest.FixtureRequest) -> str:
    name = str(request.param)
    if name.startswith("open3d"):
        request.getfixturevalue("open3d_here")
    return name


def quay(seed: int, n: int = 1500, noise_m: float = 0.02) -> Array:
    """Two quay walls at a right angle, a jetty across and the bottom, seen once with noise."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.0, 1.0, size=(2, n))
    one = np.ones_like(a)
    walls = [
        np.column_stack([20 * a - 10, 8 * one, 4 * b - 3]),
        np.column_stack([10 * one, 16 * a - 8, 4 * b - 3]),
        np.column_stack([2 * a - 8, -4 * one, 4 * b - 3]),
        np.column_stack([20 * a - 10, 16 * b - 8, one]),
    ]
    points = np.concatenate(walls)
    return np.asarray(points + rng.normal(scale=noise_m, size=points.shape))


def corridor(seed: int) -> Array:
    """Two parallel walls and the bottom: nothing tells the way along."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.0, 1.0, size=(2, 3000))
    one = np.ones_like(a)
    walls = [np.column_stack([60 * a - 30, side * one, 4 * b - 3]) for side in (5.0, -5.0)]
    points = np.concatenate([*walls, np.column_stack([60 * a - 30, 10 * b - 5, one])])
    return np.asarray(points + rng.normal(scale=0.02, size=points.shape))


def pose(turn: list[float], shift: list[float]) -> RelativePose:
    return RelativePose(Rotation.from_rotvec(turn).as_matrix(), np.array(shift), np.diag(SIGMA**2))


def seen_from(points: Array, there: RelativePose) -> Array:
    return np.asarray((points - there.p_a) @ there.R_ab)


def relevant(method: str) -> list[int]:
    return PLANAR if method in registrations(planar=True) else list(range(6))


@pytest.mark.parametrize("seed", range(3))
def test_finds_the_pose_and_knows_how_well(method: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    which = relevant(method)
    wrong = np.zeros(6)
    wrong[which] = rng.normal(size=len(which)) * SIGMA[which]
    true = pose([0.0, 0.0, 0.2], [0.5, -0.4, 0.0])
    start = pose([0.0, 0.0, 0.2 + wrong[2]], (true.p_a + wrong[3:]).tolist())
    reference, new = quay(seed), quay(seed + 50)
    if method in registrations(planar=True):  # looks at walls only, and takes its time
        reference, new = reference[:4500:15], new[:4500:15]
    match = register(method, reference, seen_from(new, true), start)
    error = match.pose.error_of(true.R_ab, true.p_a)[which]
    assert match.ok, match.failure
    assert match.fitness > 0.8
    assert np.linalg.norm(error[-2:]) < 0.05
    assert np.abs(error[which.index(2)]) < np.radians(0.2)
    cov = match.pose.cov[np.ix_(which, which)]
    np.testing.assert_allclose(cov, cov.T)
    assert error @ np.linalg.solve(cov, error) < 4 * len(which)


def test_says_the_same_every_time(method: str) -> None:
    true = pose([0.0, 0.0, 0.1], [0.3, 0.1, 0.0])
    start = pose([0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    first, second = (
        register(method, quay(1, 200), seen_from(quay(2, 200), true), start) for _ in range(2)
    )
    np.testing.assert_array_equal(first.pose.R_ab, second.pose.R_ab)
    np.testing.assert_array_equal(first.pose.p_a, second.pose.p_a)
    np.testing.assert_array_equal(first.pose.cov, second.pose.cov)


@pytest.mark.parametrize("new", [np.empty((0, 3)), quay(3)[:2], quay(3) + 500.0])
def test_failure_has_a_reason_and_is_no_identity(method: str, new: Array) -> None:
    start = pose([0.0, 0.0, 0.05], [0.3, -0.2, 0.0])
    match = register(method, quay(0), new, start)
    assert not match.ok
    assert match.failure
    assert np.linalg.norm(match.pose.p_a) > 0.1


@pytest.mark.usefixtures("open3d_here")
@pytest.mark.parametrize("method", registrations(planar=False))
def test_a_corridor_shows_in_the_covariance(method: str) -> None:
    start = pose([0.0, 0.0, 0.0], [0.2, 0.1, 0.0])
    match = register(method, corridor(0), corridor(1), start)
    sigma = np.sqrt(np.diag(match.pose.cov)[3:])
    assert sigma[0] > 0.2
    assert sigma[0] > 20 * sigma[1:].max()


def test_what_a_planar_method_does_not_see_stays_as_expected() -> None:
    start = pose([0.02, -0.01, 0.0], [0.2, 0.1, 0.7])
    match = register("pic", quay(0, 50), seen_from(quay(1, 50), pose([0.0] * 3, [0.0] * 3)), start)
    assert match.pose.p_a[2] == 0.7
    np.testing.assert_array_equal(np.diag(match.pose.cov)[[0, 1, 5]], SIGMA[[0, 1, 5]] ** 2)
    tilt = Rotation.from_matrix(match.pose.R_ab).as_euler("ZYX")[1:]
    np.testing.assert_allclose(
        tilt, Rotation.from_matrix(start.R_ab).as_euler("ZYX")[1:], atol=1e-12
    )


def test_an_unknown_method_names_the_choices() -> None:
    with pytest.raises(ConfigError, match="open3d-gicp"):
        register("icp", quay(0), quay(1), pose([0.0] * 3, [0.0] * 3))


@pytest.mark.parametrize("trouble", ["libX11.so.6: cannot open shared object file", "not there"])
def test_a_package_that_does_not_import_is_named(
    trouble: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(packages, "_attempt", lambda _: (None, trouble))
    with pytest.raises(PackageError, match=f"open3d-icp needs the package open3d.*{trouble}"):
        register("open3d-icp", quay(0), quay(1), pose([0.0] * 3, [0.0] * 3))


def test_of_a_module_the_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packages, "_attempt", lambda module: (None, f"no {module}"))
    with pytest.raises(PackageError, match=r"deskewing needs the package kiss_icp, .*kiss_icp\.x"):
        packages.kiss_icp("deskewing", "x")


@pytest.mark.realdata
@pytest.mark.usefixtures("open3d_here")
@pytest.mark.parametrize("method", registrations(planar=False))
def test_a_recorded_lidar_pair_from_identity(method: str, recorded_data: Path) -> None:
    from gtsam_nav.readers.clouds import read_cloud

    folder = recorded_data / "lidar_pair"
    source, target = (read_cloud(folder / f"{k}.ply").points_s for k in ("source", "target"))
    T_true = np.loadtxt(folder / "T_target_source.txt")
    match = register(method, target, source, pose([0.0] * 3, [0.0] * 3))
    turn = match.pose.error_of(T_true[:3, :3], T_true[:3, 3])[:3]
    assert match.ok
    assert np.linalg.norm(match.pose.p_a - T_true[:3, 3]) < 0.02
    assert np.degrees(np.linalg.norm(turn)) < 0.3


@pytest.mark.parametrize(
    ("trouble", "hint"),
    [
        (ModuleNotFoundError("no"), "pip install kiss-icp"),
        (ImportError("libX11"), "a library of the system"),
        (OSError("libgomp"), "a library of the system"),
    ],
)
def test_trouble_with_an_import_has_a_hint(
    trouble: Exception, hint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(_: str) -> None:
        raise trouble

    monkeypatch.setattr(packages, "import_module", fails)
    found, said = packages._attempt.__wrapped__("kiss_icp.deskew")
    assert found is None
    assert str(trouble) in said
    assert hint in said
