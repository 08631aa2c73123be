"""The estimate at the reference's times and antenna: what every score starts from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from gtsam_nav.frames import Array
from gtsam_nav.series import ReferenceSeries
from gtsam_nav.trajectory import MAX_GAP_S, Trajectory

SAMPLES_AT_ONCE = 20_000
"""Of the reference, each with a whole covariance: of a long one all of them take gigabytes."""


@dataclass(frozen=True)
class Matched:
    """Estimate and reference at the same m times, both of the reference's antenna.

    Attributes
    ----------
    estimate : Trajectory
        Interpolated at the reference's times, without covariance.
    cov_ne : ndarray, shape (m, 2, 2), or None
        Covariance of the estimate's north and east, where it has one.
    reference : ReferenceSeries
        The samples that the estimate covers. Where the vertical is not usable the estimate's own
        stands in for it, so that nothing is learnt from it.
    coverage : float
        Time between scored neighbours of the reference over time between neighbours, 0 to 1.
    """

    estimate: Trajectory
    cov_ne: Array | None
    reference: ReferenceSeries
    coverage: float

    @property
    def t(self) -> Array:
        """Mission time of the samples, shape (m,), s."""
        return self.reference.t

    @cached_property
    def estimate_yaw(self) -> Array:
        """Shape (m,), rad."""
        return self.estimate.yaw

    @cached_property
    def travelled_m(self) -> Array:
        """Horizontal distance along the reference; see `distance_m`."""
        return distance_m(self.reference)


def match(
    trajectory: Trajectory,
    reference: ReferenceSeries,
    lever_b: ArrayLike = (0.0, 0.0, 0.0),
    window_s: tuple[float, float] | None = None,
) -> Matched | None:
    """Interpolate an estimate at the times of a reference, never over a gap of more than 5 s.

    Parameters
    ----------
    trajectory : Trajectory
        Of the body's origin.
    reference : ReferenceSeries
        Of an antenna.
    lever_b : array_like, shape (3,)
        The antenna in body coordinates, m.
    window_s : (float, float), optional
        Half-open span of mission time; None takes the whole reference.

    Returns
    -------
    Matched or None
        None where the reference has no sample in the window.
    """
    if window_s is not None:
        reference = reference.crop(*window_s)
    if not len(reference):
        return None
    covered = trajectory.covers(reference.t, MAX_GAP_S)
    steps = np.diff(reference.t)
    whole = float(np.sum(steps))
    held = float(np.sum(steps[covered[1:] & covered[:-1]]))
    coverage = held / whole if whole else float(covered[0])
    scored = reference.select(covered)
    estimate, cov_ne = _antenna_at(trajectory, scored.t, lever_b)
    if not scored.vertical_usable:
        p_n = np.column_stack([scored.p_n[:, :2], estimate.p_n[:, 2]])
        scored = replace(scored, p_n=p_n)
    return Matched(estimate, cov_ne, scored, coverage)


def _antenna_at(
    trajectory: Trajectory, t: Array, lever_b: ArrayLike
) -> tuple[Trajectory, Array | None]:
    """Poses of an antenna at given times, and the covariance of their north and east."""
    p_n, q_nb_wxyz, cov_ne = [], [], []
    for first in range(0, max(len(t), 1), SAMPLES_AT_ONCE):
        some = trajectory.interpolate(t[first : first + SAMPLES_AT_ONCE], MAX_GAP_S)
        antenna = some.at_lever_arm(lever_b)
        p_n.append(antenna.p_n)
        q_nb_wxyz.append(antenna.q_nb_wxyz)
        if antenna.cov_pose_n is not None:
            cov_ne.append(antenna.cov_pose_n[:, :2, :2].copy())
    whole = Trajectory(t=t, p_n=np.concatenate(p_n), q_nb_wxyz=np.concatenate(q_nb_wxyz))
    return whole, np.concatenate(cov_ne) if cov_ne else None


def distance_m(reference: ReferenceSeries) -> Array:
    """Horizontal distance travelled since the first sample, shape (m,), m.

    The path is walked in steps of at least five sigma of the reference: white noise on shorter
    steps would add up to distance. Between the steps' ends distance grows linearly in time.
    """
    p_ne = reference.p_n[:, :2]
    least = 0.0 if reference.sigma is None else 5.0 * float(np.median(reference.sigma))
    nodes = _steps_of_at_least(p_ne, least)
    travelled = np.cumsum(np.linalg.norm(np.diff(p_ne[nodes], axis=0), axis=1))
    at_nodes = np.concatenate([[0.0], travelled])
    return np.asarray(np.interp(reference.t, reference.t[nodes], at_nodes))


def _steps_of_at_least(p_ne: Array, least_m: float) -> list[int]:
    """Indices of the first sample and of each next one that lies at least so far away."""
    if least_m == 0.0:
        return list(range(len(p_ne)))
    nodes = [0]
    n0, e0 = p_ne[0]
    for k, (n, e) in enumerate(p_ne.tolist()):
        if (n - n0) ** 2 + (e - e0) ** 2 >= least_m**2:
            nodes.append(k)
            n0, e0 = n, e
    return nodes
