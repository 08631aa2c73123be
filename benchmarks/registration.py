"""Is a match as good as its covariance says? ``python -m benchmarks.registration [--pairs N]``

Scans of simulated sonar, deskewed with the true motion, of three places: a *corridor* of two bare
walls, which do not tell how far along them a vehicle is; a *corner* of two walls; *open water* with
piles. Pairs of scans are registered by pIC, with the floors that the simulated sonar's card states,
from starts with Gaussian errors. Printed are the mean squared error over the covariance per degree
of freedom that the points tell (1 is honest), along the way and across it too, what sigma the
matches state there; and for the echoes themselves their error across walls, by the slope at which
the beam meets the wall, beside what the card states.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.ekf.scan_track import with_floors
from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import Sensor
from gtsam_nav.registration.pic import register
from gtsam_nav.sensors.noise import SonarNoise
from gtsam_nav.simulation.motion import Motion, MotionSettings
from gtsam_nav.simulation.sonar import SonarSimulation, sonar
from gtsam_nav.simulation.world import Course, Wall, World
from gtsam_nav.sonar.echoes import segment
from gtsam_nav.sonar.motion import PlanarMotion
from gtsam_nav.sonar.scans import Scan, echoes_in_level_frame, find_turns, form_scans

START_SIGMA = np.array([0.5, 0.5, np.radians(3.0)])
"""Of the errors of the start: x, y, yaw."""
SONAR = SonarSimulation(clutter_per_beam=0.0, second_echo=0.0)
BESIDE_M = (-9.0, 11.0)
"""Where the walls of the corridor stand, to the right of the way."""
SLOPES = (0.0, 0.5, 1.0, 2.0)
"""Bounds between classes of echoes: metres along the wall to one across, from the sonar."""
SCANS_A_RUN, APART = 5, (1, 2)
"""Scans of one run, and how many scans lie between the two of a pair."""
ECHO_RUNS = 20
"""Passages of the corridor whose echoes are compared with its walls."""
AZIMUTH_RAD = np.radians(25.0)
"""Of the way through each place, so that it runs along no axis."""


def _wall(*corners: tuple[float, float]) -> Wall:
    return Wall(_turned(np.array(corners)), 0.0)


def _turned(plan: Array) -> Array:
    """North and east of coordinates along the way and to its right."""
    c, s = np.cos(AZIMUTH_RAD), np.sin(AZIMUTH_RAD)
    return np.asarray(plan @ np.array([[c, s], [-s, c]]))


PLACES: dict[str, tuple[tuple[Wall, ...], Array]] = {
    "corridor": (tuple(_wall((-150, y), (150, y)) for y in BESIDE_M), np.zeros((0, 2))),
    "corner": ((_wall((-40, 12), (25, 12), (25, -40)),), np.zeros((0, 2))),
    "open water": (
        (),
        _turned(np.array([(5, 9), (22, -14), (-12, -11), (31, 8), (-20, 15), (12, -27), (9, 21)])),
    ),
}
"""Walls and piles."""


@dataclass(frozen=True)
class ScanPair:
    """Two scans and the true pose of the new one in the reference: x, y (m), yaw (rad)."""

    reference: Scan
    new: Scan
    q_true: Array
    yaw_reference: float


@dataclass(frozen=True)
class MatchConsistency:
    """How the matches of one place compare with their covariances.

    Sigmas are medians of what the matches state along and across the way.
    """

    place: str
    pairs: int
    failed: int
    nees_per_dof: float
    nees_along: float
    nees_across: float
    nees_yaw: float
    within_95: float
    sigma_along_m: float
    sigma_across_m: float
    rms_across_m: float


def passage(place: str, seed: int) -> tuple[Sensor, PlanarMotion]:
    """The sonar and the true motion of a vehicle on a straight way through a place."""
    walls, piles = PLACES[place]
    way = _turned(np.column_stack([np.linspace(-12.0, 12.0, 8), np.zeros(8)]))
    world = World(place, None, Course(way, closed=False), walls=walls, piles_n=piles, flat=True)
    rng = np.random.default_rng(seed)
    motion = Motion(world, MotionSettings(speed_m_s=0.3, rest_s=0.0), rng)
    turn_s = SONAR.beam_interval_s * 360.0 / SONAR.step_deg
    duration_s = (SCANS_A_RUN + 0.5) * turn_s
    sensor = sonar(motion, world, duration_s, SONAR, rng)
    truth = motion.at(np.arange(0.0, duration_s + 0.05, 0.05))
    yaw = np.unwrap(truth.rpy[:, 2])
    return sensor, PlanarMotion(truth.t, truth.p_n[:, :2], yaw, 0.0, 0.0)


def pairs_of(place: str, seed: int, config: Config) -> Iterator[ScanPair]:
    """Pairs of the scans that a vehicle takes on its way through a place."""
    sensor, motion = passage(place, seed)
    turns = find_turns(sensor, config.sonar.scans.max_gap_s)
    scans = form_scans(segment(sensor, config.sonar.segmentation), turns, motion)
    ne, yaw = motion.at(turns.t_ref)
    for apart in APART:
        for a in range(len(scans) - apart):
            b = a + apart
            c, s = np.cos(yaw[a]), np.sin(yaw[a])
            xy = np.array([[c, s], [-s, c]]) @ (ne[b] - ne[a])
            yield ScanPair(scans[a], scans[b], np.array([*xy, yaw[b] - yaw[a]]), float(yaw[a]))


def measure(place: str, wanted: int, config: Config) -> MatchConsistency:
    """Register pairs of a place from perturbed starts."""
    rng = np.random.default_rng(1)
    errors, covs, told, failed, seed = [], [], 0, 0, 0
    while len(errors) + failed < wanted:
        for pair in pairs_of(place, seed, config):
            start = pair.q_true + rng.normal(size=3) * START_SIGMA
            match = register(pair.reference, pair.new, start, np.diag(START_SIGMA**2), config.pic)
            if not match.ok:
                failed += 1
                continue
            error = match.q - pair.q_true
            error[2] = wrap_angle(error[2])
            turn = AZIMUTH_RAD - pair.yaw_reference
            c, s = np.cos(turn), np.sin(turn)
            to_way = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
            errors.append(to_way @ error)
            covs.append(to_way @ match.cov @ to_way.T)
            told += 3 - len(match.unobserved)
        seed += 1
    return _consistency(place, failed, np.array(errors), np.array(covs), told)


def _consistency(
    place: str, failed: int, errors: Array, covs: Array, told: int
) -> MatchConsistency:
    from scipy.special import gammaincinv

    if not len(errors):
        return MatchConsistency(place, failed, failed, *[float("nan")] * 8)
    nees = np.einsum("ki,ki->k", errors, np.linalg.solve(covs, errors[..., None])[..., 0])
    sigma = np.sqrt(np.diagonal(covs, axis1=1, axis2=2))
    along, across, yaw = np.mean((errors / sigma) ** 2, axis=0).tolist()
    return MatchConsistency(
        place=place,
        pairs=len(errors) + failed,
        failed=failed,
        nees_per_dof=float(np.sum(nees)) / told,
        nees_along=along,
        nees_across=across,
        nees_yaw=yaw,
        within_95=float(np.mean(nees <= 2.0 * gammaincinv(1.5, 0.95))),
        sigma_along_m=float(np.median(sigma[:, 0])),
        sigma_across_m=float(np.median(sigma[:, 1])),
        rms_across_m=float(np.sqrt(np.mean(errors[:, 1] ** 2))),
    )


@dataclass(frozen=True)
class EchoConsistency:
    """How far echoes lie off walls whose slopes to the beam begin at ``slope``."""

    slope: float
    echoes: int
    mean_m: float
    rms_m: float
    sigma_m: float
    nees: float


def echo_errors(runs: int, config: Config) -> list[EchoConsistency]:
    """Echoes of the corridor against its walls; the mean is positive beyond them."""
    errors = []
    for seed in range(runs):
        sensor, motion = passage("corridor", seed)
        echoes = segment(sensor, config.sonar.segmentation)
        ne, cov = echoes_in_level_frame(echoes, motion)
        along, across = _turned(np.eye(2))
        head = motion.at(echoes.t)[0]
        right = ne @ across
        wall = np.where(right < 0, *BESIDE_M)
        slope = np.abs((ne - head) @ along / (wall - head @ across))
        sigma = np.sqrt(np.einsum("i,kij,j->k", across, cov, across))
        errors.append(np.column_stack([slope, np.sign(wall) * (right - wall), sigma]))
    slope, off, sigma = np.vstack(errors).T
    found = []
    for k, least in enumerate(SLOPES):
        these = np.digitize(slope, SLOPES) == k + 1
        found.append(
            EchoConsistency(
                slope=least,
                echoes=int(these.sum()),
                mean_m=float(np.mean(off[these])),
                rms_m=float(np.sqrt(np.mean(off[these] ** 2))),
                sigma_m=float(np.mean(sigma[these])),
                nees=float(np.mean((off[these] / sigma[these]) ** 2)),
            )
        )
    return found


def as_the_card_states() -> Config:
    """Settings with the floors of the simulated sonar's card."""
    noise = SonarNoise(match_floor_m=SONAR.match_floor_m, match_floor_deg=SONAR.match_floor_deg)
    return Config().model_copy(update={"pic": with_floors(Config().pic, noise)})


def main() -> None:
    """Print a line a place and a line a slope; write them where asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.registration", description=__doc__)
    parser.add_argument("--pairs", type=int, default=1000, help="pairs a place")
    parser.add_argument("--json", type=Path, help="file for the figures")
    arguments = parser.parse_args()
    config = as_the_card_states()
    places = [asdict(measure(place, arguments.pairs, config)) for place in PLACES]
    slopes = [asdict(row) for row in echo_errors(ECHO_RUNS, config)]
    for rows in (places, slopes):
        print("".join(f"{name:>16}" for name in rows[0]))
        for row in rows:
            values = (v if isinstance(v, str) else f"{v:.3g}" for v in row.values())
            print("".join(f"{value:>16}" for value in values))
    if arguments.json:
        text = json.dumps({"matches": places, "echoes": slopes}, indent=2) + "\n"
        arguments.json.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
