"""The motion of a mission that is a pose graph in space, by its edges alone.

Each pose follows from the first along a tree of edges between poses as near in time as there are:
where neighbours are joined, the chain of their edges. Between poses nothing is known.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, rpy_from_rotation
from gtsam_nav.mission import Mission
from gtsam_nav.preprocess.alignment import Alignment
from gtsam_nav.preprocess.motion import VehicleMotion, measures_velocity
from gtsam_nav.series import IntArray


def edges_in_space(mission: Mission) -> bool:
    """Whether there are edges that tell roll, pitch and depth too."""
    return mission.edges is not None and mission.edges.in_space


def moves_by_edges(mission: Mission) -> bool:
    """Whether edges in space are all that tells of the motion."""
    measured = mission.first("imu") is not None or measures_velocity(mission)
    return edges_in_space(mission) and not measured


def where_edges_lead(mission: Mission) -> Mission:
    """What was measured from the first to the last pose of the edges, and a warning of the rest."""
    assert mission.edges is not None
    first, last = mission.edges.span_s
    outside = [
        sensor.name
        for sensor in mission.sensors.values()
        if np.any((sensor.series.t < first) | (sensor.series.t > last))
    ]
    if not outside:
        return mission
    warning = (
        f"edges alone tell the motion, from {first:.1f} to {last:.1f} s: what {', '.join(outside)}"
        " measured before and after is left out"
    )
    cropped = mission.crop(first, float(np.nextafter(last, np.inf)))
    return replace(cropped, warnings=(*cropped.warnings, warning))


def edge_motion(mission: Mission, start: Alignment) -> VehicleMotion:
    """Motion on the times of the edges' poses, which are not uniform.

    Raises
    ------
    DataError
        Where no edges lead from the first pose to another.
    """
    edges = mission.edges
    assert edges is not None
    t, place = np.unique(edges.t, return_inverse=True)
    ends = place.reshape(-1, 2)
    R_nb, p_n = _chained(mission, ends, t, start)
    dt = np.diff(t)
    v_b = np.einsum("nji,nj->ni", R_nb[:-1], np.diff(p_n, axis=0)) / dt[:, None]
    span_s = np.maximum(np.abs(np.diff(edges.t, axis=1))[:, 0], 1e-9)
    variance = np.diagonal(np.linalg.inv(edges.information), axis1=1, axis2=2)
    moved, turned = (np.max(variance[:, own], axis=1) for own in (slice(3, 6), slice(0, 3)))
    growth = float(np.median(moved / span_s))
    rpy = rpy_from_rotation(R_nb)
    rpy[:, [0, 2]] = np.unwrap(rpy[:, [0, 2]], axis=0)
    return VehicleMotion(
        t=t,
        p_n=p_n,
        rpy=rpy,
        v_b=np.vstack([v_b, v_b[-1:]]),
        sigma_v=np.full(len(t), float(np.sqrt(np.median(moved)) / np.median(dt))),
        position_variance=growth * (t - t[0]),
        position_variance_m2_s=growth,
        yaw_variance_rad2_s=float(np.median(turned / span_s)),
        gyro_bias_b=np.zeros(3),
        rejections=(),
    )


def _chained(mission: Mission, ends: IntArray, t: Array, start: Alignment) -> tuple[Array, Array]:
    """Attitudes (n, 3, 3) and places (n, 3) of the poses, from that of the start."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

    edges, n = mission.edges, len(t)
    assert edges is not None
    low, high = np.sort(ends, axis=1).T
    pair, row = np.unique(low * n + high, return_index=True)
    # SciPy 1.14 searches graphs of 32-bit indices only
    low, high = (pair // n).astype(np.int32), (pair % n).astype(np.int32)
    nearness = csr_array((t[high] - t[low], (low, high)), shape=(n, n))
    order, before = breadth_first_order(minimum_spanning_tree(nearness), 0, directed=False)
    if len(order) < n:
        first = int(np.setdiff1d(np.arange(n), order)[0])
        raise DataError(
            f"mission '{mission.name}': no edges lead from its first pose to {n - len(order)} of"
            f" {n} others, the first at {t[first]:.1f} s"
        )
    R_nb, p_n = np.empty((n, 3, 3)), np.empty((n, 3))
    R_nb[0], p_n[0] = start.R_nb, start.p_n
    for k in order[1:].tolist():
        parent = int(before[k])
        edge = row[np.searchsorted(pair, min(k, parent) * n + max(k, parent))]
        R_ab, p_a = edges.R_ab[edge], edges.p_a[edge]
        if ends[edge, 0] == k:
            R_ab, p_a = R_ab.T, -R_ab.T @ p_a
        R_nb[k] = R_nb[parent] @ R_ab
        p_n[k] = p_n[parent] + R_nb[parent] @ p_a
    return R_nb, p_n
