"""Simulated missions: a world, a survey of it, and what the sensors measured."""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np

from gtsam_nav.errors import ConfigError
from gtsam_nav.mission import Mission
from gtsam_nav.simulation import sensors
from gtsam_nav.simulation.marina import marina
from gtsam_nav.simulation.motion import Motion
from gtsam_nav.simulation.settings import SimulationSettings
from gtsam_nav.simulation.sonar import sonar
from gtsam_nav.simulation.world import World

logger = logging.getLogger(__name__)

WORLDS: dict[str, Callable[[], World]] = {"marina": marina}
"""Names that `simulate` takes."""

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
)
"""What draws random numbers, in the order of the seed's child streams: one each, so that one
sensor's settings leave the others' noise alone."""


def simulate(
    name: str = "marina",
    seed: int = 0,
    duration_s: float = 600.0,
    settings: SimulationSettings | None = None,
) -> Mission:
    """Simulate a mission.

    Parameters
    ----------
    name : str
        One of `WORLDS`.
    seed : int
        The same seed and settings give the same mission, to the last bit.
    duration_s : float
        How long the survey lasts; the circuit is repeated.
    settings : SimulationSettings, optional

    Returns
    -------
    Mission
        Its ``reference`` is the truth of the body's origin, attitude included. Each sensor's
        ``noise`` and sigma columns state what was simulated.

    Raises
    ------
    ConfigError
        For an unknown name, a negative seed, or a duration under a second.
    """
    if name not in WORLDS:
        raise ConfigError(f"unknown simulation '{name}'; the choices are: {', '.join(WORLDS)}")
    if seed < 0:
        raise ConfigError(f"seed is {seed}; it must not be negative")
    if not (np.isfinite(duration_s) and duration_s >= 1.0):
        raise ConfigError(f"duration is {duration_s} s; at least 1 s is needed")
    s = settings or SimulationSettings()
    children = np.random.SeedSequence(seed).spawn(len(STREAMS))
    rng = {k: np.random.default_rng(child) for k, child in zip(STREAMS, children, strict=True)}
    world = WORLDS[name]()
    motion = Motion(world, s.motion, rng["motion"])
    mounted = (
        sensors.imu(motion, world.origin, duration_s, s.imu, rng["imu"]),
        sensors.dvl(motion, duration_s, s.dvl, rng["dvl"]),
        sensors.heading(motion, world, duration_s, s.heading, rng["heading"]),
        sensors.attitude(motion, duration_s, s.attitude, rng["attitude"]),
        sensors.depth(motion, duration_s, s.depth, rng["depth"]),
        sensors.gnss(motion, duration_s, s.gnss, rng["gnss"]),
        sensors.odometry(motion, duration_s, s.odometry, rng["odometry"]),
        sensors.landmarks(motion, world, duration_s, s.landmarks, rng["landmarks"]),
        sonar(motion, world, duration_s, s.sonar, rng["sonar"]),
        sensors.reference(motion, duration_s, s.reference_rate_hz),
    )
    logger.info("simulated %s, seed %d: %.0f s, %d sensors", name, seed, duration_s, len(mounted))
    return Mission(
        name=f"{name}-{seed}",
        sensors={sensor.name: sensor for sensor in mounted},
        origin=world.origin,
        start_utc=START_UTC,
    )
