"""What is simulated under a name: a place with a course, a vehicle, and what it carries."""

from __future__ import annotations

from dataclasses import dataclass

from gtsam_nav.simulation.settings import SimulationSettings
from gtsam_nav.simulation.world import World


@dataclass(frozen=True)
class Scenario:
    """A world, how the vehicle goes through it with which sensors, and for how long.

    Attributes
    ----------
    world : World
    settings : SimulationSettings
        Of the motion and of the sensors aboard.
    duration_s : float
        Length of a mission that is not asked for more or less.
    """

    world: World
    settings: SimulationSettings
    duration_s: float
