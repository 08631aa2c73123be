"""Inertial navigation, corrected by what the mission has: the strapdown error-state EKF.

After the GPS/INS filters with outlier rejection for surface vessels; the forms are those of Groves
(2013), chapters 3 and 14. Closed loop: every accepted measurement corrects the state at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.ekf.aid import Aid
from gtsam_nav.ekf.aiding import aids_of
from gtsam_nav.ekf.constraint_aids import NONHOLONOMIC
from gtsam_nav.ekf.error_state import innovations
from gtsam_nav.ekf.inertial_start import inertial_start
from gtsam_nav.ekf.ins_run import History, InsRun
from gtsam_nav.ekf.smoothing import from_found_yaw, smoothed_history
from gtsam_nav.ekf.strapdown import (
    ACCEL_BIAS,
    GYRO_BIAS,
    NU,
    RHO,
    THETA,
    InertialState,
    Strapdown,
)
from gtsam_nav.errors import DataError, EstimationError
from gtsam_nav.frames import Array, rotation_from_quaternion
from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.preprocess.accelerometer_units import check_accelerometer_unit
from gtsam_nav.preprocess.alignment import align
from gtsam_nav.preprocess.stated_rest import stated_rests
from gtsam_nav.preprocess.unaided import said_of_drift
from gtsam_nav.sensors.twins import said_of_twin
from gtsam_nav.solution import Innovations, Progress, SlowStates, Solution, StageClock
from gtsam_nav.trajectory import Trajectory, record_times

FASTEST_M_S = 1000.0
"""No vehicle is as fast, nor is an IMU that drifts for an hour."""
UNAIDED_S = 60.0
"""An IMU that tells the way alone for so long, at the end, is worth a warning."""


def estimate(mission: Mission, config: Config, progress: Progress) -> Solution:
    """Navigate a mission by its IMU, aided by GNSS, DVL or odometry, depth, compass and tilt.

    Parameters
    ----------
    mission : Mission
        With an IMU; all else is used where present. With an IMU and a stated start alone this is
        pure inertial navigation.
    config : Config
        ``ins_ekf.smooth`` runs the smoother; the filter's own estimate is then ``online``.
    progress : Progress

    Raises
    ------
    DataError
        Where the mission has no IMU.
    EstimationError
        Where the filter diverges to values that are not finite, or that no vehicle has.
    """
    clock = StageClock()
    with clock.stage("prepare"):
        align(mission)  # refuses a mission without a span in time
        imu = _imu(mission)
        strapdown = Strapdown(imu, mission.origin)
        start = inertial_start(mission, imu, config.motion)
        aids, rejections = aids_of(mission, strapdown, start, config)
    with clock.stage("filter"):
        run = InsRun(strapdown, start, aids, config.ins_ekf.smooth)
        t = record_times(*mission.span_s, config.motion.rate_hz)
        history = run.run(t, progress)
        filtered = [history.nodes[k] for k in history.recorded]
        states, P = [node.state for node in filtered], [node.P for node in filtered]
        trajectory = online = _trajectory(states, P)
    if config.ins_ekf.smooth:
        with clock.stage("smoother"):
            progress("smoother", 0.0)
            smoothed = smoothed_history(history)
            if smoothed.began_without_yaw:
                del run, history  # as large as those of the passes that follow
                run, smoothed = from_found_yaw(strapdown, start, aids, smoothed, t, progress)
                history = run.history
            states, P = smoothed.states, smoothed.P
            trajectory = _trajectory(states, P)
    progress("inertial navigation", 1.0)
    return Solution(
        method="ins-ekf",
        trajectory=trajectory,
        mission=mission,
        georeferenced=start.georeferenced,
        online=online if config.ins_ekf.smooth else None,
        rejections=(*mission.rejections, *rejections, *history.rejections),
        warnings=(
            *mission.warnings,
            *_idle_imus(mission, imu),
            *stated_rests(mission, config.motion)[1],
            *_silences(strapdown, imu, t),
            *run.doubts(),
            *_unaided(aids, history, trajectory),
            *_depth_unmeasured(mission),
        ),
        slow_states=_slow_states(states, P, imu),
        innovations=_innovations(aids, history),
        gnss_used=_fixes_used(aids, history),
        stage_s=clock.seconds,
    )


def _imu(mission: Mission) -> Sensor:
    imu = mission.first("imu")
    if imu is None:
        raise DataError(
            f"mission '{mission.name}': inertial navigation needs an IMU; the mission has:"
            f" {mission.aboard}"
        )
    check_accelerometer_unit(mission, imu)
    return imu


def _silences(strapdown: Strapdown, imu: Sensor, t: Array) -> tuple[str, ...]:
    """What is said of spells without readings."""
    return tuple(
        f"the IMU '{imu.name}' is silent from {a:.1f} s to {b:.1f} s: the vehicle is taken to keep"
        " its velocity"
        for a, b in strapdown.silences(float(t[0]), float(t[-1]))
    )


def _unaided(aids: list[Aid], history: History, trajectory: Trajectory) -> Iterator[str]:
    """What is said where in the end, or all along, nothing but the IMU tells the way.

    That wheels do not slip sideways tells nothing of the way along.
    """
    tells = [
        aid.observes in ("position", "velocity", "body velocity") and aid.name != NONHOLONOMIC
        for aid in aids
    ]
    last = [used[-1][0] for used, way in zip(history.used, tells, strict=True) if way and used]
    begin, end = max(last, default=float(trajectory.t[0])), float(trajectory.t[-1])
    if end - begin >= UNAIDED_S:
        yield said_of_drift(trajectory, begin)


def _depth_unmeasured(mission: Mission) -> Iterator[str]:
    """What is said where nothing tells the depth that the vehicle begins at."""
    told = mission.first("depth") is not None or mission.first("gnss") is not None
    if not told and mission.initial.p_n is None:
        yield (
            "nothing measures the depth: it is counted from 0 m at the start; a depth gauge, GNSS"
            " or 'initial: position_ned_m' would tell it"
        )


def _trajectory(states: list[InertialState], P: list[Array]) -> Trajectory:
    q_nb, p_n = np.array([s.q_nb_wxyz for s in states]), np.array([s.p_n for s in states])
    v_n = np.array([s.v_n for s in states])
    t, cov = np.array([s.t for s in states]), np.array(P)
    _check_sound(t, np.hstack([q_nb, p_n, v_n]), v_n, cov)
    R_nb = rotation_from_quaternion(q_nb)
    # errors (theta_b, rho_b, nu_b) to (dp_n, dtheta_n), all along the navigation axes
    J = np.zeros((len(states), 9, 9))
    for rows, entries in ((slice(0, 3), RHO), (slice(3, 6), THETA), (slice(6, 9), NU)):
        J[:, rows, entries] = R_nb
    cov_n = J @ cov[:, :9, :9] @ np.swapaxes(J, 1, 2)
    return Trajectory(
        t=t,
        p_n=p_n,
        q_nb_wxyz=q_nb,
        v_n=v_n,
        cov_pose_n=cov_n[:, :6, :6],
        sigma_v_n=np.sqrt(np.diagonal(cov_n[:, 6:, 6:], axis1=1, axis2=2)),
    )


def _idle_imus(mission: Mission, taken: Sensor) -> Iterator[str]:
    """IMUs beside the one that is integrated."""
    for imu in mission.of_type("imu"):
        if imu is not taken:
            yield said_of_twin(imu, f"ins-ekf takes the first, '{taken.name}'")


def _check_sound(t: Array, states: Array, v_n: Array, cov: Array) -> None:
    """Refuse what only a filter that has diverged says."""
    if not np.all(np.isfinite(states)):
        raise EstimationError(
            "inertial navigation diverged: the state is not finite; a heading would hold it: a"
            " compass's, 'initial: heading_deg' in the card, or velocities that show it"
        )
    too_fast = np.linalg.norm(v_n, axis=1) > FASTEST_M_S
    if np.any(too_fast):
        raise EstimationError(
            f"inertial navigation diverged: at {t[too_fast][0]:.1f} s it is faster than"
            f" {FASTEST_M_S:.0f} m/s"
        )
    if not np.all(np.diagonal(cov, axis1=1, axis2=2) >= 0.0):
        raise EstimationError("inertial navigation diverged: a variance is not positive")


def _slow_states(states: list[InertialState], P: list[Array], imu: Sensor) -> SlowStates:
    """Biases along the IMU's own axes."""
    cov, R_bs = np.array(P), imu.R_bs
    columns: dict[str, tuple[Array, Array]] = {}
    for name, unit, entries, biases_b in (
        ("gyro", "rad_s", GYRO_BIAS, [s.gyro_bias_b for s in states]),
        ("accel", "m_s2", ACCEL_BIAS, [s.accel_bias_b for s in states]),
    ):
        bias_i = np.array(biases_b) @ R_bs
        cov_i = R_bs.T @ cov[:, entries, entries] @ R_bs
        sigma = np.sqrt(np.diagonal(cov_i, axis1=1, axis2=2))
        for k, axis in enumerate("xyz"):
            columns[f"{name}_{axis}_{unit}"] = bias_i[:, k], sigma[:, k]
    return SlowStates(np.array([s.t for s in states]), columns)


def _innovations(aids: list[Aid], history: History) -> Mapping[str, Innovations]:
    """Normalised innovations squared of what was used, by sensor.

    One reading, as that of the first levelling, makes no statistics.
    """
    by_name: dict[str, list[tuple[float, Array]]] = {}
    for aid, used in zip(aids, history.used, strict=True):
        by_name.setdefault(aid.name, []).extend(used)
    found = ((name, innovations(sorted(used, key=_time))) for name, used in by_name.items())
    return {name: own for name, own in found if own is not None}


def _time(used: tuple[float, Array]) -> float:
    return used[0]


def _fixes_used(aids: list[Aid], history: History) -> int:
    return sum(
        len(used)
        for aid, used in zip(aids, history.used, strict=True)
        if aid.observes == "position"
    )
