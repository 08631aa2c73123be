"""A small invented mission with two solutions, for tests of scores, files and plots."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from gtsam_nav.frames import (
    Array,
    Origin,
    quaternion_from_rpy,
    rotation_from_quaternion,
    rotation_from_rpy,
)
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.series import (
    AttitudeSeries,
    BeamSeries,
    DepthSeries,
    DvlSeries,
    GnssSeries,
    HeadingSeries,
    ReferenceSeries,
)
from gtsam_nav.solution import (
    Innovations,
    LandmarkEstimates,
    LoopClosure,
    PoseGraph,
    PoseGraphEdge,
    SlowStates,
    Solution,
    SonarMap,
    SonarScans,
)
from gtsam_nav.trajectory import Trajectory

DURATION_S = 600.0
ORIGIN = Origin(42.16, 3.11)
ANTENNA_B = np.array([0.3, 0.1, -0.8])


def true_pose(t: Array) -> tuple[Array, Array]:
    """Positions (n, 3) and roll, pitch, yaw (n, 3): two laps along a basin."""
    phase = 2 * np.pi * 2 * t / DURATION_S
    p_n = np.column_stack(
        [60 * np.sin(phase), 25 * np.sin(phase) * np.cos(phase) + t / 60, 1 + 0.1 * np.sin(phase)]
    )
    velocity = np.gradient(p_n, t, axis=0)
    yaw = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    return p_n, np.column_stack([0.02 * np.sin(9 * phase), 0.01 * np.cos(7 * phase), yaw])


def true_trajectory(t: Array) -> Trajectory:
    p_n, rpy = true_pose(t)
    return Trajectory(t=t, p_n=p_n, q_nb_wxyz=quaternion_from_rpy(rpy))


def walk(t: Array, rate: float, seed: int) -> Array:
    """A random walk of shape (n,) that spreads by ``rate`` in a square root of a second."""
    steps = np.random.default_rng(seed).normal(size=len(t)) * np.sqrt(np.gradient(t)) * rate
    return np.cumsum(steps)


def wandering(t: Array, rate: float, seed: int) -> Trajectory:
    """The truth plus random walks in position and heading, with the matching covariance."""
    p_n, rpy = true_pose(t)
    p_n[:, 0] += walk(t, rate, seed)
    p_n[:, 1] += walk(t, rate, seed + 1)
    rpy[:, 2] += walk(t, 0.002, seed + 2)
    cov = np.zeros((len(t), 6, 6))
    cov[:, :3, :3] = np.eye(3) * (rate**2 * (t + 1.0))[:, None, None]
    cov[:, 2, 2] = 0.05**2
    cov[:, 3:, 3:] = np.eye(3) * 0.01**2
    return Trajectory(
        t=t,
        p_n=p_n,
        q_nb_wxyz=quaternion_from_rpy(rpy),
        v_n=np.gradient(p_n, t, axis=0),
        cov_pose_n=cov,
        sigma_v_n=np.full((len(t), 3), 0.05),
        keyframe=np.arange(len(t)) % 50 == 0,
    )


def reference(rate_hz: float = 2.0, sigma_m: float = 0.05, attitude: bool = True) -> Sensor:
    t = np.arange(0.0, DURATION_S, 1 / rate_hz)
    p_n, rpy = true_pose(t)
    p_n = p_n + rotation_from_rpy(rpy) @ ANTENNA_B
    p_n += np.random.default_rng(3).normal(size=p_n.shape) * sigma_m
    series = ReferenceSeries(
        t=t, p_n=p_n, rpy=rpy if attitude else None, sigma=np.full(len(t), sigma_m)
    )
    return Sensor("reference", "reference", series, xyz_b=ANTENNA_B)


def mission(sources: tuple[Path, ...] = ()) -> Mission:
    """DVL with an outage, compass, attitude, depth, GNSS for a minute, simulated sonar."""
    rng = np.random.default_rng(8)
    t = np.arange(0.0, DURATION_S, 0.1)
    _, rpy = true_pose(t)
    slow = t[::7][(t[::7] < 200) | (t[::7] > 260)]
    beams = np.arange(0.0, DURATION_S, 0.5)
    fixes = np.arange(0.0, 60.0)
    disturbed = rpy[:, 2] + np.radians(heading_bias_deg(t)) + rng.normal(size=len(t)) * 0.01
    series = {
        "dvl": DvlSeries(
            t=slow,
            v_d=rng.normal(size=(len(slow), 3)),
            sigma=np.full(len(slow), 0.05),
            valid=rng.random(len(slow)) > 0.05,
            bottom_lock=np.ones(len(slow), dtype=bool),
        ),
        "heading": HeadingSeries(t=t, heading=disturbed, sigma=np.full(len(t), 0.01)),
        "attitude": AttitudeSeries(
            t=t, roll=rpy[:, 0], pitch=rpy[:, 1], sigma=np.full(len(t), 0.01)
        ),
        "depth": DepthSeries(t=t[::5], depth_m=np.ones(len(t[::5])), sigma=np.ones(len(t[::5]))),
        "beams": BeamSeries(
            t=beams,
            angle=np.linspace(0, 60, len(beams)) % (2 * np.pi),
            intensity=np.tile(np.array([0, 40, 240, 9], dtype=np.uint8), (len(beams), 1)),
            resolution_m=5.0,
        ),
        "gnss": GnssSeries(t=fixes, p_n=true_pose(fixes)[0], sigma=np.ones((60, 3))),
    }
    sensors = {
        name: Sensor(name, name, values, simulated=name == "beams")
        for name, values in series.items()
    }
    return Mission("basin <laps>", sensors, origin=ORIGIN, start_utc=1.1e9, sources=sources)


def heading_bias_deg(t: Array) -> Array:
    return 4.0 * np.sin(t / 70.0) + 2.0


def graph_solution(sources: tuple[Path, ...] = ()) -> Solution:
    t = np.arange(0.0, DURATION_S, 0.1)
    trajectory = wandering(t, 0.02, seed=20)
    keyframes = trajectory.select(slice(None, None, 50))
    return Solution(
        method="graph",
        trajectory=trajectory,
        mission=mission(sources),
        online=wandering(keyframes.t, 0.06, seed=30),
        reference=reference(),
        loops=_loops(),
        rejections=_rejections(),
        warnings=("the sonar's echoes are simulated",),
        slow_states=SlowStates(
            keyframes.t,
            {
                "heading_bias_rad": (
                    np.radians(heading_bias_deg(keyframes.t) + walk(keyframes.t, 0.03, 5)),
                    np.full(len(keyframes), np.radians(0.6)),
                ),
                "gyro_z_rad_s": (
                    0.011 + walk(keyframes.t, 1e-5, 6),
                    np.full(len(keyframes), 3e-4),
                ),
            },
        ),
        innovations={
            "dvl": Innovations(t[::7], np.random.default_rng(1).chisquare(3, len(t[::7])), 3),
            "depth": Innovations(t[::5], np.random.default_rng(2).chisquare(1, len(t[::5])), 1),
        },
        pose_graph=pose_graph(keyframes),
        sonar_map=_walls(),
        scans=registered_scans(),
        landmarks=landmark_estimates(),
        gnss_used=60,
        gnss_withheld=540,
        n_keyframes=len(keyframes),
        stage_s={"reading": 0.8, "scans": 1.2, "graph": 6.5, "refinement": 4.1},
    )


def dr_solution() -> Solution:
    full = graph_solution()
    return Solution(
        method="dr",
        trajectory=wandering(full.trajectory.t, 0.25, seed=40),
        mission=full.mission,
        reference=full.reference,
        rejections=full.rejections[:4],
        gnss_used=60,
        gnss_withheld=540,
        stage_s={"reading": 0.8, "filter": 0.9},
    )


def pose_graph(keyframes: Trajectory) -> PoseGraph:
    R = rotation_from_quaternion(keyframes.q_nb_wxyz)
    n = len(keyframes)
    pairs = [(k, k + 1) for k in range(n - 1)] + [(k, k + n // 2) for k in range(0, n // 2, 9)]
    factor = np.random.default_rng(4).normal(size=(6, 6)) + 5 * np.eye(6)
    edges = tuple(
        PoseGraphEdge(
            a=a,
            b=b,
            R_ab=R[a].T @ R[b],
            p_a=R[a].T @ (keyframes.p_n[b] - keyframes.p_n[a]),
            information=factor @ factor.T,
        )
        for a, b in pairs
    )
    return PoseGraph(keyframes.t, keyframes.p_n, keyframes.q_nb_wxyz, edges)


def landmark_estimates() -> LandmarkEstimates:
    """Three landmarks; the second is known ten times better northwards than eastwards."""
    cov_n = np.stack([np.diag([0.04, 0.04, 0.0]), np.diag([0.01, 1.0, 0.0]), 0.25 * np.eye(3)])
    cov_n[2, 0, 1] = cov_n[2, 1, 0] = 0.2
    p_n = np.array([[10.0, 20.0, 1.0], [-30.0, 5.0, 1.0], [0.0, -12.5, 2.0]])
    return LandmarkEstimates(np.array([7, 3, 12]), p_n, cov_n)


def registered_scans() -> SonarScans:
    """The scans of the loops: seven seconds of beams each, forty points about the vehicle."""
    t = np.unique([time for loop in _loops() for time in (loop.t_a, loop.t_b)])
    middle = np.round(2 * t).astype(np.int64)
    bearing = np.tile(np.linspace(0.0, 2 * np.pi, 40, endpoint=False), len(t))
    range_m = 12.0 + 6.0 * np.cos(3.0 * bearing)
    return SonarScans(
        sensor="beams",
        t=t,
        first_beam=middle - 7,
        last_beam=middle + 7,
        first=40 * np.arange(len(t) + 1),
        xy=np.column_stack([range_m * np.cos(bearing), range_m * np.sin(bearing)]),
    )


def without_origin(solution: Solution) -> Solution:
    return replace(solution, mission=replace(solution.mission, origin=None))


def _loops() -> tuple[LoopClosure, ...]:
    rng = np.random.default_rng(12)
    loops = []
    for t_b in np.arange(310.0, 590.0, 14.0):
        for t_a in t_b - 300.0 + np.array([-14.0, 0.0, 14.0]):
            accepted = rng.random() < 0.7
            sigma = rng.uniform(0.1, 0.4)
            loops.append(
                LoopClosure(
                    t_a=max(float(t_a), 7.0),
                    t_b=float(t_b),
                    dx_m=float(rng.normal() * 5) if accepted else float("nan"),
                    dy_m=float(rng.normal() * 3) if accepted else float("nan"),
                    dyaw=float(rng.normal() * 0.2) if accepted else float("nan"),
                    sigma_x_m=sigma,
                    sigma_y_m=sigma,
                    sigma_yaw=0.01,
                    score=float(rng.uniform(0.5, 0.95) if accepted else rng.uniform(0.1, 0.6)),
                    verdict="accepted" if accepted else "rejected",
                    reason="" if accepted else str(rng.choice(["overlap", "gate", "diverged"])),
                    weight=float(rng.uniform(0.2, 1.0)) if accepted else None,
                )
            )
    return tuple(loops)


def _rejections() -> tuple[Rejection, ...]:
    dropped = [Rejection(12.0 + k, "dvl", 17 + k, "no bottom lock") for k in range(9)]
    gated = [Rejection(40.0 + 9 * k, "gnss", 40 + k, "gate, nis > 15", 19.5 + k) for k in range(2)]
    return (*dropped, *gated, Rejection(float("nan"), "imu", 3, 'not finite: "nan"'))


def _walls() -> SonarMap:
    rng = np.random.default_rng(9)
    corners = np.array([[-75, -30], [75, -30], [75, 45], [20, 45], [20, 60], [-75, 60], [-75, -30]])
    points = [
        a + rng.random((1500, 1)) * (b - a) + rng.normal(size=(1500, 2)) * 0.25
        for a, b in pairwise(corners)
    ]
    ne = np.concatenate([*points, rng.uniform(-70, 60, size=(400, 2))])
    return SonarMap(
        points_n=np.column_stack([ne, np.ones(len(ne))]),
        t=np.sort(rng.uniform(0, DURATION_S, len(ne))),
        strength=np.round(rng.uniform(60, 255, len(ne))),
    )
