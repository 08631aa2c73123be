"""The classic mistakes of a data set, each as what it does to a good mission.

A mistake is made in the samples or in the card: what the audit is to find, and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

import gtsam_nav as gn
from gtsam_nav.audit.motion import turned as turned_by
from gtsam_nav.frames import (
    Array,
    Origin,
    geodetic_from_ned,
    ned_from_geodetic,
    rotation_from_rpy,
    wrap_angle,
)
from gtsam_nav.mission import Mission
from gtsam_nav.series import GnssSeries, HeadingSeries
from gtsam_nav.simulation.settings import GnssSimulation, LandmarkSimulation, SimulationSettings

CURRENT_M_S = (-0.2, 0.15)
"""Towards north and east: half as fast as the marina's vehicle."""
G_M_S2 = 9.80665
KNOT_M_S = 0.514444
FLU = np.array([1.0, -1.0, -1.0])
LONG_ARM_M = (-2.0, 0.5, -2.3)
"""An antenna at the stern: a lever arm that matters."""


@dataclass(frozen=True)
class Mistake:
    """One mistake.

    Attributes
    ----------
    name : str
    scenario : str
        The simulation that it is made in.
    make : callable
        The mission with the mistake.
    check, sensor, fix : str
        What the audit must warn of, for which sensor, and what its card's line must hold.
    settings : SimulationSettings, optional
        Those of the scenario where absent.
    """

    name: str
    scenario: str
    make: Callable[[Mission], Mission]
    check: str
    sensor: str
    fix: str
    settings: SimulationSettings | None = None

    def mission(self, seed: int, duration_s: float | None = None) -> Mission:
        """The mission of a seed, mistake included."""
        return self.make(_simulated(self.scenario, seed, duration_s, self.settings))


@cache
def _simulated(
    scenario: str, seed: int, duration_s: float | None, settings: SimulationSettings | None
) -> Mission:
    return gn.simulate(scenario, seed, duration_s, settings)


def column(sensor: str, name: str, change: Callable[[Array], Array]) -> Callable[..., Mission]:
    """Alter one column of a sensor."""

    def make(mission: Mission) -> Mission:
        old = mission.sensors[sensor]
        series = replace(old.series, **{name: change(getattr(old.series, name))})
        return mission.with_sensor(replace(old, series=series))

    return make


def late(sensor: str, offset_s: float) -> Callable[[Mission], Mission]:
    """Stamp a sensor's samples too late."""

    def make(mission: Mission) -> Mission:
        old = mission.sensors[sensor]
        return mission.with_sensor(replace(old, series=old.series.shift(offset_s)))

    return make


def _in_ms(sensor: str) -> Callable[[Mission], Mission]:
    return column(sensor, "t", lambda t: 1e3 * t)


def turned(sensor: str, yaw_deg: float) -> Callable[[Mission], Mission]:
    """State a mounting that is turned about body z."""

    def make(mission: Mission) -> Mission:
        old = mission.sensors[sensor]
        R_bs = rotation_from_rpy(np.radians([0.0, 0.0, yaw_deg])) @ old.R_bs
        return mission.with_sensor(replace(old, R_bs=R_bs))

    return make


def stale(sensor: str, share: float) -> Callable[[Mission], Mission]:
    """Send the message before again instead of some."""

    def make(mission: Mission) -> Mission:
        old = mission.sensors[sensor]
        n = len(old.series)
        again = np.random.default_rng(n).uniform(size=n) < share
        again[0] = False
        source = np.maximum.accumulate(np.where(again, 0, np.arange(n)))
        columns = {
            name: values[source]
            for name in old.series.column_specs()
            if name not in ("t", "row") and (values := getattr(old.series, name)) is not None
        }
        return mission.with_sensor(replace(old, series=replace(old.series, **columns)))

    return make


def _through_water(sensor: str) -> Callable[[Mission], Mission]:
    """Velocities beside a current, by a sensor that is taken to read the ground."""

    def make(mission: Mission) -> Mission:
        old, heading = mission.sensors[sensor], mission.sensors["heading"].series
        assert isinstance(heading, HeadingSeries)
        yaw = np.interp(old.series.t, heading.t, np.unwrap(heading.heading))
        drift_b = turned_by(np.tile(CURRENT_M_S, (len(yaw), 1)), -yaw)
        name = "v_b" if old.type == "odometry" else "v_d"
        v_s = np.array(getattr(old.series, name))
        drift_s = np.column_stack([drift_b, np.zeros(len(yaw))]) @ old.R_bs
        series = replace(old.series, **{name: v_s - drift_s[:, : v_s.shape[1]]})
        return mission.with_sensor(replace(old, series=series))

    return make


def _flu(mission: Mission) -> Mission:
    forward_left_up = column("imu", "gyro_i", lambda v: v * FLU)(mission)
    return column("imu", "accel_i", lambda v: v * FLU)(forward_left_up)


def _reversed_arm(mission: Mission) -> Mission:
    gnss = mission.sensors["gnss"]
    return mission.with_sensor(replace(gnss, xyz_b=gnss.xyz_b * [-1.0, -1.0, 1.0]))


def _exchanged(ned: Array) -> Array:
    """East, north and up."""
    return ned[:, [1, 0, 2]] * [1.0, 1.0, -1.0]


def _exchanged_degrees(mission: Mission) -> Mission:
    """Latitude under longitude's name, and an origin that is the first fix."""
    gnss, origin = mission.sensors["gnss"], mission.origin
    assert isinstance(gnss.series, GnssSeries)
    assert origin is not None
    lat, lon, height = geodetic_from_ned(gnss.series.p_n, origin)
    there = Origin(float(lon[0]), float(lat[0]))
    series = replace(gnss.series, p_n=ned_from_geodetic(lon, lat, height, there))
    return replace(mission.with_sensor(replace(gnss, series=series)), origin=there)


def _from_east(heading: Array) -> Array:
    return wrap_angle(0.5 * np.pi - heading)


def _astern(heading: Array) -> Array:
    return wrap_angle(heading + np.pi)


def _read_as_degrees(heading: Array) -> Array:
    return np.radians(wrap_angle(heading))


def _without(*names: str, then: Callable[[Mission], Mission]) -> Callable[[Mission], Mission]:
    """A mistake in a mission that lacks some sensors."""
    return lambda mission: then(mission.without(*names))


SILENT = SimulationSettings(sonar=None)
"""The marina without its sonar, which takes most of the time."""
SIGHTED = SimulationSettings(sonar=None, landmarks=LandmarkSimulation(max_range_m=25.0))
"""In clear water: the default's camera sees too few landmarks to tell anything of it."""
STERN = SimulationSettings(sonar=None, gnss=GnssSimulation(xyz_m=LONG_ARM_M))

MISTAKES = (
    Mistake("gyro in deg/s", "marina", column("imu", "gyro_i", np.degrees),
            "gyro unit", "imu", "gyro_unit: deg/s", SILENT),
    Mistake("gyro in deg/s, no DVL", "laps", column("imu", "gyro_i", np.degrees),
            "gyro unit", "imu", "gyro_unit: deg/s"),
    Mistake("accelerometer in g", "marina", column("imu", "accel_i", lambda v: v / G_M_S2),
            "accelerometer unit", "imu", "accel_unit: g", SILENT),
    Mistake("gravity sign", "marina", column("imu", "accel_i", np.negative),
            "gravity sign", "imu", "scale: {ax: -1, ay: -1, az: -1}", SILENT),
    Mistake("IMU axes FLU", "marina", _flu, "gravity sign", "imu", "rpy_deg: [180", SILENT),
    Mistake("gyro z reversed", "marina", column("imu", "gyro_i", lambda v: v * [1.0, 1.0, -1.0]),
            "gyro sign", "imu", "gz: -1", SILENT),
    Mistake("GNSS velocity ENU", "laps", column("gnss", "v_n", _exchanged),
            "gnss velocity", "gnss", "columns: {vn: ve, ve: vn}"),
    Mistake("fixes ENU", "marina", column("gnss", "p_n", _exchanged),
            "fixes mirrored", "gnss", "columns: {n: e, e: n}", SILENT),
    Mistake("latitude and longitude exchanged", "marina", _exchanged_degrees,
            "fixes mirrored", "gnss", "columns: {lat_deg: lon_deg, lon_deg: lat_deg}", SILENT),
    Mistake("heading ENU", "marina", column("heading", "heading", _from_east),
            "heading against course", "heading", "rpy_deg: [0, 0, -90]", SILENT),
    Mistake("heading reversed sign", "marina", column("heading", "heading", np.negative),
            "heading against course", "heading", "scale: {heading_deg: -1}", SILENT),
    Mistake("heading 180 deg off", "marina", column("heading", "heading", _astern),
            "heading against course", "heading", "rpy_deg: [0, 0, -180]", SILENT),
    Mistake("heading in radians", "marina", column("heading", "heading", _read_as_degrees),
            "heading unit", "heading", "scale: {heading_deg: 57.29578}", SILENT),
    Mistake("heading in radians, no IMU", "marina",
            _without("imu", then=column("heading", "heading", _read_as_degrees)),
            "heading unit", "heading", "scale: {heading_deg: 57.29578}", SILENT),
    Mistake("heading in radians, no turns", "marina",
            _without("imu", "odometry", then=column("heading", "heading", _read_as_degrees)),
            "heading unit", "heading", "scale: {heading_deg: 57.29578}", SILENT),
    Mistake("roll reversed", "marina", column("attitude", "roll", np.negative),
            "roll sign", "attitude", "scale: {roll_deg: -1}", SILENT),
    Mistake("pitch reversed", "marina", column("attitude", "pitch", np.negative),
            "pitch sign", "attitude", "scale: {pitch_deg: -1}", SILENT),
    Mistake("depth upward", "marina", column("depth", "depth_m", np.negative),
            "depth sign", "depth", "scale: {depth_m: -1}", SILENT),
    Mistake("bearings reversed", "marina", column("landmarks", "bearing", np.negative),
            "bearing sign", "landmarks", "scale: {bearing_deg: -1}", SIGHTED),
    Mistake("bearings in radians", "marina", column("landmarks", "bearing", np.radians),
            "bearing unit", "landmarks", "scale: {bearing_deg: 57.29578}", SIGHTED),
    Mistake("bearings in degrees twice", "marina", column("landmarks", "bearing", np.degrees),
            "bearing unit", "landmarks", "scale: {bearing_deg: 0.01745329}", SIGHTED),
    Mistake("ranges in feet", "marina", column("landmarks", "range_m", lambda r: r / 0.3048),
            "range unit", "landmarks", "scale: {range_m: 0.3048}", SIGHTED),
    Mistake("mirrored sonar", "marina", column("sonar", "angle", np.negative),
            "sonar handedness", "sonar", "rpy_deg: [180"),
    Mistake("sonar angles in degrees", "marina", column("sonar", "angle", np.degrees),
            "sonar angle unit", "sonar", ""),
    Mistake("sonar head offset 20 deg", "marina", turned("sonar", 20.0),
            "sonar head offset", "sonar", "rpy_deg: [0, 0, "),
    Mistake("sonar head offset 90 deg", "marina", turned("sonar", 90.0),
            "sonar head offset", "sonar", "rpy_deg: [0, 0, "),
    Mistake("DVL axes exchanged", "marina", column("dvl", "v_d", lambda v: v[:, [1, 0, 2]]),
            "velocity axes", "dvl", "columns: {vx: vy, vy: vx}", SILENT),
    Mistake("DVL vx reversed", "marina", column("dvl", "v_d", lambda v: v * [-1, 1, 1]),
            "velocity axes", "dvl", "scale: {vx: -1}", SILENT),
    Mistake("DVL velocities reversed", "marina", column("dvl", "v_d", lambda v: v * [-1, -1, 1]),
            "velocity axes", "dvl", "scale: {vx: -1, vy: -1}", SILENT),
    Mistake("DVL vz reversed", "marina", column("dvl", "v_d", lambda v: v * [1, 1, -1]),
            "velocity axes", "dvl", "scale: {vz: -1}", SILENT),
    Mistake("DVL upside down", "marina", column("dvl", "v_d", lambda v: v * [1, -1, -1]),
            "velocity axes", "dvl", "rpy_deg: [180, 0, 45]", SILENT),
    Mistake("DVL misaligned by 10 deg", "marina", turned("dvl", 10.0),
            "velocity alignment", "dvl", "rpy_deg: [0, 0, ", SILENT),
    Mistake("DVL in knots", "marina", column("dvl", "v_d", lambda v: v / KNOT_M_S),
            "velocity unit", "dvl", "scale: {vx: 0.5144444, vy: 0.5144444, vz", SILENT),
    Mistake("DVL at half scale", "marina", column("dvl", "v_d", lambda v: 0.5 * v),
            "velocity scale", "dvl", "scale: {vx: ", SILENT),
    Mistake("DVL reads the water", "marina", _through_water("dvl"),
            "speed through water", "dvl", "through_water: true", SILENT),
    Mistake("odometry reads the water", "marina", _through_water("odometry"),
            "speed through water", "odometry", "type: dvl, through_water: true", SILENT),
    Mistake("odometry reads the water, no DVL", "marina",
            _without("dvl", then=_through_water("odometry")),
            "speed through water", "odometry", "type: dvl, through_water: true", SILENT),
    Mistake("odometry in deg/s", "marina", column("odometry", "yaw_rate", np.degrees),
            "gyro unit", "odometry", "scale: {wz: 0.01745329}", SILENT),
    Mistake("odometry yaw rate reversed", "marina", column("odometry", "yaw_rate", np.negative),
            "yaw rate sign", "odometry", "scale: {wz: -1}", SILENT),
    Mistake("IMU clock 0.5 s late", "marina", late("imu", 0.5),
            "clock offset", "imu", "time_offset_s: -0.", SILENT),
    Mistake("compass clock 0.5 s late", "marina", late("heading", 0.5),
            "clock offset", "heading", "time_offset_s: -0.", SILENT),
    Mistake("DVL clock 1 s late", "marina", late("dvl", 1.0),
            "clock offset", "dvl", "time_offset_s: -", SILENT),
    Mistake("GNSS clock 2 s late", "marina", late("gnss", 2.0),
            "clock offset", "gnss", "time_offset_s: -", SILENT),
    Mistake("compass in UTC, others in GPS time", "marina", late("heading", -18.0),
            "clock offset", "heading", "time_offset_s: +1", SILENT),
    Mistake("GNSS in GPS time, others in UTC", "marina", late("gnss", 18.0),
            "clock offset", "gnss", "time_offset_s: -1", SILENT),
    Mistake("lever arm sign", "marina", _reversed_arm, "lever arm", "gnss", "xyz_m: [-2", STERN),
    Mistake("DVL stamps in ms", "marina", _in_ms("dvl"),
            "stamp unit", "dvl", "scale: {t: 0.001}", SILENT),
    Mistake("stale headings", "marina", stale("heading", 0.1),
            "stale messages", "heading", "drop_repeats: true", SILENT),
    Mistake("stale fixes", "marina", stale("gnss", 0.1),
            "stale messages", "gnss", "drop_repeats: true", SILENT),
    Mistake("stale DVL", "marina", stale("dvl", 0.1),
            "stale messages", "dvl", "drop_repeats: true", SILENT),
)  # fmt: skip
