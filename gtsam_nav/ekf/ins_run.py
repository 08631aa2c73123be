"""The inertial filter over a mission: each measurement at its own time, judged, then taken in."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from gtsam_nav.ekf.aid import Aid, laid_out
from gtsam_nav.ekf.clock_watch import ClockWatch
from gtsam_nav.ekf.error_state import ErrorStateFilter, Node, Update
from gtsam_nav.ekf.gate import Gate
from gtsam_nav.ekf.heading_search import FoundHeading, HeadingSearch
from gtsam_nav.ekf.inertial_start import InertialStart
from gtsam_nav.ekf.noise_watch import NoiseWatch
from gtsam_nav.ekf.strapdown import GYRO_BIAS, NU, RHO, SIZE, THETA, Strapdown
from gtsam_nav.frames import Array, rpy_from_rotation, wrap_angle
from gtsam_nav.mission import Rejection
from gtsam_nav.sensors.orientation import predict_heading
from gtsam_nav.solution import Progress

REOPENED_YAW_RAD = 0.5
"""How wrong the heading of a filter may be that has lost its position or velocity."""
REOPENED_SPEED_M_S = 1.0
PROGRESS_EVERY = 1000

logger = logging.getLogger(__name__)


@dataclass
class History:
    """What the filter went through.

    Attributes
    ----------
    nodes : list of Node
        In the order of time: all where the run is to be smoothed, else the recorded ones.
    recorded : list of int
        Those at the times asked for.
    used : list of list of (float, float)
        Time and normalised innovation squared of what each aid had accepted.
    rejections : list of Rejection
    yaw_left : bool
        Whether a measurement left the yaw as it was, since it was unknown.
    """

    nodes: list[Node] = field(default_factory=list)
    recorded: list[int] = field(default_factory=list)
    used: list[list[tuple[float, Array]]] = field(default_factory=list)
    rejections: list[Rejection] = field(default_factory=list)
    yaw_left: bool = False


class InsRun:
    """One pass of the filter.

    Parameters
    ----------
    strapdown : Strapdown
    start : InertialStart
    aids : list of Aid
    keep_all : bool
        Keep every node, for a smoother.
    """

    def __init__(
        self, strapdown: Strapdown, start: InertialStart, aids: list[Aid], keep_all: bool
    ) -> None:
        shared, self._places = laid_out(aids)
        self.filter = ErrorStateFilter(strapdown, start.state, start.P, shared)
        self.aids, self.keep_all = aids, keep_all
        self.history = History(used=[[] for _ in aids])
        self._gates = [Gate(aid.gate_probability) for aid in aids]
        self._watches = [None if aid.shows_yaw else NoiseWatch() for aid in aids]
        self._search = HeadingSearch()
        self._gained_n = np.zeros(3)
        self._lost: list[str] = []
        receivers = dict.fromkeys(aid.receiver for aid in aids if aid.receiver)
        self._clocks = ClockWatch(list(receivers), self.filter.size)
        self._gained_before: list[tuple[float, Array]] = [(start.state.t, np.zeros(3))] * len(aids)

    def run(self, t_record: Array, progress: Progress) -> History:
        """Go through all measurements, and record the state at given times, after those of then."""
        events = list(self._events(t_record))
        for n, (t, which, k) in enumerate(events):
            if t > self.filter.state.t:
                self._advance(t)
            if which < len(self.aids):
                self._take(which, k)
            else:
                self.history.recorded.append(len(self.history.nodes))
                if not self.keep_all:
                    self.history.nodes.append(self.filter.node)
            if n % PROGRESS_EVERY == 0:
                progress("inertial filter", n / len(events))
        if self.keep_all:
            self.history.nodes.append(self.filter.node)
        return self.history

    def _events(self, t_record: Array) -> Iterator[tuple[float, int, int]]:
        """Time, aid (or their number, for a record) and sample of each event in order."""
        streams = [*(aid.t for aid in self.aids), t_record]
        t = np.concatenate(streams)
        which = np.repeat(np.arange(len(streams)), [len(stream) for stream in streams])
        sample = np.concatenate([np.arange(len(stream)) for stream in streams])
        order = np.argsort(t, kind="stable")
        order = order[t[order] >= self.filter.state.t]
        return zip(t[order].tolist(), which[order].tolist(), sample[order].tolist(), strict=True)

    def _advance(self, to_s: float) -> None:
        self._close_node()
        before_n = self.filter.state.v_n
        self.filter.predict(to_s)
        self._clocks.predicted(self.filter.node.Phi)
        self._gained_n = self._gained_n + self.filter.state.v_n - before_n

    def _close_node(self) -> None:
        if self.keep_all:
            self.history.nodes.append(self.filter.node)

    def _take(self, which: int, k: int) -> None:
        """Judge measurement k of an aid and let it correct the filter."""
        aid, unknown = self.aids[which], self.filter.yaw_unknown
        update = self._compare(which, k)
        if update.S_inverse is None:
            self._reject(aid, k, "singular innovation covariance", None)
            return
        update = self._with_noise_as_seen(which, update)
        verdict = self._gates[which].judge(self.filter.state.t, update)
        if verdict == "reject":
            self._reject(aid, k, "innovation gate", float(np.sqrt(update.nis)))
            return
        if verdict == "reopen":
            self._reopen(which)
            update = self._with_noise_as_seen(which, self._compare(which, k))
        rate = self._rate(which, len(update.R))
        leave_yaw = unknown and aid.observes not in ("heading", "gyro bias")
        self.history.yaw_left |= leave_yaw
        gain = self.filter.correct(update, shows_yaw=aid.shows_yaw, leave_yaw=leave_yaw)
        self._clocks.corrected(update, gain, aid.receiver, rate)
        self.history.used[which].append((self.filter.state.t, update.whitened))
        if not unknown:
            self._search.forget()
        elif aid.v_n is not None:
            self._search_heading(aid.v_n[k], aid.sigma_v)
        elif aid.observes == "position":
            self._search_heading(None, 0.0)

    def _rate(self, which: int, size: int) -> Array:
        """How fast what a receiver measures changes: its velocity, or acceleration, along n."""
        aid, state = self.aids[which], self.filter.state
        if not aid.receiver or aid.observes == "position":
            return state.v_n[:size]
        t, gained_n = self._gained_before[which]
        self._gained_before[which] = (state.t, self._gained_n)
        return np.asarray((self._gained_n - gained_n)[:size] / max(state.t - t, 1e-9))

    def _with_noise_as_seen(self, which: int, update: Update) -> Update:
        """The measurement with the noise that the sensor's innovations show, where that is more."""
        watch = self._watches[which]
        if watch is None:
            return update
        factor = watch.variance_factor(self.filter.state.t, update.nis, len(update.R))
        if factor == 1.0:
            return update
        return self.filter.compare(update.residual, update.H, factor * update.R)

    def doubts(self) -> Iterator[str]:
        """What is said of sensors that are worse than they state, whose clock seems off, or that
        found the filter lost."""
        for aid, watch in zip(self.aids, self._watches, strict=True):
            said = watch and watch.warning(aid.name)
            if said:
                yield said
        yield from self._clocks.doubts()
        yield from self._lost

    def _compare(self, which: int, k: int) -> Update:
        aid, place = self.aids[which], self._places[which]
        shared = self.filter.shared[place]
        prediction = aid.predict(k, self.filter.state, shared)
        H = prediction.jacobian
        if len(shared):
            H = np.zeros((len(H), SIZE + place.max() + 1))
            H[:, : prediction.jacobian.shape[1]] = prediction.jacobian
            H[:, SIZE + place] = aid.by_shared(k, self.filter.state, shared)
        return self.filter.compare(prediction.residual, H, prediction.cov)

    def _reject(self, aid: Aid, k: int, reason: str, normalised: float | None) -> None:
        self.history.rejections.append(
            Rejection(self.filter.state.t, aid.name, int(aid.row[k]), reason, normalised)
        )

    def _reopen(self, which: int) -> None:
        """Doubt what a run of rejections proves wrong."""
        aid, t = self.aids[which], self.filter.state.t
        logger.warning(
            "at %.1f s the filter had lost %s: it follows %s again", t, aid.observes, aid.name
        )
        offset, rate = (float(np.linalg.norm(part)) for part in self._gates[which].offset())
        if aid.observes == "position":
            self._lost.append(
                f"at {t:.1f} s all positions by '{aid.name}' lay {offset:.0f} m or so off the"
                " filter's for a while: it follows them since; what is false may be those before,"
                " or they"
            )
        variance = np.zeros(self.filter.size)
        down_b = self.filter.state.body.R_nb[2]
        if aid.observes in ("position", "depth"):
            variance[RHO] = offset**2
            variance[NU] = rate**2 + REOPENED_SPEED_M_S**2
        elif aid.observes in ("velocity", "body velocity"):
            variance[NU] = offset**2
        elif aid.observes == "heading":
            variance[THETA] = offset**2 * down_b**2
        elif aid.observes == "tilt":
            variance[THETA] = offset**2
        else:
            variance[GYRO_BIAS] = offset**2
        if aid.shows_yaw:
            variance[THETA] = REOPENED_YAW_RAD**2 * down_b**2
        self._close_node()
        self.filter.widen(variance)

    def _search_heading(self, v_measured_n: Array | None, sigma: float) -> None:
        """Look for the heading of a vehicle without a compass."""
        state, found = self.filter.state, None
        if v_measured_n is not None:
            found = self._search.by_acceleration(state.t, v_measured_n, self._gained_n, sigma)
        if found is None:
            sigma_v = float(np.sqrt(np.trace(self.filter.P[NU, NU]) / 3))
            yaw = float(rpy_from_rotation(state.body.R_nb)[2])
            found = self._search.by_course(state.t, state.v_n, sigma_v, yaw)
        if found is not None:
            self._set_heading(found)

    def _set_heading(self, found: FoundHeading) -> None:
        body = self.filter.state.body
        yaw = float(rpy_from_rotation(body.R_nb)[2])
        heading = float(wrap_angle(yaw + found.correction))
        prediction = predict_heading(body, heading, 0.0, found.sigma)
        update = self.filter.compare(prediction.residual, prediction.jacobian, prediction.cov)
        gain = self.filter.correct(update, shows_yaw=True)
        self._clocks.corrected(update, gain, "", np.zeros(1))
        self._search.forget()
        logger.info(
            "at %.1f s the heading is found: %.0f deg", self.filter.state.t, np.degrees(heading)
        )
