"""Faults into missions: what an estimator sees, and never what it is scored on."""

from __future__ import annotations

import logging
import zlib
from collections.abc import Iterable
from dataclasses import fields, replace

import numpy as np

from gtsam_nav.errors import ConfigError
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import Series
from gtsam_nav.simulation.fault_specs import parse_fault
from gtsam_nav.simulation.faults import FalseLoops, Fault, SensorFault

logger = logging.getLogger(__name__)

SONAR_TYPES = ("beams", "scans")
"""What the target ``sonar`` stands for where no sensor has that name."""


def inject(mission: Mission, faults: Iterable[Fault | str], seed: int = 0) -> Mission:
    """Spoil a mission, one fault after the other.

    Parameters
    ----------
    mission : Mission
        As an estimator gets it: what it is scored on is put aside before. `gtsam_nav.estimate` sees
        to that, so that a share of the fixes is one of those that the GNSS policy leaves.
    faults : iterable of Fault or str
        Specifications are read by `parse_fault`.
    seed : int
        A fault draws the same numbers for the same seed, whatever else is injected.

    Returns
    -------
    Mission
        Its ``faults`` name what was injected. The reference is untouched.

    Raises
    ------
    ConfigError
        For a specification that cannot be read, a sensor that the mission has not, and a fault that
        its type cannot have.
    """
    for item in faults:
        fault = parse_fault(item) if isinstance(item, str) else item
        # false closures are drawn by the method that closes loops
        targets = [] if isinstance(fault, FalseLoops) else _targets(mission, fault)
        for k, sensor in enumerate(targets):
            assert isinstance(fault, SensorFault)
            rng = np.random.default_rng([seed, zlib.crc32(str(fault).encode()), k])
            spoilt = replace(sensor, series=fault.altered(sensor.series, rng))
            mission = mission.with_sensor(spoilt)
        if targets and all(
            _same(sensor.series, mission.sensors[sensor.name].series) for sensor in targets
        ):
            warning = f"the fault {fault} touches no sample"
            mission = replace(mission, warnings=(*mission.warnings, warning))
        logger.info("injected %s, seed %d", fault, seed)
        mission = replace(mission, faults=(*mission.faults, str(fault)))
    return mission


def _same(a: Series, b: Series) -> bool:
    """Whether two series of a type hold the same samples."""
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))


def _targets(mission: Mission, fault: SensorFault) -> list[Sensor]:
    """The sensor of that name, else those of that type."""
    estimating = {name: s for name, s in mission.sensors.items() if s.type != "reference"}
    if fault.target in estimating:
        return [estimating[fault.target]]
    types = SONAR_TYPES if fault.target == "sonar" else (fault.target,)
    found = [s for s in estimating.values() if s.type in types]
    if not found:
        choices = ", ".join(dict.fromkeys([*estimating, *(s.type for s in estimating.values())]))
        raise ConfigError(f"'{fault}': no sensor '{fault.target}'; the choices are: {choices}")
    return found
