"""Simulated missions: what the sensors of a scenario measure."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from gtsam_nav.errors import ConfigError
from gtsam_nav.frames import wrap_angle
from gtsam_nav.mission import InitialState, Mission, Sensor
from gtsam_nav.simulation import sensors
from gtsam_nav.simulation.harbour import harbour
from gtsam_nav.simulation.laps import laps
from gtsam_nav.simulation.lidar import lidar
from gtsam_nav.simulation.marina import marina
from gtsam_nav.simulation.motion import Motion
from gtsam_nav.simulation.ranger import ranger
from gtsam_nav.simulation.scenario import Scenario
from gtsam_nav.simulation.settings import SimulationSettings, StartSimulation
from gtsam_nav.simulation.sonar import sonar
from gtsam_nav.simulation.submarine import submarine
from gtsam_nav.simulation.world import World

logger = logging.getLogger(__name__)

SCENARIOS: dict[str, Callable[[int], Scenario]] = {
    "marina": lambda _seed: Scenario(marina(), SimulationSettings(), duration_s=600.0),
    "laps": laps,
    "ranger": ranger,
    "submarine": submarine,
    "harbour": harbour,
}
"""Names that `simulate` takes, and what makes the scenario of a seed."""

SHORTEST_S, LONGEST_S = 1.0, 1e5
"""Bounds of a mission's length: over a day would not fit in memory."""

START_UTC = 1_750_000_000.0
"""Simulated missions begin on 15 June 2025."""

STREAMS = (
    "motion",
    "imu",
    "dvl",
    "heading",
    "attitude",
    "depth",
    "gnss",
    "odometry",
    "landmarks",
    "sonar",
    "start",
    "lidar",
)
"""What draws random numbers, in the order of the seed's child streams: one each, so that one
sensor's settings leave the others' noise alone."""


def make_scenario(name: str, seed: int = 0) -> Scenario:
    """The scenario of a name; its ``settings`` are the ones to alter for `simulate`.

    Raises
    ------
    ConfigError
        For an unknown name or a negative seed.
    """
    if name not in SCENARIOS:
        raise ConfigError(f"unknown simulation '{name}'; the choices are: {', '.join(SCENARIOS)}")
    if seed < 0:
        raise ConfigError(f"seed is {seed}; it must not be negative")
    return SCENARIOS[name](seed)


def simulate(
    name: str = "marina",
    seed: int = 0,
    duration_s: float | None = None,
    settings: SimulationSettings | None = None,
) -> Mission:
    """Simulate a mission.

    Parameters
    ----------
    name : str
        One of `SCENARIOS`.
    seed : int
        The same seed and settings give the same mission, to the last bit.
    duration_s : float, optional
        How long it lasts; the scenario's own length where absent. A closed course is repeated; at
        the end of an open one the vehicle stops.
    settings : SimulationSettings, optional
        Those of the scenario where absent.

    Returns
    -------
    Mission
        Its ``reference`` is the truth of the body's origin, attitude included. Each sensor's
        ``noise`` and sigma columns state what was simulated.

    Raises
    ------
    ConfigError
        For an unknown name, a negative seed, or a duration under a second or over 1e5 s.
    """
    chosen = make_scenario(name, seed)
    duration_s = chosen.duration_s if duration_s is None else duration_s
    if not SHORTEST_S <= duration_s <= LONGEST_S:
        raise ConfigError(
            f"duration is {duration_s:g} s; it must lie between {SHORTEST_S:g} and {LONGEST_S:g} s"
        )
    s = settings or chosen.settings
    children = np.random.SeedSequence(seed).spawn(len(STREAMS))
    rng = {k: np.random.default_rng(child) for k, child in zip(STREAMS, children, strict=True)}
    motion = Motion(chosen.world, s.motion, rng["motion"])
    mounted = {x.name: x for x in _mounted(motion, chosen.world, duration_s, s, rng)}
    logger.info("simulated %s, seed %d: %.0f s, %d sensors", name, seed, duration_s, len(mounted))
    return Mission(
        name=f"{name}-{seed}",
        sensors=mounted,
        origin=chosen.world.origin,
        start_utc=START_UTC,
        initial=InitialState() if s.start is None else _stated(motion, s.start, rng["start"]),
    )


def _mounted(
    motion: Motion,
    world: World,
    duration_s: float,
    s: SimulationSettings,
    rng: Mapping[str, np.random.Generator],
) -> Iterator[Sensor]:
    """The sensors aboard, and the truth."""
    if s.imu is not None:
        yield sensors.imu(motion, world, duration_s, s.imu, rng["imu"])
    if s.dvl is not None:
        yield sensors.dvl(motion, duration_s, s.dvl, rng["dvl"])
    if s.heading is not None:
        yield sensors.heading(motion, world, duration_s, s.heading, rng["heading"])
    if s.attitude is not None:
        yield sensors.attitude(motion, duration_s, s.attitude, rng["attitude"])
    if s.depth is not None:
        yield sensors.depth(motion, duration_s, s.depth, rng["depth"])
    if s.gnss is not None:
        yield sensors.gnss(motion, duration_s, s.gnss, rng["gnss"])
    if s.odometry is not None:
        yield sensors.odometry(motion, duration_s, s.odometry, rng["odometry"])
    if s.landmarks is not None:
        yield sensors.landmarks(motion, world, duration_s, s.landmarks, rng["landmarks"])
    if s.sonar is not None:
        yield sonar(motion, world, duration_s, s.sonar, rng["sonar"])
    if s.lidar is not None:
        yield lidar(motion, world, duration_s, s.lidar, rng["lidar"])
    yield sensors.reference(motion, duration_s, s.reference_rate_hz)


def _stated(motion: Motion, s: StartSimulation, rng: np.random.Generator) -> InitialState:
    """What the mission says of its start, as wrong as it says."""
    truth = motion.at([0.0])
    sigma_heading = float(np.radians(s.sigma_heading_deg))
    return InitialState(
        p_n=truth.p_n[0] + rng.normal(scale=s.sigma_position_m, size=3),
        sigma_p=s.sigma_position_m,
        heading=float(wrap_angle(truth.rpy[0, 2] + rng.normal(scale=sigma_heading))),
        sigma_heading=sigma_heading,
    )
