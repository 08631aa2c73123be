"""What corrects the inertial navigation: each sensor's measurements, ready for the filter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from gtsam_nav.config import Config
from gtsam_nav.ekf.aid import NO_ERRORS, Aid
from gtsam_nav.ekf.constraint_aids import constraints_on
from gtsam_nav.ekf.error_state import SharedErrors
from gtsam_nav.ekf.inertial_start import InertialStart
from gtsam_nav.ekf.strapdown import InertialState, Strapdown
from gtsam_nav.frames import Array
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.first_fixes import OFF_THE_NEXT, first_fixes, located
from gtsam_nav.sensors import depth, dvl, gnss, orientation
from gtsam_nav.sensors.fix_errors import AlikeFixes, alike_fixes, white_sigma
from gtsam_nav.sensors.noise import AttitudeNoise, DvlNoise, GnssNoise, HeadingNoise, OdometryNoise
from gtsam_nav.sensors.prediction import Prediction
from gtsam_nav.sensors.rates import rate_without_gyro_b
from gtsam_nav.series import AttitudeSeries, DepthSeries, GnssSeries, OdometrySeries

CURRENT_TIME_S = 3600.0
"""A current keeps for about so long: a tide turns in six hours."""


def aids_of(
    mission: Mission, strapdown: Strapdown, start: InertialStart, config: Config
) -> tuple[list[Aid], tuple[Rejection, ...]]:
    """All measurements that correct the filter, and the samples left out before it runs."""
    rejections: list[Rejection] = []
    aids: list[Aid] = []
    for receiver in mission.of_type("gnss"):
        usable, dropped = _usable_fixes(receiver)
        rejections += dropped
        aids += _gnss(usable, mission, strapdown, config)
    velocity_aids, dropped = _velocities(mission, strapdown, config)
    rejections += dropped
    aids += velocity_aids
    aids += _depths(mission, strapdown, config)
    aids += _orientation(mission, config)
    aids += constraints_on(mission, strapdown, start, config)
    return [aid for aid in aids if len(aid.t)], tuple(rejections)


def _usable_fixes(receiver: Sensor) -> tuple[Sensor, list[Rejection]]:
    """A receiver from its first fix on that the next ones bear out."""
    series = receiver.series
    assert isinstance(series, GnssSeries)
    off = located(series)
    off[first_fixes(series).first :] = False
    rejections = [
        Rejection(float(series.t[k]), receiver.name, int(series.row[k]), OFF_THE_NEXT)
        for k in np.flatnonzero(off).tolist()
    ]
    return replace(receiver, series=series.select(~off)), rejections


def _positions(receiver: Sensor, rows: int, gate: float | None) -> Iterator[Aid]:
    """Fixes of a receiver on n, e and, of three rows, d: an aid for all that share an error."""
    series, lever_b = receiver.series, receiver.xyz_b
    assert isinstance(series, GnssSeries)
    series = series.select(located(series))
    noise = GnssNoise.model_validate(receiver.noise)
    white = white_sigma(series, noise)

    def fixes(alike: AlikeFixes) -> Aid:
        p_n, sigma, share = series.p_n[alike.which], white[alike.which], alike.share

        def position(k: int, state: InertialState, shared: Array) -> Prediction:
            fix = gnss.predict(state.body, p_n[k], lever_b, sigma[k])
            residual = fix.residual[:rows] + (shared if len(shared) else 0.0)
            return Prediction(residual, fix.jacobian[:rows], fix.cov[:rows, :rows])

        drift = SharedErrors(alike.shared_sigma[:rows], np.full(rows, noise.correlation_time_s))
        return Aid(
            receiver.name,
            "position",
            rows,
            series.t[alike.which],
            series.row[alike.which],
            position,
            gate,
            drift if share else NO_ERRORS,
            np.eye(rows) if share else np.empty((rows, 0)),
            receiver=receiver.name,
        )

    yield from map(fixes, alike_fixes(series, noise))


def _gnss(
    receiver: Sensor, mission: Mission, strapdown: Strapdown, config: Config
) -> Iterator[Aid]:
    series, settings, lever_b = receiver.series, config.gnss, receiver.xyz_b
    assert isinstance(series, GnssSeries)
    noise = GnssNoise.model_validate(receiver.noise)
    rows = 3 if settings.use_height or mission.first("depth") is None else 2
    gate = settings.position_gate_probability if settings.reject_outliers else None
    yield from _positions(receiver, rows, gate)
    v_n = series.v_n
    if v_n is None:
        return

    t = series.t - noise.velocity_lag_s
    unheard_b = rate_without_gyro_b(mission, t)

    def velocity(k: int, state: InertialState, _: Array) -> Prediction:
        rate_b = strapdown.rate_b(state, unheard_b[k])
        found = gnss.predict_velocity(state.body, v_n[k], rate_b, lever_b, noise.sigma_velocity_m_s)
        return Prediction(found.residual[:rows], found.jacobian[:rows], found.cov[:rows, :rows])

    yield Aid(
        f"{receiver.name} velocity",
        "velocity",
        rows,
        t,
        series.row,
        velocity,
        settings.velocity_gate_probability if settings.reject_outliers else None,
        v_n=v_n,
        sigma_v=noise.sigma_velocity_m_s,
        receiver=receiver.name,
    )


def _velocities(
    mission: Mission, strapdown: Strapdown, config: Config
) -> tuple[list[Aid], list[Rejection]]:
    """DVLs; odometry where no DVL measures."""
    gate, limit_s = config.ins_ekf.gate_probability, config.motion.water_lock_after_s
    aids: list[Aid] = []
    rejections: list[Rejection] = []
    dvls = mission.of_type("dvl")
    water = [DvlNoise.model_validate(sensor.noise).water_sigma_m_s for sensor in dvls]
    for sensor in dvls:
        still = np.zeros((len(sensor.series), 3))
        found = dvl.body_velocities(sensor, still, limit_s, current_apart=True)
        rejections += found.rejections
        unheard_b = rate_without_gyro_b(mission, found.t)
        aids.append(_dvl(found, sensor, max(water), unheard_b, strapdown, gate))
    if not any(len(aid.t) for aid in aids):
        aids = [_odometry(sensor, strapdown, gate) for sensor in mission.of_type("odometry")]
    return aids, rejections


def _dvl(
    found: dvl.BodyVelocities,
    sensor: Sensor,
    water_sigma_m_s: float,
    unheard_b: Array,
    strapdown: Strapdown,
    gate: float,
) -> Aid:
    """Velocities of a DVL; the current, of the spread given, is that of all others too."""
    noise = DvlNoise.model_validate(sensor.noise)
    scale, misalignment = noise.scale_sigma, np.radians(noise.misalignment_sigma_deg)
    current = water_sigma_m_s if np.any(found.through_water) else 0.0
    errors = SharedErrors(
        np.array([scale, misalignment, 0.0, 0.0, current, current]),
        np.repeat([np.inf, CURRENT_TIME_S], [4, 2]),
    )
    return _body_velocity(found, errors, sensor.xyz_b, unheard_b, strapdown, gate)


def _odometry(sensor: Sensor, strapdown: Strapdown, gate: float) -> Aid:
    """Velocities; the yaw rate is the gyro's to know. What drives or floats does not rise."""
    series, noise = sensor.series, OdometryNoise.model_validate(sensor.noise)
    assert isinstance(series, OdometrySeries)
    speed = np.hypot(*series.v_b.T)
    slip = noise.slip_sigma * float(np.sqrt(np.mean(speed**2))) if len(speed) else 0.0
    errors = SharedErrors(
        np.array([noise.scale_sigma, np.radians(noise.misalignment_sigma_deg), slip, slip, 0, 0]),
        np.repeat([np.inf, noise.slip_time_s, np.inf], 2),
    )
    v_b = np.column_stack([series.v_b, np.zeros(len(series))])
    found = dvl.BodyVelocities(sensor.name, series.t, v_b, series.sigma_v, series.row)
    return _body_velocity(found, errors, np.zeros(3), np.zeros_like(v_b), strapdown, gate)


def _body_velocity(
    found: dvl.BodyVelocities,
    errors: SharedErrors,
    arm_b: Array,
    unheard_b: Array,
    strapdown: Strapdown,
    gate: float,
) -> Aid:
    """Velocities at the end of an arm that share errors of scale, misalignment (clockwise), slip
    on two axes, and the current, north and east, of those through the water.

    The arm turns by the gyro less its bias as it is known by then: a bias would lend the vehicle a
    constant velocity sideways. While the gyro is silent it turns by ``unheard_b``, shape (n, 3).
    """
    some = errors.sigma > 0
    in_current = found.through_water if errors.sigma[-1] > 0 else np.zeros(len(found), dtype=bool)
    common = int(np.count_nonzero(some[-2:]))

    def measured_n(k: int, state: InertialState, shared: Array) -> Array:
        current_n = np.append(shared[-2:], 0.0) if in_current[k] else 0.0
        return np.asarray(state.v_n - current_n)

    def by_error(k: int, state: InertialState, shared: Array) -> Array:
        # of the velocity as predicted: that measured is noisy, and would seem too long
        forward, right, down = state.body.R_nb.T @ measured_n(k, state, shared)
        scaled, turned = (forward, right, down), (-right, forward, 0.0)
        moved = -state.body.R_nb[:2].T * in_current[k]
        return np.column_stack([scaled, turned, np.eye(3, 2), moved])[:, some]

    def velocity(k: int, state: InertialState, shared: Array) -> Prediction:
        turning_b = np.cross(strapdown.rate_b(state, unheard_b[k]), arm_b)
        # what turns with the body, and is scaled, is the way through the water
        body = replace(state.body, v_n=measured_n(k, state, shared))
        own = len(shared) - common
        errors_b = by_error(k, state, shared)[:, :own] @ shared[:own]
        measured = found.v_b[k] - turning_b - errors_b
        return dvl.predict(body, measured, float(found.sigma[k]))

    return Aid(
        found.sensor,
        "body velocity",
        3,
        found.t,
        found.row,
        velocity,
        gate,
        SharedErrors(errors.sigma[some], errors.time_s[some]),
        by_error,
        common,
    )


def _depths(mission: Mission, strapdown: Strapdown, config: Config) -> Iterator[Aid]:
    for sensor in mission.of_type("depth"):
        yield _depth(sensor, strapdown, config.ins_ekf.gate_probability)


def _depth(sensor: Sensor, strapdown: Strapdown, gate: float) -> Aid:
    series, lever_b = sensor.series, sensor.xyz_b
    assert isinstance(series, DepthSeries)
    depth_m, sigma = series.depth_m, series.sigma

    def below(k: int, state: InertialState, _: Array) -> Prediction:
        # the water's surface falls away from the plane of the mission's NED
        sag_m = 0.0 if strapdown.level is None else strapdown.level.sag_m(state.p_n)
        return depth.predict(state.body, depth_m[k] + sag_m, lever_b, float(sigma[k]))

    return Aid(sensor.name, "depth", 1, series.t, series.row, below, gate)


def _orientation(mission: Mission, config: Config) -> Iterator[Aid]:
    gate = config.ins_ekf.gate_probability
    compass, headings = mission.first("heading"), orientation.headings_true(mission)
    if compass is not None and headings is not None:
        noise = HeadingNoise.model_validate(compass.noise)
        reading, sigma = headings.heading, headings.sigma

        def heading(k: int, state: InertialState, shared: Array) -> Prediction:
            bias = float(shared.sum())
            return orientation.predict_heading(state.body, reading[k], bias, float(sigma[k]))

        shared = _lasting(
            np.radians([noise.bias_sigma_deg, noise.disturbance_sigma_deg]),
            [np.inf, noise.disturbance_time_s],
        )
        yield Aid(
            compass.name,
            "heading",
            1,
            headings.t,
            headings.row,
            heading,
            gate,
            shared,
            np.full((1, len(shared)), -1.0),
        )
    for sensor in mission.of_type("attitude"):
        yield _tilt(sensor, gate)


def _tilt(sensor: Sensor, gate: float) -> Aid:
    series = sensor.series
    assert isinstance(series, AttitudeSeries)
    noise = AttitudeNoise.model_validate(sensor.noise)
    roll, pitch, sigma = series.roll, series.pitch, series.sigma

    def tilt(k: int, state: InertialState, shared: Array) -> Prediction:
        error = _summed(shared, 2)
        measured = roll[k] + error[0], pitch[k] + error[1]
        return orientation.predict_tilt(state.body, *measured, float(sigma[k]))

    errors = _lasting(
        np.radians([noise.bias_sigma_deg, noise.disturbance_sigma_deg]),
        [np.inf, noise.disturbance_time_s],
        axes=2,
    )
    return Aid(
        sensor.name,
        "tilt",
        2,
        series.t,
        series.row,
        tilt,
        gate,
        errors,
        np.tile(-np.eye(2), len(errors) // 2),
    )


def _lasting(sigma: ArrayLike, time_s: ArrayLike, axes: int = 1) -> SharedErrors:
    """Errors that last, each on so many axes; those of no spread are left out."""
    spread, time = np.repeat(sigma, axes), np.repeat(time_s, axes)
    return SharedErrors(spread[spread > 0], time[spread > 0])


def _summed(shared: Array, axes: int) -> Array:
    """Errors of `_lasting` on each axis, shape (axes,)."""
    return np.asarray(shared.reshape(-1, axes).sum(axis=0))
