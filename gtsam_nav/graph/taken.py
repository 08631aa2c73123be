"""Which sensor the graph takes, of several of a type of which it takes one."""

from __future__ import annotations

from gtsam_nav.config import Config
from gtsam_nav.graph.measurements.imu import preintegrable
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.sensors.odometry import velocity_sensor

TAKEN_ONCE = ("imu", "dvl", "odometry", "heading", "attitude", "depth")
"""Types of sensor of which the graph takes one; of the others it takes all."""


def twins_taken(mission: Mission, config: Config) -> dict[str, Sensor]:
    """The sensor that is taken in place of each that is left out, by the latter's name."""
    movers = velocity_sensor(mission), preintegrable(mission, config.graph.imu_min_rate_hz)
    chosen = {sensor.name for sensor in movers if sensor is not None}
    instead = {}
    for kind in TAKEN_ONCE:
        sensors = mission.of_type(kind)
        taken = next((s for s in sensors if s.name in chosen), next(iter(sensors), None))
        for sensor in sensors:
            if taken is not None and sensor is not taken:
                instead[sensor.name] = taken
    return instead
