"""Landmarks on recorded data: ``python -m benchmarks.landmarks [--data PATH] [--json FILE]``.

What the cameras of the robots measure, range or depth, by pairs of surveyed landmarks in one
picture (``camera``). Five ground robots of MRCLAM data set 6 (``PATH/mrclam6``), graph against
``landmark-ekf``, the surveyed map not used, with the sensor's ids and without; Plaza (ranges to
beacons that are 7 % too long) with the range scale as a state and without; Victoria Park without
ids, against the solution with ids at the same noise. The last two come with GTSAM. Ids tell how
pure an association is; no estimator sees them there. ``--only`` picks some of the parts.
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from collections import Counter
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import gtsam
import numpy as np

import gtsam_nav as gn
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.identified import identified
from gtsam_nav.sensors.noise import LandmarkNoise
from gtsam_nav.series import IntArray, LandmarkSeries

ROBOTS = (1, 2, 3, 4, 5)
PLAZA = ("Plaza1", "Plaza2")
PARTS = ("camera", "mrclam", "withheld", "plaza", "victoria")
SCALES = np.arange(0.95, 1.12, 0.002)
SLAM = "landmarks.use_map=false"
WITHHELD = "landmarks.association=joint"


@dataclass(frozen=True)
class LandmarkRun:
    """One method on one mission.

    Attributes
    ----------
    se2_rmse_m : float
        Against the truth; of Victoria Park, which has none, against the solution with ids.
    purity : float or None
        Share of the associated sightings that are of their landmark's commonest true one.
    landmarks : int
    range_scale, range_scale_sigma : float or None
    """

    mission: str
    method: str
    overrides: tuple[str, ...]
    se2_rmse_m: float
    landmarks: int
    wall_s: float
    purity: float | None = None
    range_scale: float | None = None
    range_scale_sigma: float | None = None

    def text(self) -> str:
        """One line of the table."""
        line = (
            f"{self.mission:14} {self.method:13} {' '.join(self.overrides):58}"
            f" {self.se2_rmse_m:8.3f} m  {self.landmarks:4d} landmarks {self.wall_s:7.1f} s"
        )
        if self.purity is not None:
            line += f"  purity {self.purity:.3f}"
        if self.range_scale is not None:
            line += f"  range scale {self.range_scale:+.4f} +- {self.range_scale_sigma:.4f}"
        return line


def purity(found: IntArray, true: IntArray) -> float:
    """Share of the sightings with a landmark that are of its commonest true one."""
    used = found >= 0
    most = [
        Counter(true[found == landmark].tolist()).most_common(1)[0][1]
        for landmark in np.unique(found[used])
    ]
    return float(np.sum(most) / max(np.sum(used), 1))


def run(
    mission: Mission, method: str, overrides: tuple[str, ...], known: gn.Solution | None = None
) -> LandmarkRun:
    """Estimate and score a mission with ``key=value`` settings."""
    config = gn.load_config(None, overrides)
    begin = time.perf_counter()
    solution = gn.estimate(mission, method, config)
    wall_s = time.perf_counter() - begin
    found = None
    if method == "graph" and config.landmarks.association != "ids":
        blind = identified(mission, config.motion, config.landmarks)
        found = purity(_ids(blind), _ids(mission))
    slow = {} if solution.slow_states is None else solution.slow_states.columns
    scale, sigma = slow.get("landmarks_range_scale", (None, None))
    return LandmarkRun(
        mission=mission.name,
        method=method,
        overrides=overrides,
        se2_rmse_m=_se2_rmse_m(solution) if known is None else apart_m(solution, known),
        landmarks=0 if solution.landmarks is None else len(solution.landmarks.id),
        wall_s=wall_s,
        purity=found,
        range_scale=None if scale is None else float(scale[0]),
        range_scale_sigma=None if sigma is None else float(sigma[0]),
    )


def _ids(mission: Mission) -> IntArray:
    series = mission.sensors["landmarks"].series
    assert isinstance(series, LandmarkSeries)
    return series.id


def _se2_rmse_m(solution: gn.Solution) -> float:
    errors = gn.evaluate(solution).ate.se2
    assert errors is not None
    return errors.rmse


def apart_m(one: gn.Solution, other: gn.Solution) -> float:
    """Root mean square distance of two trajectories after the best SE(2) alignment."""
    t = other.trajectory.t
    a, b = (
        np.interp(t, s.trajectory.t, s.trajectory.p_n[:, 0])
        + 1j * np.interp(t, s.trajectory.t, s.trajectory.p_n[:, 1])
        for s in (one, other)
    )
    a, b = a - a.mean(), b - b.mean()
    turn = np.sum(b * np.conj(a))
    return float(np.sqrt(np.mean(np.abs(turn / abs(turn) * a - b) ** 2)))


def mrclam(data: Path, withheld: bool) -> list[LandmarkRun]:
    """Graph and filter on the five robots."""
    overrides = (SLAM, WITHHELD) if withheld else (SLAM,)
    missions = [gn.open_mission(data / "mrclam6" / f"Robot{k}") for k in ROBOTS]
    return [
        _said(run(m, method, overrides)) for method in ("landmark-ekf", "graph") for m in missions
    ]


@dataclass(frozen=True)
class Camera:
    """How well one reading of a camera's figures fits the survey, with the scale that fits best.

    ``misfit_m`` is the median absolute error of the distance between two landmarks in one picture.
    """

    mission: str
    taken_for: str
    pairs: int
    scale: float
    misfit_m: float

    def text(self) -> str:
        """One line of the table."""
        return (
            f"{self.mission:14} taken for a {self.taken_for:6} {self.scale - 1:+.3f} too long:"
            f" pairs off by {self.misfit_m:.3f} m ({self.pairs} pairs)"
        )


def camera(data: Path) -> list[Camera]:
    """Ranges along the ray against depths along the camera's axis, without the robots' paths."""
    found = []
    for robot in ROBOTS:
        mission = gn.open_mission(data / "mrclam6" / f"Robot{robot}")
        series, survey = mission.sensors["landmarks"].series, mission.landmark_map
        assert isinstance(series, LandmarkSeries)
        assert series.range_m is not None
        assert series.bearing is not None
        assert survey is not None
        pairs = [
            (a, b)
            for picture in np.split(np.arange(len(series.t)), np.flatnonzero(np.diff(series.t)) + 1)
            for a, b in itertools.combinations(picture.tolist(), 2)
        ]
        at = survey.p_n[np.searchsorted(survey.id, series.id)][:, :2]
        a, b = np.array(pairs).T
        surveyed_m = np.linalg.norm(at[a] - at[b], axis=1)
        for taken_for, share in (("range", 1.0), ("depth", np.cos(series.bearing))):
            seen = series.range_m / share * np.exp(1j * series.bearing)
            misfits = [
                float(np.median(np.abs(np.abs(seen[a] - seen[b]) / scale - surveyed_m)))
                for scale in SCALES
            ]
            best = int(np.argmin(misfits))
            row = Camera(mission.name, taken_for, len(pairs), float(SCALES[best]), misfits[best])
            print(row.text(), flush=True)
            found.append(row)
    return found


def plaza() -> list[LandmarkRun]:
    """Both drives, with the range scale as a state and with ranges taken for true."""
    runs = []
    for name in PLAZA:
        mission = gn.open_mission(Path(gtsam.findExampleDataFile(f"{name}_.mat")))
        sensor = mission.sensors["landmarks"]
        trusted = LandmarkNoise.model_validate({**sensor.noise, "range_scale_sigma": 0.0})
        trusting = mission.with_sensor(replace(sensor, noise=trusted.model_dump()))
        runs += [_said(run(m, "graph", (SLAM,))) for m in (mission, trusting)]
    return runs


def victoria() -> list[LandmarkRun]:
    """Without ids, against the solution with them."""
    mission = gn.open_mission(Path(gtsam.findExampleDataFile("victoria_park.txt")))
    known = gn.estimate(mission, "graph", gn.load_config(None, ()))
    return [_said(run(mission, "graph", (WITHHELD,), known))]


def _said(found: LandmarkRun) -> LandmarkRun:
    print(found.text(), flush=True)
    return found


def means(runs: list[LandmarkRun]) -> None:
    """The mean over the missions of each method."""
    for method in dict.fromkeys(r.method for r in runs):
        errors = [r.se2_rmse_m for r in runs if r.method == method]
        print(f"{'mean':14} {method:13} {'':58} {np.mean(errors):8.3f} m")


def main() -> None:
    """Print the figures, and write them as JSON where asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.landmarks", description=__doc__)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="has mrclam6/")
    parser.add_argument("--json", type=Path, help="write the figures here")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, help="some parts")
    arguments = parser.parse_args()
    runs: list[LandmarkRun] = []
    cameras: list[Camera] = []
    for part in arguments.only:
        if part == "camera":
            cameras += camera(arguments.data)
            continue
        if part in ("mrclam", "withheld"):
            found = mrclam(arguments.data, withheld=part == "withheld")
            means(found)
        else:
            found = plaza() if part == "plaza" else victoria()
        runs += found
    if arguments.json:
        document = {
            "cameras": [asdict(c) for c in cameras],
            "landmarks": [asdict(r) for r in runs],
        }
        arguments.json.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
