"""ROS bags without ROS: ROS 1 ``.bag``, ROS 2 ``.db3`` and ``.mcap``, several files as one.

Which topics become which sensors is a card's matter, the section ``mission`` of a file given by
``-c``; ``gtsam-nav inspect BAG`` prints one::

    mission:
      body_frame: base_link             # of tf_static; all but the sensors is optional
      origin: {latitude_deg: 42.2, longitude_deg: 3.1, height_m: 0.0}
      sensors:
        imu: {topic: /imu/data, stamp: header}
        heading: {topic: /imu/data, noise: {declination_deg: 1.4}}
        dvl: {topic: /dvl/data, xyz_m: [0.2, 0, 0.1], rpy_deg: [0, 0, 45], time_offset_s: -0.1}
        depth: {topic: /pressure, surface_pressure_pa: 101100}

Without a card the topics whose types are plain become sensors, and a warning names the choice. A
mounting that no card states is that of ``tf_static``, where there is one. `_ros_dialects` holds the
message types.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gtsam_nav.cards import MISSION_SECTION, read_yaml
from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, Origin
from gtsam_nav.mission import Mission, Rejection, Sensor
from gtsam_nav.preprocess.cleaning import tidy
from gtsam_nav.preprocess.repeats import without_repeats
from gtsam_nav.readers._clock import on_mission_time
from gtsam_nav.readers._gnss import Fixes
from gtsam_nav.readers._mounting import in_body_axes
from gtsam_nav.readers._ros_bag import Bag, Clock, bag_paths, open_bag
from gtsam_nav.readers._ros_card import BagCard, BagSensor
from gtsam_nav.readers._ros_choice import Choice, choose, could_be, propose
from gtsam_nav.readers._ros_clock import (
    Stamp,
    choose_stamps,
    clock_text,
    clock_warnings,
    stamps_of,
)
from gtsam_nav.readers._ros_clouds import PLACE, CloudPlaces, cloud_series
from gtsam_nav.readers._ros_dialects import Columns
from gtsam_nav.readers._ros_messages import NO_FIX, Sample
from gtsam_nav.readers._ros_mounting import Frames, Mounting, check_near_the_body
from gtsam_nav.readers._ros_parts import check_one_recording
from gtsam_nav.readers._ros_rows import Cleaned, Rows, beams, scans, with_usual_noise
from gtsam_nav.readers.contents import Contents, Stream
from gtsam_nav.sensors.noise import NOISE_MODELS
from gtsam_nav.series import SERIES_TYPES, BoolArray, CloudSeries, ScanSeries
from gtsam_nav.solution import Progress, no_progress

NAME = "ROS bag"
EXPECTS = "a .bag, .db3 or .mcap file, a folder of such, or a ROS 2 bag's folder (metadata.yaml)"

UNDECODABLE = "undecodable message"
BARE_TYPES = ("odometry", "reference")
"""Sensors whose samples are the body's as they are, whatever their frame is."""


def can_open(path: Path) -> bool:
    """Whether the path is a bag, or a folder with files of one."""
    try:
        return bool(bag_paths(path))
    except (OSError, ValueError):
        return False


def read(path: Path, progress: Progress = no_progress, card: Path | None = None) -> Mission:
    """Read a bag.

    Parameters
    ----------
    path : Path
        Several files in one folder are read as one.
    progress : Progress, optional
    card : Path, optional
        YAML with the section ``mission``.

    Raises
    ------
    DataError
        Where the bag is damaged, the card does not fit it, or no topic is a sensor.
    """
    with open_bag(path) as bag:
        check_one_recording(bag, path)
        stated, choices, notes = _card_and_choices(bag, card)
        clocks = _clocks(bag, choices)
        frames = Frames(bag.static_transforms(), stated.body_frame)
        reading = _Reading(bag, choices, clocks, frames, CloudPlaces(path))
        reading.warnings += [*notes, *clock_warnings(choices, clocks)]
        reading.run(progress)
        origin = None if stated.origin is None else stated.origin.to_origin()
        sensors = reading.sensors(origin)
        mission = Mission(
            name=stated.name or _name(path),
            sensors=sensors,
            origin=reading.origin,
            start_utc=float(bag.zero_s) if bag.is_posix else None,
            initial=stated.initial.to_state(reading.origin, card or path),
            constraints=stated.constraints.to_constraints(),
            rejections=tuple(reading.rejections),
            warnings=tuple(reading.warnings),
            sources=(*_files(bag), *([card] if card else [])),
        )
    return on_mission_time(mission, {c.name: c.entry.time_offset_s for c in choices})


def describe(path: Path, card: Path | None = None) -> Contents:
    """List the topics of a bag, and a card for it: the given one, or what is taken without.

    The card is empty where no topic is a sensor by itself.

    Raises
    ------
    DataError
        Where the bag is damaged, or the given card does not fit it.
    """
    with open_bag(path) as bag:
        check_one_recording(bag, path)
        streams = []
        for topic in bag.topics.values():
            clock = bag.clock(topic)
            streams.append(
                Stream(
                    topic.name,
                    topic.type,
                    topic.n_messages,
                    clock.rate_hz,
                    could_be(topic),
                    clock_text(clock),
                )
            )
        try:
            stated, choices, _ = _card_and_choices(bag, card)
        except DataError:
            if card is not None:
                raise
            return Contents(tuple(streams), "")
        frames = Frames(bag.static_transforms(), stated.body_frame)
        return Contents(tuple(streams), _yaml(stated, choices, _clocks(bag, choices), frames))


def _card_and_choices(bag: Bag, card: Path | None) -> tuple[BagCard, list[Choice], list[str]]:
    if card is None:
        choices, notes = propose(bag)
        return BagCard(sensors={c.name: c.entry for c in choices}), choices, notes
    stated = read_yaml(card, BagCard, section=MISSION_SECTION)
    return stated, choose(bag, stated), []


def _clocks(bag: Bag, choices: Sequence[Choice]) -> dict[str, Clock]:
    return {name: bag.clock(bag.topics[name]) for name in {c.topic.name: None for c in choices}}


def _yaml(stated: BagCard, choices: list[Choice], clocks: dict[str, Clock], frames: Frames) -> str:
    """The card with what was found out: topics, stamps, and a mounting where none is known."""
    import yaml

    stamps = choose_stamps(choices, clocks)
    entries = {}
    for choice in choices:
        found: dict[str, Any] = {"topic": choice.topic.name, "stamp": stamps[choice.name]}
        frame = clocks[choice.topic.name].frame
        known = frames.mounting(frame, turned=choice.dialect.turned) is not None
        if not (known or choice.entry.is_mounted or choice.dialect.sensor in BARE_TYPES):
            found["xyz_m"] = [0.0, 0.0, 0.0]
            if choice.dialect.sensor != "gnss":
                found["rpy_deg"] = [0.0, 0.0, 0.0]
        given = choice.entry.model_dump(mode="json", exclude_unset=True)
        entries[choice.name] = BagSensor.model_validate({**given, **found})
    tree = stated.model_copy(update={"sensors": entries}).to_tree()
    return yaml.safe_dump(tree, sort_keys=False, default_flow_style=None)


def _name(path: Path) -> str:
    place = path.resolve()
    return place.stem if place.is_file() else place.name


def _files(bag: Bag) -> list[Path]:
    return [
        file
        for path in bag.paths
        for file in (sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path])
    ]


class _Reading:
    """The messages of the chosen topics on their way to sensors."""

    def __init__(
        self,
        bag: Bag,
        choices: list[Choice],
        clocks: dict[str, Clock],
        frames: Frames,
        places: CloudPlaces,
    ) -> None:
        self.bag = bag
        self.choices = choices
        self.clocks = clocks
        self.frames = frames
        self.places = places
        self.stamps: dict[str, Stamp] = choose_stamps(choices, clocks)
        self.rows = {choice.name: Rows() for choice in choices}
        self.origin: Origin | None = None
        self.rejections: list[Rejection] = []
        self.warnings: list[str] = []
        self.unmounted: dict[str, str] = {}

    def run(self, progress: Progress) -> None:
        """Read all messages of the chosen topics."""
        by_topic: dict[str, list[Choice]] = {}
        for choice in self.choices:
            by_topic.setdefault(choice.topic.name, []).append(choice)
        duration_s = max(self.bag.duration_s, 1e-9)
        topics = [self.bag.topics[name] for name in by_topic]
        for k, (name, log_s, raw) in enumerate(self.bag.raw_messages(topics)):
            if k % 1000 == 0:
                progress("read mission", min(log_s / duration_s, 1.0))
            message = self.bag.decode(self.bag.topics[name], raw)
            place = self.places.next(name, log_s)
            for choice in by_topic[name]:
                sample = _sample(choice, message)
                if choice.dialect.sensor == CloudSeries.TYPE and not isinstance(sample, str):
                    sample = {PLACE: place}
                self.rows[choice.name].add(sample)
        progress("read mission", 1.0)

    def sensors(self, origin: Origin | None) -> dict[str, Sensor]:
        """All sensors that hold a sample; the first fix is the origin where none is given."""
        self.origin = origin
        found: dict[str, Sensor] = {}
        for choice in self.choices:
            mounting = self._mounting(choice)
            series, dropped = self._series(choice, mounting)
            self.rejections += dropped
            if series is None:
                reasons = Counter(r.reason for r in dropped)
                why = ", ".join(f"{n} x {reason}" for reason, n in sorted(reasons.items()))
                self.warnings.append(
                    f"sensor '{choice.name}' is left out: no valid sample on"
                    f" {choice.topic.name} ({why or 'no message'})"
                )
                continue
            if choice.entry.drop_repeats:
                series, repeats = without_repeats(choice.name, series)
                self.rejections += repeats
            R_bs, xyz_b = mounting
            is_placed = isinstance(series, ScanSeries)
            if _is_bare(choice):
                xyz_b = np.zeros(3)
            if is_placed or _is_bare(choice):
                R_bs = np.eye(3)
            sensor = Sensor(
                choice.name,
                choice.entry.type,
                series,
                xyz_b=xyz_b,
                R_bs=R_bs,
                noise=choice.entry.noise,
                time_offset_sigma_s=choice.entry.time_offset_sigma_s,
            )
            found[choice.name] = sensor if is_placed else in_body_axes(sensor)
        self._warn_of_the_unmounted()
        return found

    def _mounting(self, choice: Choice) -> Mounting:
        if choice.entry.is_mounted:
            return choice.entry.R_bs, choice.entry.xyz_b
        frame = self.clocks[choice.topic.name].frame
        found = self.frames.mounting(frame, turned=choice.dialect.turned)
        if found is not None:
            if choice.dialect.sensor not in BARE_TYPES:
                check_near_the_body(choice.name, found)
            return found
        if choice.dialect.sensor not in BARE_TYPES:
            self.unmounted[choice.name] = frame
        return np.eye(3), np.zeros(3)

    def _warn_of_the_unmounted(self) -> None:
        if self.unmounted:
            lost = ", ".join(f"{name} ('{frame}')" for name, frame in self.unmounted.items())
            names = ", ".join(self.frames.names) or "none"
            self.warnings.append(
                f"no static transform leads from '{self.frames.body}' to the frames of {lost};"
                f" the frames are: {names}; these sensors are taken to sit at the body's origin"
                " along its axes, unless a card states xyz_m and rpy_deg"
            )

    def _series(self, choice: Choice, mounting: Mounting) -> Cleaned:
        rows = self.rows[choice.name]
        t = stamps_of(self.clocks[choice.topic.name], self.stamps[choice.name])
        kind = choice.dialect.sensor
        if kind == "scans":
            return scans(choice.name, t, rows, mounting)
        if kind == "beams":
            return beams(choice.name, t, rows)
        if kind == "clouds":
            return cloud_series(choice.name, t, rows)
        if not any(sample is not None for sample in rows.samples):
            return None, [
                Rejection(float(t[k]), choice.name, k, reason)
                for k, reason in enumerate(rows.reasons)
            ]
        columns = choice.dialect.convert(rows.stacked())
        model = NOISE_MODELS.get(kind)
        noise = None if model is None else model.model_validate(choice.entry.noise)
        columns = with_usual_noise(kind, columns, noise)
        if "latitude_deg" in columns:
            return self._fixes(choice.name, t, columns, rows.refused())
        return tidy(
            SERIES_TYPES[kind],
            choice.name,
            {"t": t, **columns},
            refused=rows.refused(),
            max_speed_m_s=getattr(noise, "max_speed_m_s", np.inf),
        )

    def _fixes(self, name: str, t: Array, c: Columns, refused: Mapping[str, BoolArray]) -> Cleaned:
        place = (c["latitude_deg"], c["longitude_deg"], c["height_m"])
        unread = dict(refused)
        has_fix = ~unread.pop(NO_FIX, np.zeros(len(t), dtype=bool))
        fixes = Fixes(t, *place, c["sigma"], has_fix=has_fix, unread=unread)
        if self.origin is None:
            self.origin = fixes.first_usable()
        return fixes.series(name, self.origin or Origin(0.0, 0.0))


def _is_bare(choice: Choice) -> bool:
    """Whether samples are the body's own: of a reference until a card says where it sits."""
    stated = choice.dialect.sensor == "reference" and choice.entry.is_mounted
    return choice.dialect.sensor in BARE_TYPES and not stated


def _sample(choice: Choice, message: Any | None) -> Sample | str:
    if message is None:
        return UNDECODABLE
    try:
        return choice.dialect.read(message, choice.entry)
    except (AttributeError, KeyError, TypeError, ValueError, IndexError) as error:
        # the name of a message type promises fields that this one does not have
        raise DataError(
            f"topic '{choice.topic.name}': {choice.topic.type} is not the message that is known"
            f" under this name: {error}"
        ) from error
