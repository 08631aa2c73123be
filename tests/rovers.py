"""A small rover among landmarks: simulated here, so that tests can spoil what they like."""

from __future__ import annotations

import numpy as np

from gtsam_nav.frames import Array, wrap_angle
from gtsam_nav.mission import LandmarkMap, Mission, Sensor
from gtsam_nav.series import LandmarkSeries, OdometrySeries, ReferenceSeries

LANDMARKS_N = np.array(
    [
        [0.0, 4.0],
        [4.0, 5.5],
        [7.0, 2.0],
        [6.5, -3.0],
        [2.0, -5.0],
        [-3.0, -3.5],
        [-4.5, 1.5],
        [1.0, 1.0],
    ]
)
SIGMA_RANGE_M, SIGMA_BEARING_RAD = 0.05, 0.02
SIGMA_V_M_S, SIGMA_YAW_RATE_RAD_S = 0.05, 0.05
STEP_S, EVERY = 0.05, 5


def truth(duration_s: float) -> tuple[Array, Array, Array, Array]:
    """Times, positions (n, 2), courses and yaw rates of an eight at 0.5 m/s from (2, -1), north."""
    t = np.arange(0.0, duration_s, STEP_S)
    yaw_rate = np.where((t // 25.0) % 2 == 0, 0.25, -0.25)
    course = np.concatenate([[0.0], np.cumsum(yaw_rate[:-1] * STEP_S)])
    mean = course + 0.5 * yaw_rate * STEP_S
    steps = 0.5 * STEP_S * np.column_stack([np.cos(mean), np.sin(mean)])
    p = np.array([2.0, -1.0]) + np.concatenate([np.zeros((1, 2)), np.cumsum(steps[:-1], axis=0)])
    return t, p, course, yaw_rate


def sightings(
    t: Array, p: Array, course: Array, rng: np.random.Generator, noise: float = 1.0
) -> LandmarkSeries:
    """Landmarks within 6 m and 70 degrees of the bow, every quarter of a second."""
    rows = []
    for k in range(0, len(t), EVERY):
        offset = LANDMARKS_N - p[k]
        range_m = np.hypot(*offset.T)
        bearing = wrap_angle(np.arctan2(offset[:, 1], offset[:, 0]) - course[k])
        for id_ in np.flatnonzero((range_m < 6.0) & (np.abs(bearing) < np.radians(70))):
            seen_m = range_m[id_] + noise * SIGMA_RANGE_M * rng.normal()
            seen_rad = bearing[id_] + noise * SIGMA_BEARING_RAD * rng.normal()
            rows.append((t[k], id_, seen_m, seen_rad))
    return series(np.array(rows))


def series(rows: Array) -> LandmarkSeries:
    """Sightings from rows of time, id, range and bearing."""
    return LandmarkSeries(
        t=rows[:, 0],
        id=rows[:, 1].astype(int),
        range_m=rows[:, 2],
        bearing=wrap_angle(rows[:, 3]),
        sigma_range=np.full(len(rows), SIGMA_RANGE_M),
        sigma_bearing=np.full(len(rows), SIGMA_BEARING_RAD),
    )


def rows_of(seen: LandmarkSeries) -> Array:
    """The inverse of `series`."""
    assert seen.range_m is not None
    assert seen.bearing is not None
    return np.column_stack([seen.t, seen.id, seen.range_m, seen.bearing])


def rover(seed: int = 0, duration_s: float = 60.0, noise: float = 1.0) -> Mission:
    """The mission, with a surveyed map and its true path."""
    rng = np.random.default_rng(seed)
    t, p, course, yaw_rate = truth(duration_s)
    n = len(t)
    v_b = np.column_stack([np.full(n, 0.5), np.zeros(n)])
    v_b += noise * SIGMA_V_M_S * rng.normal(size=(n, 2))
    odometry = OdometrySeries(
        t=t,
        v_b=v_b,
        yaw_rate=yaw_rate + noise * SIGMA_YAW_RATE_RAD_S * rng.normal(size=n),
        sigma_v=np.full(n, SIGMA_V_M_S),
        sigma_yaw_rate=np.full(n, SIGMA_YAW_RATE_RAD_S),
    )
    zero = np.zeros(n)
    reference = ReferenceSeries(
        t=t,
        p_n=np.column_stack([p, zero]),
        rpy=np.column_stack([zero, zero, wrap_angle(course)]),
        vertical_usable=False,
    )
    exact = {"scale_sigma": 0.0, "curvature_sigma_deg_m": 0.0}
    sensors = [
        Sensor("odometry", "odometry", odometry, noise=exact),
        Sensor("landmarks", "landmarks", sightings(t, p, course, rng, noise)),
        Sensor("reference", "reference", reference),
    ]
    surveyed = np.column_stack([LANDMARKS_N, np.zeros(len(LANDMARKS_N))])
    ids = np.arange(len(LANDMARKS_N))
    return Mission(
        "rover",
        {sensor.name: sensor for sensor in sensors},
        landmark_map=LandmarkMap(ids, surveyed, np.full(len(ids), 1e-3)),
    )
