"""pIC against small_gicp and Open3D on pairs of scans, from starts of three spreads.

The pairs are those of St. Pere's ``pairs.csv``, or consecutive scans of the ACES laser log.

All get the same point sets and starts, and one thread (``OMP_NUM_THREADS=1`` for Open3D's). Times
are the processor's, per pair, with everything that a method makes of the points: covariances,
trees, voxels. Each repeat draws new starts. The others get, of three distances of correspondence,
that one with which they succeed most often. GICP takes its covariances from the neighbours of a
point, which all lie in one plane here and say nothing: it does what ICP does, unless the points
stand in layers, as walls. pIC's covariances are the sonar's, made with the scan, and not in its
time.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

import gtsam_nav as gn
from benchmarks.aces import near_relations, scans_of
from benchmarks.pairs import START_ERRORS, SUCCESS_DEG, SUCCESS_M, ScanPair, load_pairs
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.registration.pic import register

DISTANCES_M = (2.0, 5.0, 10.0)
MAX_ITERATIONS = 50
ACES_PAIRS = 200
LAYERS_M = (-1.0, 0.0, 1.0)

Align = Callable[[ScanPair, Array, Array], Array | None]
"""From a pair, a start and its covariance to x, y, yaw; None where it says that it failed."""


@dataclass(frozen=True)
class Registered:
    """What a method makes of all pairs."""

    success: float
    median_m: float
    ms_per_pair: float
    distance_m: float | None = None


def stpere_pairs(folder: Path) -> list[ScanPair]:
    """The pairs of ``pairs.csv``."""
    return load_pairs(folder, gn.load_config())


def aces_pairs(folder: Path) -> list[ScanPair]:
    """Of the surveyed relations between scans that follow each other, evenly chosen ones."""
    log = gn.open_mission(folder / "aces.clf.bz2")
    if log.relations is None:
        raise SystemExit(f"{folder}: aces.relations is missing")
    near = near_relations(log)
    chosen = np.linspace(0, len(near.t) - 1, ACES_PAIRS).round().astype(int)
    scans = scans_of(log, near)
    return [ScanPair(*scans[k], near.q[k]) for k in chosen]


def measure(pairs: list[ScanPair], repeats: int) -> dict[str, Any]:
    """Time, success and median error by method and spread."""
    config = gn.load_config()

    def pic(pair: ScanPair, prior: Array, cov: Array) -> Array | None:
        match = register(pair.reference, pair.new, prior, cov, config.pic)
        return match.q if match.ok else None

    spreads, ratios = {}, {}
    for start_m, start_deg in START_ERRORS:
        sigma = np.array([start_m, start_m, np.radians(start_deg)])
        rows = {"pIC": _run(pairs, pic, sigma, repeats)}
        for name, make in OTHERS.items():
            tried = [_run(pairs, make(d), sigma, 1, d) for d in DISTANCES_M]
            best = max(tried, key=lambda r: r.success).distance_m
            assert best is not None
            rows[name] = _run(pairs, make(best), sigma, repeats, best)
        spreads[f"{start_m:g} m {start_deg:g} deg"] = {k: asdict(r) for k, r in rows.items()}
        ratio = rows["pIC"].ms_per_pair / rows["small_gicp GICP"].ms_per_pair
        ratios[f"pic_over_gicp_{start_m:g}_m"] = ratio
        ratios[f"pic_misses_{start_m:g}_m"] = 1.0 - rows["pIC"].success
    return {"pairs": len(pairs), "spreads": spreads, "ratios": ratios}


def _run(
    pairs: list[ScanPair],
    align: Align,
    sigma: Array,
    repeats: int,
    distance_m: float | None = None,
) -> Registered:
    rng = np.random.default_rng(1)
    cov = np.diag(sigma**2)
    align(pairs[0], pairs[0].q_true, cov)  # compiles
    times, off = [], np.empty((repeats * len(pairs), 3))
    for k in range(repeats):
        priors = [pair.q_true + rng.normal(size=3) * sigma for pair in pairs]
        begin = time.process_time()
        found = [align(pair, prior, cov) for pair, prior in zip(pairs, priors, strict=True)]
        times.append(time.process_time() - begin)
        for row, (q, pair) in enumerate(zip(found, pairs, strict=True), start=k * len(pairs)):
            off[row] = np.inf if q is None else q - pair.q_true
    known = np.isfinite(off[:, 2])
    off[known, 2] = wrap_angle(off[known, 2])
    off_m, off_deg = np.hypot(off[:, 0], off[:, 1]), np.abs(np.degrees(off[:, 2]))
    return Registered(
        success=float(np.mean((off_m < SUCCESS_M) & (off_deg < SUCCESS_DEG))),
        median_m=float(np.median(off_m)),
        ms_per_pair=1e3 * statistics.median(times) / len(pairs),
        distance_m=distance_m,
    )


def _small_gicp(kind: str, layers: Sequence[float] = (0.0,)) -> Callable[[float], Align]:
    def make(distance_m: float) -> Align:
        import small_gicp

        def align(pair: ScanPair, prior: Array, _cov: Array) -> Array | None:
            result = small_gicp.align(
                _spatial(pair.reference.xy, layers),
                _spatial(pair.new.xy, layers),
                _transform(prior),
                registration_type=kind,
                downsampling_resolution=1e-3,  # all points, as pIC has them
                max_correspondence_distance=distance_m,
                max_iterations=MAX_ITERATIONS,
                num_threads=1,
            )
            return _planar(result.T_target_source) if result.converged else None

        return align

    return make


def _open3d(kind: str) -> Callable[[float], Align]:
    def make(distance_m: float) -> Align:
        import open3d as o3d

        registration = o3d.pipelines.registration
        criteria = registration.ICPConvergenceCriteria(max_iteration=MAX_ITERATIONS)

        def cloud(xy: Array) -> Any:
            return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(_spatial(xy)))

        def align(pair: ScanPair, prior: Array, _cov: Array) -> Array | None:
            both = cloud(pair.new.xy), cloud(pair.reference.xy)
            start = _transform(prior)
            if kind == "ICP":
                point = registration.TransformationEstimationPointToPoint()
                result = registration.registration_icp(*both, distance_m, start, point, criteria)
            else:
                general = registration.TransformationEstimationForGeneralizedICP()
                result = registration.registration_generalized_icp(
                    *both, distance_m, start, general, criteria
                )
            return _planar(result.transformation) if result.fitness > 0.0 else None

        return align

    return make


OTHERS: dict[str, Callable[[float], Align]] = {
    "small_gicp ICP": _small_gicp("ICP"),
    "small_gicp GICP": _small_gicp("GICP"),
    "small_gicp GICP in layers": _small_gicp("GICP", LAYERS_M),
    "Open3D ICP": _open3d("ICP"),
    "Open3D GICP": _open3d("GICP"),
}


def _spatial(xy: Array, layers: Sequence[float] = (0.0,)) -> Array:
    return np.vstack([np.column_stack((xy, np.full(len(xy), z))) for z in layers])


def _transform(q: Array) -> Array:
    T = np.eye(4)
    c, s = np.cos(q[2]), np.sin(q[2])
    T[:2, :2] = [[c, -s], [s, c]]
    T[:2, 3] = q[:2]
    return T


def _planar(T: Array) -> Array:
    return np.array([T[0, 3], T[1, 3], np.arctan2(T[1, 0], T[0, 0])])
