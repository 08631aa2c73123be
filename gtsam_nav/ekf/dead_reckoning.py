"""Dead reckoning: the 8-state constant-velocity EKF on velocity, heading and depth.

State: n, e, d and yaw in the navigation frame, body velocities u, v, w and yaw rate r. Mallios et
al., *Scan matching SLAM in underwater environments*, Autonomous Robots 36 (2014), section 3.1.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from gtsam_nav.config import Config
from gtsam_nav.ekf.settings import DeadReckoningSettings
from gtsam_nav.errors import DataError, EstimationError
from gtsam_nav.frames import Array, quaternion_from_rpy, wrap_angle
from gtsam_nav.mission import DepthSeries, Mission, OdometrySeries, Rejection
from gtsam_nav.preprocess.alignment import Alignment, align
from gtsam_nav.preprocess.settings import MotionSettings
from gtsam_nav.sensors.dvl import body_velocities
from gtsam_nav.sensors.orientation import headings_true, tilt_at
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.sensors.rates import angular_rate_b
from gtsam_nav.solution import Innovations, Progress, Solution, StageClock
from gtsam_nav.trajectory import Trajectory

YAW, VELOCITY, YAW_RATE = 3, slice(4, 7), 7


@dataclass(frozen=True)
class Update:
    """One linear measurement of some entries of the state."""

    t: float
    sensor: str
    row: int
    entries: tuple[int, ...]
    value: Array
    variance: Array


def estimate(mission: Mission, config: Config, progress: Progress) -> Solution:
    """Dead-reckon a mission.

    Parameters
    ----------
    mission : Mission
        With a DVL or odometry; heading and depth are used where present.
    config : Config
    progress : Progress

    Raises
    ------
    DataError
        Where the mission has neither a DVL with valid samples nor odometry.
    EstimationError
        Where the filter diverges to values that are not finite.
    """
    clock = StageClock()
    with clock.stage("prepare"):
        start = align(mission)
        updates, rejections = collect_updates(mission, config.motion)
    with clock.stage("filter"):
        dr = DeadReckoning(start, config.motion, config.dr)
        dr.run(updates, mission.span_s[1], progress)
    return Solution(
        method="dr",
        trajectory=dr.trajectory(mission),
        mission=mission,
        georeferenced=start.georeferenced,
        rejections=(*mission.rejections, *rejections, *dr.rejections),
        warnings=mission.warnings,
        innovations=dr.innovations(),
        gnss_used=1 if start.georeferenced and mission.initial.p_n is None else 0,
        stage_s=clock.seconds,
    )


def collect_updates(
    mission: Mission, settings: MotionSettings
) -> tuple[list[Update], tuple[Rejection, ...]]:
    """All measurements that the filter takes, in the order of time, and those left out."""
    updates: list[Update] = []
    rejections: list[Rejection] = []
    for dvl in mission.of_type("dvl"):
        omega_b = angular_rate_b(mission, dvl.series.t)
        samples = body_velocities(dvl, omega_b, settings.water_lock_after_s)
        rejections += samples.rejections
        for t, row, v_b, sigma in zip(
            samples.t, samples.row, samples.v_b, samples.sigma, strict=True
        ):
            updates.append(Update(t, dvl.name, row, (4, 5, 6), v_b, np.full(3, sigma**2)))
    if not updates:
        updates += _odometry_updates(mission)
    if not updates:
        raise DataError(
            f"mission '{mission.name}': dead reckoning needs a DVL with valid samples or odometry;"
            f" the mission has: {', '.join(sorted(mission.sensors)) or 'no sensor'}"
        )
    updates += _depth_updates(mission)
    headings = headings_true(mission)
    if headings is not None:
        for t, row, heading, sigma in zip(
            headings.t, headings.row, headings.heading, headings.sigma, strict=True
        ):
            value = np.array([heading])
            updates.append(Update(t, "heading", row, (YAW,), value, np.array([sigma**2])))
    updates.sort(key=lambda update: update.t)
    return updates, tuple(rejections)


def _odometry_updates(mission: Mission) -> Iterator[Update]:
    for sensor in mission.of_type("odometry"):
        series = sensor.series
        assert isinstance(series, OdometrySeries)
        for k in range(len(series)):
            value = np.array([*series.v_b[k], 0.0, series.yaw_rate[k]])
            s_v, s_w = series.sigma_v[k], series.sigma_yaw_rate[k]
            variance = np.array([s_v, s_v, s_v, s_w]) ** 2
            t, row = float(series.t[k]), int(series.row[k])
            yield Update(t, sensor.name, row, (4, 5, 6, YAW_RATE), value, variance)


def _depth_updates(mission: Mission) -> Iterator[Update]:
    for sensor in mission.of_type("depth"):
        series = sensor.series
        assert isinstance(series, DepthSeries)
        tilt, _ = tilt_at(mission, series.t)
        # height of the sensor below the body's origin, for small tilt exact enough in 1 cm
        x, y, z = sensor.xyz_b
        below = z * np.cos(tilt[:, 0]) * np.cos(tilt[:, 1]) - x * np.sin(tilt[:, 1])
        below += y * np.sin(tilt[:, 0]) * np.cos(tilt[:, 1])
        for k in range(len(series)):
            value, variance = series.depth_m[k : k + 1] - below[k], series.sigma[k : k + 1] ** 2
            t, row = float(series.t[k]), int(series.row[k])
            yield Update(t, sensor.name, row, (2,), value, variance)


@dataclass
class DeadReckoning:
    """The filter: constant body velocity driven by white acceleration.

    Parameters
    ----------
    start : Alignment
    model : MotionSettings
    settings : DeadReckoningSettings
    """

    start: Alignment
    model: MotionSettings
    settings: DeadReckoningSettings
    rejections: list[Rejection] = field(default_factory=list)

    def __post_init__(self) -> None:
        start = self.start
        self.t = start.t
        self.x = np.array([*start.p_n, start.rpy[2], 0.0, 0.0, 0.0, 0.0])
        self.P = np.diag([*start.sigma_p, start.sigma_rpy[2], 1.0, 1.0, 0.5, 0.2]) ** 2
        s = self.model
        self._accel_variance = (
            np.array(
                [
                    s.sigma_accel_m_s2,
                    s.sigma_accel_m_s2,
                    s.sigma_vertical_accel_m_s2,
                    s.sigma_yaw_accel_rad_s2,
                ]
            )
            ** 2
        )
        self._history: list[tuple[float, Array, Array]] = []
        self._nis: dict[str, list[tuple[float, float, int]]] = {}

    def run(self, updates: list[Update], stop_s: float, progress: Progress) -> None:
        """Filter all updates and record the state at the output rate."""
        step_s = 1.0 / self.model.rate_hz
        next_record_s = self.t
        for k, update in enumerate(updates):
            while next_record_s <= update.t:
                self.predict(next_record_s)
                self._record()
                next_record_s = self.start.t + len(self._history) * step_s
            self.predict(update.t)
            self.update(update)
            if k % 2000 == 0:
                progress("dead reckoning", k / len(updates))
        while next_record_s <= stop_s:
            self.predict(next_record_s)
            self._record()
            next_record_s = self.start.t + len(self._history) * step_s
        progress("dead reckoning", 1.0)

    def predict(self, t: float) -> None:
        """Move the state on to a time; the noise is integrated white acceleration."""
        dt = t - self.t
        if dt <= 0.0:
            return
        c, s = np.cos(self.x[YAW]), np.sin(self.x[YAW])
        u, v = self.x[4], self.x[5]
        B = np.eye(4)
        B[:2, :2] = [[c, -s], [s, c]]
        F = np.eye(8)
        F[:4, 4:] = B * dt
        F[0, YAW], F[1, YAW] = (-s * u - c * v) * dt, (c * u - s * v) * dt
        self.x[:4] += B @ self.x[4:] * dt
        self.x[YAW] = wrap_angle(self.x[YAW])
        q = self._accel_variance
        Q = np.empty((8, 8))
        Q[:4, :4] = (B * q) @ B.T * dt**3 / 3
        Q[:4, 4:] = B * q * dt**2 / 2
        Q[4:, :4] = Q[:4, 4:].T
        Q[4:, 4:] = np.diag(q * dt)
        self.P = F @ self.P @ F.T + Q
        self.t = t

    def update(self, update: Update) -> None:
        """Gated Kalman update in Joseph form."""
        entries = list(update.entries)
        innovation = update.value - self.x[entries]
        if YAW in entries:
            innovation = wrap_angle(innovation)
        H = np.zeros((len(entries), 8))
        H[np.arange(len(entries)), entries] = 1.0
        PHt = self.P[:, entries]
        S = PHt[entries] + np.diag(update.variance)
        S_inverse = np.linalg.inv(S)
        nis = float(innovation @ S_inverse @ innovation)
        if nis > chi2_limit(self.settings.gate_probability, len(entries)):
            residual = float(np.sqrt(nis))
            self.rejections.append(
                Rejection(update.t, update.sensor, update.row, "innovation gate", residual)
            )
            return
        self._nis.setdefault(update.sensor, []).append((update.t, nis, len(entries)))
        K = PHt @ S_inverse
        self.x = self.x + K @ innovation
        self.x[YAW] = wrap_angle(self.x[YAW])
        left = np.eye(8) - K @ H
        self.P = left @ self.P @ left.T + (K * update.variance) @ K.T

    def _record(self) -> None:
        self._history.append((self.t, self.x.copy(), self.P.copy()))

    def trajectory(self, mission: Mission) -> Trajectory:
        """The recorded states with the tilt that the mission measured."""
        t = np.array([h[0] for h in self._history])
        x = np.array([h[1] for h in self._history])
        P = np.array([h[2] for h in self._history])
        if not np.all(np.isfinite(x)):
            raise EstimationError("dead reckoning diverged: the state is not finite")
        tilt, sigma_tilt = tilt_at(mission, t)
        cov = np.zeros((len(t), 6, 6))
        planar = np.ix_([0, 1, 2, 5], [0, 1, 2, 5])
        cov[:, *planar] = P[:, :4, :4]
        cov[:, 3, 3] = cov[:, 4, 4] = sigma_tilt**2
        c, s, o = np.cos(x[:, YAW]), np.sin(x[:, YAW]), np.zeros(len(t))
        B = np.stack(
            [np.stack([c, -s, o], -1), np.stack([s, c, o], -1), np.stack([o, o, o + 1], -1)], 1
        )
        cov_v = B @ P[:, 4:7, 4:7] @ np.swapaxes(B, 1, 2)
        return Trajectory(
            t=t,
            p_n=x[:, :3],
            q_nb_wxyz=quaternion_from_rpy(np.column_stack([tilt, x[:, YAW]])),
            v_n=np.einsum("nij,nj->ni", B, x[:, VELOCITY]),
            cov_pose_n=cov,
            sigma_v_n=np.sqrt(np.diagonal(cov_v, axis1=1, axis2=2)),
        )

    def innovations(self) -> dict[str, Innovations]:
        """Normalised innovations squared by sensor."""
        return {
            sensor: Innovations(
                np.array([r[0] for r in rows]), np.array([r[1] for r in rows]), rows[0][2]
            )
            for sensor, rows in self._nis.items()
        }
