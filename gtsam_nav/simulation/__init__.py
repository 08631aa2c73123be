"""Simulated missions: a world, a vehicle, its sensors and their faults."""

from gtsam_nav.simulation.settings import SimulationSettings
from gtsam_nav.simulation.simulator import WORLDS, simulate

__all__ = ["WORLDS", "SimulationSettings", "simulate"]
