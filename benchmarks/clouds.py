"""Consistency of cloud odometry: ``python -m benchmarks.clouds [--seeds 1,2] [--duration S]``.

Over simulated harbours: errors of the increments between kept clouds, and their normalised squares
(NEES) a degree of freedom, which is one where the stated covariance is exact.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from gtsam_nav.frames import Array, quaternion_from_rpy
from gtsam_nav.mission import Mission
from gtsam_nav.odometry.cloud_track import CloudTrack
from gtsam_nav.odometry.kiss import cloud_odometry
from gtsam_nav.odometry.settings import KissSettings
from gtsam_nav.series import ReferenceSeries
from gtsam_nav.simulation import simulate
from gtsam_nav.solution import no_progress
from gtsam_nav.trajectory import Trajectory


@dataclass(frozen=True)
class OdometryResult:
    """Of one simulated run: increments, their rms errors, NEES, and the way that was covered."""

    seed: int
    increments: int
    rms_m: float
    rms_deg: float
    nees_per_dof: float
    nees_by_axis: tuple[float, ...]
    way_m: float
    end_error_m: float
    cpu_ms_per_cloud: float


def truth_at(mission: Mission, t: Array) -> Trajectory:
    """The simulated truth at given times."""
    reference = mission.reference
    if reference is None or not isinstance(reference.series, ReferenceSeries):
        raise SystemExit(f"mission '{mission.name}' has no reference")
    series = reference.series
    if series.rpy is None:
        raise SystemExit(f"mission '{mission.name}' has no attitude in its reference")
    whole = Trajectory(t=series.t, p_n=series.p_n, q_nb_wxyz=quaternion_from_rpy(series.rpy))
    return whole.interpolate(t)


def increment_errors(track: CloudTrack, truth: Trajectory) -> tuple[Array, Array]:
    """Errors (m, 6) of the increments, turn and shift, and their covariances (m, 6, 6)."""
    errors, covariances = [], []
    for j in range(1, len(track.key)):
        increment = track.increment(j - 1, j)
        to_a = truth.R_nb[j - 1].T
        p_a = to_a @ (truth.p_n[j] - truth.p_n[j - 1])
        errors.append(increment.error_of(to_a @ truth.R_nb[j], p_a))
        covariances.append(increment.cov)
    return np.array(errors), np.array(covariances)


def measure(seed: int, duration_s: float) -> OdometryResult:
    """Run the odometry over one simulated harbour."""
    mission = simulate("harbour", seed, duration_s)
    begin = time.process_time()
    track = cloud_odometry(mission, KissSettings(), no_progress)
    cpu_s = time.process_time() - begin
    assert track is not None
    truth = truth_at(mission, np.array([cloud.t for cloud in track.key]))
    e, cov = increment_errors(track, truth)
    nees = np.einsum("mi,mi->m", e, np.linalg.solve(cov, e[..., None])[..., 0])
    first, last = track.key[0].pose, track.key[-1].pose
    own = truth.R_nb[0] @ first.R_ab.T @ (last.p_a - first.p_a)
    return OdometryResult(
        seed=seed,
        increments=len(e),
        rms_m=float(np.sqrt(np.mean(np.sum(e[:, 3:] ** 2, axis=1)))),
        rms_deg=float(np.degrees(np.sqrt(np.mean(np.sum(e[:, :3] ** 2, axis=1))))),
        nees_per_dof=float(nees.mean() / 6),
        nees_by_axis=tuple((e**2 / np.diagonal(cov, axis1=1, axis2=2)).mean(axis=0).tolist()),
        way_m=float(np.linalg.norm(np.diff(truth.p_n, axis=0), axis=1).sum()),
        end_error_m=float(np.linalg.norm(truth.p_n[-1] - truth.p_n[0] - own)),
        cpu_ms_per_cloud=1e3 * cpu_s / len(track.t),
    )


def main() -> None:
    """Print the table, and write it as JSON where asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.clouds", description=__doc__)
    parser.add_argument("--seeds", default="3,4", help="simulated runs, as in 3,4")
    parser.add_argument("--duration", type=float, default=60.0, help="of each, s")
    parser.add_argument("--json", type=Path, help="write the figures here")
    arguments = parser.parse_args()
    results = [measure(int(k), arguments.duration) for k in arguments.seeds.split(",")]
    print(
        "seed  increments  rms error          NEES/dof  by axis (turn, shift)         way     end"
    )
    for r in results:
        axes = " ".join(f"{x:.2f}" for x in r.nees_by_axis)
        print(
            f"{r.seed:4d}  {r.increments:10d}  {r.rms_m:.4f} m {r.rms_deg:.3f}°"
            f"  {r.nees_per_dof:8.2f}  {axes}  {r.way_m:6.1f} m  {r.end_error_m:.3f} m"
            f"  {r.cpu_ms_per_cloud:.0f} ms/cloud"
        )
    print(f"mean NEES a degree of freedom: {np.mean([r.nees_per_dof for r in results]):.2f}")
    if arguments.json:
        document = {"odometry": [asdict(r) for r in results]}
        arguments.json.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
