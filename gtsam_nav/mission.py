"""What was measured: the sensors of a mission, and what it states beside their samples."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gtsam_nav.frames import Array, Origin
from gtsam_nav.pose_edges import PoseEdges
from gtsam_nav.series import SERIES_TYPES, IntArray, Series

SonarKind = Literal["recorded", "simulated"]


@dataclass(frozen=True)
class LandmarkMap:
    """Surveyed landmarks in local NED, m."""

    id: IntArray
    p_n: Array
    sigma: Array


@dataclass(frozen=True, slots=True)
class Rejection:
    """One measurement that was not used.

    ``index`` is its zero-based sample number in the source; ``normalised_residual`` is None where
    it was dropped before any prediction.
    """

    t: float
    sensor: str
    index: int
    reason: str
    normalised_residual: float | None = None


@dataclass(frozen=True)
class Sensor:
    """One instrument as mounted, with what it measured.

    Attributes
    ----------
    name, type : str
        Name in the mission and key of `SERIES_TYPES`.
    xyz_b : ndarray, shape (3,)
        Position in the body frame, m.
    R_bs : ndarray, shape (3, 3)
        Rotation from sensor to body axes.
    noise : mapping
        Figures of the card, read by ``sensors``' noise models.
    time_offset_sigma_s : float
        Spread of the constant that its stamps may be off by; zero where its clock is trusted.
    simulated : bool
        Whether the samples were synthesised inside an otherwise recorded mission.
    """

    name: str
    type: str
    series: Series
    xyz_b: Array = field(default_factory=lambda: np.zeros(3))
    R_bs: Array = field(default_factory=lambda: np.eye(3))
    noise: Mapping[str, Any] = field(default_factory=dict)
    simulated: bool = False
    time_offset_sigma_s: float = 0.0

    def __post_init__(self) -> None:
        if self.type not in SERIES_TYPES:
            raise ValueError(
                f"sensor '{self.name}': unknown type '{self.type}'; the choices are:"
                f" {', '.join(SERIES_TYPES)}"
            )
        if not isinstance(self.series, SERIES_TYPES[self.type]):
            raise ValueError(
                f"sensor '{self.name}' of type {self.type} holds a {type(self.series).__name__}"
            )


@dataclass(frozen=True)
class InitialState:
    """Where the mission says that it starts; what is None is unknown."""

    p_n: Array | None = None
    sigma_p: float = 1.0
    heading: float | None = None
    sigma_heading: float = 0.05


@dataclass(frozen=True)
class Constraints:
    """What the mission says of the vehicle's motion: facts that no sensor measures.

    Attributes
    ----------
    nonholonomic : bool
        It rolls on wheels or tracks: the body's origin moves neither sideways nor up.
    zero_velocity : bool
        It stands still whenever its IMU is quiet; never true of what floats.
    constant_depth : bool
        It keeps the depth of its start: what floats, or stands on a level floor.
    """

    nonholonomic: bool = False
    zero_velocity: bool = False
    constant_depth: bool = False


@dataclass(frozen=True)
class Relations:
    """Surveyed poses of the vehicle at one time in that at another: a reference without a frame.

    Attributes
    ----------
    sensor : str
        Whose stamps the times are.
    t : ndarray, shape (n, 2)
        Earlier and later time, s.
    q : ndarray, shape (n, 3)
        Pose at the later in that at the earlier: forward, starboard (m) and yaw (rad, clockwise).
    """

    sensor: str
    t: Array
    q: Array

    def shift(self, offset_s: float) -> Relations:
        """The same relations with an offset added to their times."""
        return replace(self, t=self.t + offset_s)


@dataclass(frozen=True)
class Opening:
    """How a mission was opened, so that it can be opened so again.

    Attributes
    ----------
    path : Path
        Absolute.
    card : Path or None
        What named its streams, where something did.
    start_s, stop_s : float or None
        What it was cropped to, start <= t < stop.
    """

    path: Path
    card: Path | None = None
    start_s: float | None = None
    stop_s: float | None = None

    def cropped(self, start_s: float, stop_s: float) -> Opening:
        """The same, cropped further."""
        start_s = start_s if self.start_s is None else max(start_s, self.start_s)
        stop_s = stop_s if self.stop_s is None else min(stop_s, self.stop_s)
        return replace(
            self,
            start_s=start_s if np.isfinite(start_s) else None,
            stop_s=stop_s if np.isfinite(stop_s) else None,
        )


@dataclass(frozen=True)
class Mission:
    """Everything that was measured on one outing.

    Attributes
    ----------
    name : str
    sensors : mapping of str to Sensor
    origin : Origin or None
        Of the local NED frame; None makes the frame local and switches Earth rate off.
    start_utc : float or None
        POSIX seconds of mission time zero.
    initial : InitialState
    landmark_map : LandmarkMap or None
        Surveyed landmarks.
    constraints : Constraints
        How the vehicle can move.
    relations : Relations or None
        Ground truth, as the reference is.
    edges : PoseEdges or None
        Of a mission that is a pose graph with loops or in space; in the plane its odometry holds
        the same steps.
    faults : tuple of str
        Specifications of the faults that were injected into it.
    rejections : tuple of Rejection
        What the reader dropped.
    warnings : tuple of str
        Degradations that the user must hear of.
    sources : tuple of Path
        Files that were read, for checksums.
    opening : Opening or None
        How it was opened; None of what does not come from disk.
    """

    name: str
    sensors: Mapping[str, Sensor]
    origin: Origin | None = None
    start_utc: float | None = None
    initial: InitialState = field(default_factory=InitialState)
    landmark_map: LandmarkMap | None = None
    constraints: Constraints = field(default_factory=Constraints)
    relations: Relations | None = None
    edges: PoseEdges | None = None
    faults: tuple[str, ...] = ()
    rejections: tuple[Rejection, ...] = ()
    warnings: tuple[str, ...] = ()
    sources: tuple[Path, ...] = ()
    opening: Opening | None = None

    def __repr__(self) -> str:
        start, stop = self.span_s
        held = ", ".join(f"{name}: {len(s.series)}" for name, s in self.sensors.items())
        return f"Mission('{self.name}', {start:.1f} to {stop:.1f} s, samples: {held or 'none'})"

    def of_type(self, sensor_type: str) -> list[Sensor]:
        """All sensors of a type that hold samples, in the mission's order."""
        return [s for s in self.sensors.values() if s.type == sensor_type and len(s.series)]

    def first(self, sensor_type: str) -> Sensor | None:
        """The first sensor of a type that holds samples."""
        return next(iter(self.of_type(sensor_type)), None)

    @property
    def aboard(self) -> str:
        """Its sensors' names, for a message; those without a sample are said to have none."""
        names = [
            name if len(sensor.series) else f"{name} (without samples)"
            for name, sensor in sorted(self.sensors.items())
        ]
        return ", ".join(names) or "no sensor"

    @property
    def reference(self) -> Sensor | None:
        """The ground truth, where the mission carries one; None otherwise."""
        return self.first("reference")

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last time at which any estimating sensor has a sample, or an edge a pose."""
        spans = [
            (float(s.series.t[0]), float(s.series.t[-1]))
            for s in self.sensors.values()
            if s.type != "reference" and len(s.series)
        ]
        if self.edges is not None:
            spans.append(self.edges.span_s)
        if not spans:
            return 0.0, 0.0
        return min(first for first, _ in spans), max(last for _, last in spans)

    @property
    def dropped(self) -> dict[tuple[str, str], int]:
        """How many samples the reader dropped, by sensor and reason."""
        return dict(sorted(Counter((r.sensor, r.reason) for r in self.rejections).items()))

    @property
    def sonar_kind(self) -> SonarKind | None:
        """Whether the sonar's echoes are recorded or simulated; None without a sonar."""
        sonar = self.first("beams") or self.first("scans")
        if sonar is None:
            return None
        return "simulated" if sonar.simulated else "recorded"

    def with_sensor(self, sensor: Sensor) -> Mission:
        """A copy with one sensor added or replaced."""
        return replace(self, sensors={**self.sensors, sensor.name: sensor})

    def without(self, *names: str) -> Mission:
        """A copy that lacks the named sensors."""
        return replace(self, sensors={k: s for k, s in self.sensors.items() if k not in names})

    def crop(self, start_s: float = -np.inf, stop_s: float = np.inf) -> Mission:
        """A copy with the samples, and rejections, of start <= t < stop; time keeps its zero.

        The stated initial state is that of the whole mission's start and goes with it.
        """
        cropped = {
            name: replace(s, series=s.series.crop(start_s, stop_s))
            for name, s in self.sensors.items()
        }
        initial = self.initial if start_s <= self.span_s[0] else InitialState()
        opening = self.opening and self.opening.cropped(start_s, stop_s)
        edges = self.edges and self.edges.crop(start_s, stop_s)
        # a rejection without a time may be of any
        outside = [r.t < start_s or r.t >= stop_s for r in self.rejections]
        rejections = tuple(itertools.compress(self.rejections, np.logical_not(outside)))
        return replace(
            self,
            sensors=cropped,
            initial=initial,
            edges=edges,
            opening=opening,
            rejections=rejections,
        )
