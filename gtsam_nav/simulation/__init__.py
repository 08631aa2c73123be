"""Simulated missions: a world, a vehicle, its sensors and their faults."""

from gtsam_nav.simulation.fault_specs import parse_fault
from gtsam_nav.simulation.faults import Fault
from gtsam_nav.simulation.injection import inject
from gtsam_nav.simulation.scenario import Scenario
from gtsam_nav.simulation.settings import SimulationSettings
from gtsam_nav.simulation.simulator import SCENARIOS, make_scenario, simulate

__all__ = [
    "SCENARIOS",
    "Fault",
    "Scenario",
    "SimulationSettings",
    "inject",
    "make_scenario",
    "parse_fault",
    "simulate",
]
