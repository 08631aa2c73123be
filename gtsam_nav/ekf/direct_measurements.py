"""What the dead-reckoning filter takes of a mission: level velocity, turn rate, depth, heading."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtsam_nav.ekf.constant_velocity import DEPTH, VELOCITY, YAW, YAW_RATE, Measurements
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Rejection
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.sensors.depth import origin_depths
from gtsam_nav.sensors.dvl import body_velocities
from gtsam_nav.sensors.orientation import headings_true, in_level_axes, level_attitudes
from gtsam_nav.sensors.rates import angular_rate_b, mean_gyro_bias_b
from gtsam_nav.sensors.silences import is_heard
from gtsam_nav.series import HeadingSeries, IntArray, OdometrySeries


def collect_measurements(
    mission: Mission, settings: MotionSettings
) -> tuple[Measurements, tuple[Rejection, ...]]:
    """All that the filter takes, in the order of time, and the samples left out.

    The filter goes along the level surface: its state has no roll and pitch, velocities are in
    level axes, and depths are below the water.

    Raises
    ------
    DataError
        Where nothing measures the velocity.
    """
    parts: list[Measurements] = []
    rejections: list[Rejection] = []
    for dvl in mission.of_type("dvl"):
        omega_b = angular_rate_b(mission, dvl.series.t, mean_gyro_bias_b(mission))
        velocities = body_velocities(dvl, omega_b, settings.water_lock_after_s)
        rejections += velocities.rejections
        parts.append(
            _part(
                dvl.name,
                velocities.t,
                velocities.row,
                VELOCITY.start,
                in_level_axes(mission, velocities.t, velocities.v_b),
                np.tile(velocities.sigma[:, None] ** 2, 3),
            )
        )
    headings, by_dvl = headings_true(mission), any(map(len, parts))
    if not by_dvl:
        parts += _odometry(mission)
    if not any(map(len, parts)):
        raise DataError(
            f"mission '{mission.name}': dead reckoning needs a DVL with valid samples or odometry;"
            f" the mission has: {', '.join(sorted(mission.sensors)) or 'no sensor'}"
        )
    parts += _depths(mission)
    if headings is not None:
        value, sigma = headings.heading[:, None], headings.sigma[:, None]
        parts.append(_part("heading", headings.t, headings.row, YAW, value, sigma**2))
    if headings is not None or by_dvl:  # else they come with the speeds
        parts += _turn_rates(mission, headings)
    return _merged(parts), tuple(rejections)


def _odometry(mission: Mission) -> Iterator[Measurements]:
    # wheels and thrusters slip in turns: while a compass tells these, they are the compass's
    size = 4 if headings_true(mission) is None else 3
    for sensor in mission.of_type("odometry"):
        series = sensor.series
        assert isinstance(series, OdometrySeries)
        # u, v, w and r: what drives or floats moves in its own plane, which may lean
        v_b = np.column_stack([series.v_b, np.zeros(len(series))])
        value = np.column_stack([in_level_axes(mission, series.t, v_b), series.yaw_rate])
        s_v, s_w = series.sigma_v, series.sigma_yaw_rate
        variance = np.column_stack([s_v, s_v, s_v, s_w]) ** 2
        start = VELOCITY.start
        yield _part(sensor.name, series.t, series.row, start, value[:, :size], variance[:, :size])


def _turn_rates(mission: Mission, headings: HeadingSeries | None) -> Iterator[Measurements]:
    """What odometry tells of the turns while no compass does, apart from its speeds."""
    for sensor in mission.of_type("odometry"):
        series, name = sensor.series, sensor.name
        assert isinstance(series, OdometrySeries)
        if headings is not None:
            told = is_heard(headings.t, series.t)
            series, name = series.select(~told), f"{name} yaw rate"
        value, sigma = series.yaw_rate[:, None], series.sigma_yaw_rate[:, None]
        yield _part(name, series.t, series.row, YAW_RATE, value, sigma**2)


def _depths(mission: Mission) -> Iterator[Measurements]:
    for sensor in mission.of_type("depth"):
        series = sensor.series
        depth_m, sigma = origin_depths(sensor, series.t, level_attitudes(mission, series.t))
        value, variance = depth_m[:, None], sigma[:, None] ** 2
        yield _part(sensor.name, series.t, series.row, DEPTH, value, variance)


def _part(
    name: str, t: Array, row: IntArray, first: int, value: Array, variance: Array
) -> Measurements:
    """Measurements of one sensor; ``value`` and ``variance`` have a column an entry."""
    m, size = value.shape
    rest = ((0, 0), (0, 4 - size))
    return Measurements(
        t=t,
        first=np.full(m, first),
        size=np.full(m, size),
        value=np.pad(value, rest),
        variance=np.pad(variance, rest),
        sensor=np.zeros(m, dtype=np.int64),
        row=row,
        names=(name,),
    )


def _merged(parts: list[Measurements]) -> Measurements:
    """All measurements in the order of time; of equal times, in the order of the parts."""
    order = np.argsort(np.concatenate([part.t for part in parts]), kind="stable")
    return Measurements(
        t=np.concatenate([part.t for part in parts])[order],
        first=np.concatenate([part.first for part in parts])[order],
        size=np.concatenate([part.size for part in parts])[order],
        value=np.concatenate([part.value for part in parts])[order],
        variance=np.concatenate([part.variance for part in parts])[order],
        sensor=np.repeat(np.arange(len(parts)), [len(part) for part in parts])[order],
        row=np.concatenate([part.row for part in parts])[order],
        names=tuple(part.names[0] for part in parts),
    )
