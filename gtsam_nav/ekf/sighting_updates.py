"""The sightings of each moment: which landmarks they are of, which are used, what is new.

A landmark is tentative until a second sighting agrees with the first. With ids, a sighting that
disagrees with a tentative landmark takes its place; without, one that is not seen again soon is
forgotten. Surveyed landmarks are never tentative.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.linalg import LinAlgError

from gtsam_nav.ekf.landmark_filter import Landmark, LandmarkFilter
from gtsam_nav.frames import Array
from gtsam_nav.mission import Rejection, Sensor
from gtsam_nav.sensors.association import NONE, Comparison, joint, nearest
from gtsam_nav.sensors.landmarks import measurements, sighting, trusted_ids, variance_factors
from gtsam_nav.sensors.noise import LandmarkNoise
from gtsam_nav.sensors.prediction import chi2_limit
from gtsam_nav.sensors.settings import LandmarkSettings
from gtsam_nav.series import IntArray, LandmarkSeries

GATED = "innovation gate"
REPEATED = "second sighting of a landmark at one moment"
UNSUITED = "near a landmark, but neither of it nor of a new one"
UNCONFIRMED = "landmark not seen again"
TOO_NEAR = "too near to place a landmark by"
SINGULAR = "singular innovation covariance"

FORGET_AFTER = 50
"""Moments within which a landmark without an id must be seen again."""
LOST_AFTER = 4
"""After so many sightings in a row none of which fits, the vehicle's pose is doubted."""
LEAST_RANGE_SIGMAS = 3.0
"""A nearer landmark has no direction to be placed in."""


@dataclass
class Acquaintance:
    """How often a landmark was seen, and at which moment last."""

    sightings: int
    moment: int


@dataclass(frozen=True)
class Verdict:
    """What becomes of a sighting: it is of a landmark, or of a new one (NONE), or of no use.

    Attributes
    ----------
    landmark : int
    nis : float
        Normalised innovation squared of it and the landmark that is nearest to being its own.
    reason : str or None
        Why it is not used.
    """

    landmark: int
    nis: float
    reason: str | None = None

    @property
    def is_update(self) -> bool:
        """Whether the sighting corrects the state."""
        return self.reason is None and self.landmark != NONE

    @property
    def is_new(self) -> bool:
        """Whether the sighting adds a landmark."""
        return self.reason is None and self.landmark == NONE


class SightingUpdates:
    """Takes the sightings of a series into a filter, moment by moment.

    Parameters
    ----------
    slam : LandmarkFilter
    series : LandmarkSeries
    sensor : Sensor
        For its name and its noise.
    settings : LandmarkSettings

    Attributes
    ----------
    used : list of (float, ndarray of shape (axes,))
        Time of each sighting that corrected the state and its innovation, in standard deviations
        that are not correlated with those of others.
    rejections : list of Rejection
    """

    def __init__(
        self,
        slam: LandmarkFilter,
        series: LandmarkSeries,
        sensor: Sensor,
        settings: LandmarkSettings,
    ) -> None:
        self.slam, self.series, self.sensor, self.settings = slam, series, sensor.name, settings
        noise = LandmarkNoise.model_validate(sensor.noise)
        self.ids = trusted_ids(series, settings)
        self.measured, self.noise = measurements(series)
        self.noise = self.noise * variance_factors(series.t, noise)[:, None, None]
        self.gate = chi2_limit(settings.gate_probability, slam.axes)
        self.new_gate = chi2_limit(settings.new_probability, slam.axes)
        self.known = [Acquaintance(0, 0) for _ in slam.landmarks]
        self.moment = 0
        self.missed = 0
        self.used: list[tuple[float, Array]] = []
        self.rejections: list[Rejection] = []

    def take(self, samples: IntArray) -> None:
        """Use the samples of one moment, which is the filter's now."""
        self.moment += 1
        ids = self.ids[samples]
        landmarks = self._considered(ids)
        compared = self.slam.compare(self.measured[samples], self.noise[samples], landmarks)
        verdicts = self._verdicts(ids, landmarks, compared)
        self._update(samples, verdicts)
        for k, verdict in zip(samples, verdicts, strict=True):
            if verdict.reason is not None:
                self._reject(k, verdict.reason, verdict.nis)
        for k in [k for k, v in zip(samples, verdicts, strict=True) if v.is_new]:
            self._augment(k)
        self._doubt_the_pose(verdicts)
        self._forget()

    def finish(self) -> None:
        """Forget the landmarks that stayed tentative."""
        for landmark in reversed(range(len(self.known))):
            if self._is_tentative(landmark):
                self._remove(landmark)

    def _verdicts(self, ids: IntArray, landmarks: IntArray, compared: Comparison) -> list[Verdict]:
        """What becomes of each sighting of a moment."""
        named = np.array([self.slam.landmarks[k].id for k in landmarks], dtype=int)
        verdicts = [Verdict(NONE, np.inf)] * len(ids)
        taken: set[int] = set()
        # those that tell their landmark, the best first
        known = np.flatnonzero(ids >= 0).tolist()
        own = {s: self._column(named, compared.nis[s], int(ids[s])) for s in known}
        fit = {s: float(compared.nis[s, k]) if k != NONE else np.inf for s, k in own.items()}
        for s in sorted(own, key=lambda s: (fit[s], s)):
            landmark = int(landmarks[own[s]]) if own[s] != NONE else NONE
            if landmark != NONE and any(v.landmark == landmark for v in verdicts):
                landmark = NONE  # nameless so far, and named by another
            verdicts[s] = self._verdict_by_id(landmark, fit[s], int(ids[s]) in taken)
            taken.add(int(ids[s]))
        unnamed = np.flatnonzero(ids < 0)
        if len(unnamed):
            busy = np.isin(landmarks, [v.landmark for v in verdicts if v.is_update])
            rest = self._verdicts_by_place(compared.of(unnamed, ~busy), landmarks[~busy])
            for s, verdict in zip(unnamed.tolist(), rest, strict=True):
                verdicts[s] = verdict
        return verdicts

    def _column(self, named: IntArray, nis: Array, id_: int) -> int:
        """Place of the landmark with an id among those considered, else of one that fits and was
        only seen without; NONE where there is neither."""
        own = np.flatnonzero(named == id_)
        if len(own):
            return int(own[0])
        nameless = np.flatnonzero((named < 0) & (nis <= self.gate))
        return int(nameless[np.argmin(nis[nameless])]) if len(nameless) else NONE

    def _considered(self, ids: IntArray) -> IntArray:
        """Landmarks that a moment's sightings may be of."""
        known = np.array([landmark.id for landmark in self.slam.landmarks], dtype=int)
        if np.all(ids >= 0):
            return np.flatnonzero(np.isin(known, ids) | (known < 0))
        return np.arange(len(known))

    def _verdict_by_id(self, landmark: int, nis: float, repeated: bool) -> Verdict:
        if repeated:
            return Verdict(landmark, nis, REPEATED)
        if landmark == NONE or nis <= self.gate:
            return Verdict(landmark, nis)
        if self._is_tentative(landmark):
            return Verdict(NONE, nis)
        return Verdict(landmark, nis, GATED if np.isfinite(nis) else SINGULAR)

    def _verdicts_by_place(self, compared: Comparison, landmarks: IntArray) -> list[Verdict]:
        """Of sightings without ids: the sensors' own landmark is searched."""
        match = joint if self.settings.association == "joint" else nearest
        paired = match(compared, self.settings.gate_probability)
        verdicts = []
        for nis, pair in zip(compared.nis, paired, strict=True):
            least = float(np.min(nis, initial=np.inf))
            if pair != NONE:
                verdicts.append(Verdict(int(landmarks[pair]), float(nis[pair])))
            elif least > self.new_gate:
                verdicts.append(Verdict(NONE, least))
            else:
                verdicts.append(Verdict(NONE, least, UNSUITED))
        return verdicts

    def _update(self, samples: IntArray, verdicts: list[Verdict]) -> None:
        """Correct the state by all sightings of known landmarks at once."""
        own = [s for s, verdict in enumerate(verdicts) if verdict.is_update]
        if not own:
            return
        measured, noise = self.measured[samples[own]], self.noise[samples[own]]
        try:
            landmarks = np.array([verdicts[s].landmark for s in own])
            whitened = self.slam.update(measured, noise, landmarks)
        except LinAlgError:
            for s in own:
                self._reject(samples[s], SINGULAR, verdicts[s].nis)
            return
        for s, innovation in zip(own, whitened, strict=True):
            self.used.append((float(self.series.t[samples[s]]), innovation))
            landmark, id_ = verdicts[s].landmark, int(self.ids[samples[s]])
            known = self.known[landmark]
            known.sightings, known.moment = known.sightings + 1, self.moment
            if id_ >= 0:
                self.slam.landmarks[landmark] = replace(self.slam.landmarks[landmark], id=id_)

    def _augment(self, sample: int) -> None:
        """Add the landmark of a sighting, in place of a tentative one with its id."""
        seen, id_ = sighting(self.series, sample), int(self.ids[sample])
        if self.measured[sample, 0] < LEAST_RANGE_SIGMAS * seen.sigma_range:
            self._reject(sample, TOO_NEAR)
            return
        for landmark in reversed(range(len(self.known))):
            if id_ >= 0 and self.slam.landmarks[landmark].id == id_:
                self._remove(landmark)
        self.slam.augment(Landmark(id_, first=sample), seen)
        self.known.append(Acquaintance(1, self.moment))

    def _doubt_the_pose(self, verdicts: list[Verdict]) -> None:
        """A vehicle that slipped or was carried must find its landmarks again."""
        self.missed += sum(v.reason in (GATED, UNSUITED) for v in verdicts)
        if any(v.is_update for v in verdicts):
            self.missed = 0
        elif self.missed >= LOST_AFTER:
            self.slam.widen()

    def _forget(self) -> None:
        """Drop what has no id and was not seen again soon."""
        for landmark in reversed(range(len(self.known))):
            old = self.moment - self.known[landmark].moment > FORGET_AFTER
            if old and self._is_tentative(landmark) and self.slam.landmarks[landmark].id < 0:
                self._remove(landmark)

    def _is_tentative(self, landmark: int) -> bool:
        return not self.slam.landmarks[landmark].surveyed and self.known[landmark].sightings < 2

    def _remove(self, landmark: int) -> None:
        self._reject(self.slam.landmarks[landmark].first, UNCONFIRMED)
        self.slam.remove(landmark)
        del self.known[landmark]

    def _reject(self, sample: int, reason: str, nis: float = np.inf) -> None:
        self.rejections.append(
            Rejection(
                t=float(self.series.t[sample]),
                sensor=self.sensor,
                index=int(self.series.row[sample]),
                reason=reason,
                normalised_residual=float(np.sqrt(nis)) if np.isfinite(nis) else None,
            )
        )
