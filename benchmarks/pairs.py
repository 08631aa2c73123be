"""Registration of scan pairs whose true pose is known: ``python -m benchmarks.pairs FOLDER``.

The folder holds the St. Pere logs and ``pairs.csv``. Scans are deskewed with dead reckoning, the
start is the true pose with Gaussian errors, and a reported failure counts as a miss.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

import gtsam_nav as gn
from gtsam_nav.config import Config
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.alignment import align
from gtsam_nav.preprocess.motion import vehicle_motion
from gtsam_nav.registration.pic import register
from gtsam_nav.sonar.echoes import segment
from gtsam_nav.sonar.motion import PlanarMotion
from gtsam_nav.sonar.scans import Scan, find_turns, form_scans

SUCCESS_M, SUCCESS_DEG = 1.0, 3.0
START_ERRORS = ((0.5, 4.0), (2.0, 10.0), (4.0, 20.0))
"""Standard deviations of the start: m per axis, and degrees."""
ACCEPTANCE_START = (2.0, 10.0)


@dataclass(frozen=True)
class ScanPair:
    """Two scans and the true pose of the new one in the reference: x, y (m), yaw (rad)."""

    reference: Scan
    new: Scan
    q_true: Array


@dataclass(frozen=True)
class PairsResult:
    """How well pairs were registered from starts of one spread."""

    start_m: float
    start_deg: float
    pairs: int
    failures: int
    success: float
    median_m: float
    median_deg: float
    median_nees: float
    """Squared error over the stated covariance; 2.37 if that were exact (3 degrees of freedom)."""
    ms_per_pair: float


def dead_reckoned_scans(mission: Mission, config: Config) -> list[Scan]:
    """All turns of the sonar, deskewed with the method ``dr``."""
    sonar = mission.first("beams")
    if sonar is None:
        raise SystemExit(f"mission '{mission.name}' holds no sonar beams")
    growth = vehicle_motion(mission, align(mission), config.motion)
    motion = PlanarMotion.of(
        gn.estimate(mission, "dr", config).trajectory,
        growth.position_variance_m2_s,
        growth.yaw_variance_rad2_s,
    )
    turns = find_turns(sonar, config.sonar.scans.max_gap_s)
    return form_scans(segment(sonar, config.sonar.segmentation), turns, motion)


def load_pairs(folder: Path, config: Config) -> list[ScanPair]:
    """The pairs of ``pairs.csv``: its scans are found by the time of their middle beams."""
    mission = gn.open_mission(folder)
    scans = dead_reckoned_scans(mission, config)
    t_scans = np.array([scan.t_ref for scan in scans]) + (mission.start_utc or 0.0)
    pairs = []
    for row in np.genfromtxt(folder / "pairs.csv", delimiter=",", names=True):
        a, b = (int(np.argmin(np.abs(t_scans - row[name]))) for name in ("t_a", "t_b"))
        if max(abs(t_scans[a] - row["t_a"]), abs(t_scans[b] - row["t_b"])) > 0.1:
            raise SystemExit(f"{folder / 'pairs.csv'}: no scan at {row['t_a']} or {row['t_b']}")
        q_true = np.array([row["dx"], row["dy"], np.radians(row["dyaw_deg"])])
        pairs.append(ScanPair(scans[a], scans[b], q_true))
    return pairs


def measure(
    pairs: list[ScanPair], start: tuple[float, float], config: Config, seed: int = 1
) -> PairsResult:
    """Register all pairs from starts with errors of given standard deviations (m, deg)."""
    rng = np.random.default_rng(seed)
    sigma = np.array([start[0], start[0], np.radians(start[1])])
    errors, failed = np.empty((len(pairs), 2)), np.zeros(len(pairs), dtype=bool)
    nees, seconds = np.empty(len(pairs)), 0.0
    for k, pair in enumerate(pairs):
        prior = pair.q_true + rng.normal(size=3) * sigma
        begin = time.perf_counter()
        match = register(pair.reference, pair.new, prior, np.diag(sigma**2), config.pic)
        seconds += time.perf_counter() - begin
        off = match.q - pair.q_true
        off[2] = wrap_angle(off[2])
        errors[k] = np.hypot(*off[:2]), abs(np.degrees(off[2]))
        nees[k] = off @ np.linalg.solve(match.cov, off)
        failed[k] = not match.ok
    hit = ~failed & (errors[:, 0] < SUCCESS_M) & (errors[:, 1] < SUCCESS_DEG)
    # a failure is a miss in the medians too
    median_m, median_deg = np.median(np.where(failed[:, None], np.inf, errors), axis=0)
    return PairsResult(
        start_m=start[0],
        start_deg=start[1],
        pairs=len(pairs),
        failures=int(failed.sum()),
        success=float(hit.mean()),
        median_m=float(median_m),
        median_deg=float(median_deg),
        median_nees=float(np.median(nees[~failed])),
        ms_per_pair=1e3 * seconds / len(pairs),
    )


def main() -> None:
    """Print the table, and write it as JSON where asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pairs", description=__doc__)
    parser.add_argument("folder", type=Path, help="the St. Pere logs with pairs.csv")
    parser.add_argument("--json", type=Path, help="write the figures here")
    arguments = parser.parse_args()
    config = gn.load_config()
    pairs = load_pairs(arguments.folder, config)
    measure(pairs[:1], ACCEPTANCE_START, config)  # compiles
    results = [measure(pairs, start, config) for start in START_ERRORS]
    print(f"pIC on {len(pairs)} pairs; simulated sonar; success: {SUCCESS_M:g} m, {SUCCESS_DEG:g}°")
    print("start sigma      success  failures  median error       NEES   ms/pair")
    for r in results:
        print(
            f"{r.start_m:3.1f} m {r.start_deg:4.1f} deg   {100 * r.success:5.1f} %  {r.failures:8d}"
            f"  {r.median_m:.3f} m {r.median_deg:.3f} deg  {r.median_nees:5.2f}"
            f"  {r.ms_per_pair:7.2f}"
        )
    if arguments.json:
        document = {"pairs": [asdict(r) for r in results]}
        arguments.json.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
