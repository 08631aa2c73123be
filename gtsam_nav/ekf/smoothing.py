"""The smoother over a run of the inertial filter, and what it finds of a yaw that was unknown.

While nothing tells the yaw the filter considers it and does not estimate it: its gains are not the
ones that its covariance asks for, and going back through them multiplies what later fixes tell of a
place by a yaw that may be any. There only the attitude and the gyro's biases, which the gyro alone
relates over time, are carried back; the rest stays as filtered. The filter then runs once more from
the yaw and the biases that were found, which places ask for: where motion hardly shows the yaw,
these may lead it away from what the first pass found, and its sigma then says so; of a vehicle that
lay still it is as good as any other, since no place depends on a yaw that no fix shows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from gtsam_nav.ekf.aid import Aid
from gtsam_nav.ekf.error_state import Node, compose, yaw_variance
from gtsam_nav.ekf.inertial_start import FOUND_YAW_SIGMA_RAD, FoundYaw, InertialStart
from gtsam_nav.ekf.ins_run import History, InsRun
from gtsam_nav.ekf.rts import smooth
from gtsam_nav.ekf.strapdown import GYRO_BIAS, SIZE, THETA, InertialState, Strapdown
from gtsam_nav.frames import Array, rpy_from_rotation, wrap_angle
from gtsam_nav.series import IntArray
from gtsam_nav.solution import Progress

GYRO_ALONE = np.r_[THETA, GYRO_BIAS]
"""Errors that the gyro relates over time."""
MOST_PASSES = 3
"""From a yaw that was found: each finds a better one."""


@dataclass(frozen=True)
class Smoothed:
    """Smoothed states and covariances at the recorded times.

    Attributes
    ----------
    at_start : FoundYaw
    began_without_yaw : bool
        Whether the filter went without a yaw at first.
    """

    states: list[InertialState]
    P: list[Array]
    at_start: FoundYaw
    began_without_yaw: bool

    def no_surer_of_yaw_than(self, other: Smoothed) -> Smoothed:
        """A run that was given the yaw another had found: as sure of the yaw as that one, less
        what it has moved it since."""
        P = []
        for own, told in zip(_nodes(self), _nodes(other), strict=True):
            moved = float(wrap_angle(_yaw(own[0]) - _yaw(told[0])))
            lacking = max(yaw_variance(*told) + moved**2 - yaw_variance(*own), 0.0)
            down_b = own[0].body.R_nb[2]
            P.append(own[1].copy())
            P[-1][THETA, THETA] += lacking * np.outer(down_b, down_b)
        return replace(self, P=P)


def _yaw(state: InertialState) -> float:
    return float(rpy_from_rotation(state.body.R_nb)[2])


def _nodes(smoothed: Smoothed) -> Iterator[tuple[InertialState, Array]]:
    return zip(smoothed.states, smoothed.P, strict=True)


def smoothed_history(history: History) -> Smoothed:
    """Smooth a run that kept all nodes."""
    nodes = history.nodes
    error, P = smooth(nodes, compose, _carried(nodes) if history.yaw_left else None)
    states = [nodes[k].state.corrected(error[k, :SIZE]) for k in (0, *history.recorded)]
    known = next((node for node in nodes if not node.yaw_unknown), nodes[-1])
    at_start = FoundYaw(
        _yaw(states[0]),
        states[0].gyro_bias_b,
        known.state.t - states[0].t,
    )
    without_yaw = history.yaw_left and nodes[0].yaw_unknown
    return Smoothed(states[1:], [P[k] for k in history.recorded], at_start, without_yaw)


def from_found_yaw(
    strapdown: Strapdown,
    start: InertialStart,
    aids: list[Aid],
    first: Smoothed,
    t_record: Array,
    progress: Progress,
) -> tuple[InsRun, Smoothed]:
    """Filter and smooth again from the yaw that a first pass found, until it stays.

    What these passes claim to know of the yaw is what they were given: they state it no surer than
    the first did, and count as doubt by how much they left that.
    """
    found, passes = first.at_start, 0
    while True:
        run = InsRun(strapdown, start.with_yaw(found), aids, keep_all=True)
        smoothed = smoothed_history(run.run(t_record, progress))
        passes += 1
        moved = abs(float(wrap_angle(smoothed.at_start.yaw - found.yaw)))
        if moved < FOUND_YAW_SIGMA_RAD or passes == MOST_PASSES:
            return run, smoothed.no_surer_of_yaw_than(first)
        found = replace(smoothed.at_start, unknown_s=found.unknown_s)
        del run


def _carried(nodes: list[Node]) -> list[IntArray]:
    everything = np.arange(len(nodes[0].correction))
    return [GYRO_ALONE if node.yaw_unknown else everything for node in nodes]
