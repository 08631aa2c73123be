"""Which topics of a bag become which sensors: as a card says, or as seems best."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from gtsam_nav.errors import DataError
from gtsam_nav.readers._ros_bag import Bag, Topic
from gtsam_nav.readers._ros_card import BagCard, BagSensor
from gtsam_nav.readers._ros_dialects import Dialect, dialects_of

LOOKED_AT = 50
"""Messages that must show an orientation before a topic counts as compass."""

TRUTH = re.compile(r"truth|(^|[/_])gt([/_]|$)|reference", re.IGNORECASE)
"""Topics of positions that are somebody's truth."""

SENSORS = (
    *("imu", "heading", "attitude", "dvl", "odometry", "gnss", "depth"),
    *("beams", "scans", "clouds"),
)
"""In the order in which they are taken without a card."""


@dataclass(frozen=True)
class Choice:
    """A topic read as a sensor."""

    name: str
    topic: Topic
    dialect: Dialect
    entry: BagSensor


def choose(bag: Bag, card: BagCard) -> list[Choice]:
    """What a card asks for.

    Raises
    ------
    DataError
        Where a topic is not there, is not named among several, or cannot be what it is to be.
    """
    return [_choice(bag, name, entry) for name, entry in card.sensors.items()]


def _choice(bag: Bag, name: str, entry: BagSensor) -> Choice:
    path = bag.paths[0]
    if not entry.topic:
        return _only_choice(bag, name, entry)
    topic = bag.topics.get(entry.topic)
    if topic is None:
        raise DataError(
            f"sensor '{name}': no topic '{entry.topic}'; the topics are: {', '.join(bag.topics)}",
            path,
        )
    if not topic.readable:
        raise DataError(
            f"sensor '{name}': the message type {topic.type} of '{topic.name}' is defined neither"
            f" in the bag nor here; topics that can be read: {_listed(_readable(bag))}",
            path,
        )
    for dialect in dialects_of(topic.type):
        if dialect.sensor == entry.type:
            choice = Choice(name, topic, dialect, entry)
            _check_card(choice, path)
            return choice
    kinds = ", ".join(dict.fromkeys(d.sensor for d in dialects_of(topic.type)))
    raise DataError(
        f"sensor '{name}': '{topic.name}' of type {topic.type} cannot be read as {entry.type};"
        f" the choices are: {kinds or 'none'}",
        path,
    )


def _check_card(choice: Choice, path: Path) -> None:
    """Raise a DataError where the card lacks what the topic needs, or asks for what it has not."""
    topic, entry = choice.topic, choice.entry
    missing = [key for key in choice.dialect.keys if key not in entry.model_fields_set]
    if missing:
        raise DataError(
            f"sensor '{choice.name}': '{topic.name}' holds bare numbers ({topic.type}), and the"
            f" card lacks {' and '.join(missing)}: {entry.type} = scale * number + offset_m",
            path,
        )
    if entry.stamp == "header" and not topic.stamped:
        raise DataError(
            f"sensor '{choice.name}': stamp: header, but the messages of '{topic.name}' have no"
            " header; the choices are: log",
            path,
        )


def _only_choice(bag: Bag, name: str, entry: BagSensor) -> Choice:
    found = [
        (topic, dialect)
        for topic in _readable(bag)
        for dialect in dialects_of(topic.type)
        if dialect.sensor == entry.type and dialect.default
    ]
    if len(found) != 1:
        topics = _listed([topic for topic, _ in found])
        what = "no topic" if not found else "more than one topic"
        raise DataError(
            f"sensor '{name}': {what} can be read as {entry.type}; name one by topic:"
            f" {topics or _listed(_readable(bag))}",
            bag.paths[0],
        )
    return Choice(name, *found[0], entry)


def _readable(bag: Bag) -> list[Topic]:
    return [topic for topic in bag.topics.values() if topic.readable and dialects_of(topic.type)]


def _listed(topics: list[Topic]) -> str:
    return ", ".join(topic.name for topic in topics)


def propose(bag: Bag) -> tuple[list[Choice], list[str]]:
    """What is taken where no card says it, and what there is to say of that.

    Raises
    ------
    DataError
        Where no topic can be a sensor.
    """
    candidates: dict[str, list[tuple[Topic, Dialect]]] = {}
    for topic in _readable(bag):
        for dialect in _by_default(bag, topic):
            candidates.setdefault(dialect.sensor, []).append((topic, dialect))
    order = [kind for kind in (*SENSORS, "reference") if kind in candidates]
    if not any(kind != "reference" for kind in order):
        held = "; ".join(f"{t.name} ({t.type})" for t in bag.topics.values())
        raise DataError(
            f"no topic is read as a sensor without a card; the bag holds: {held or 'no topic'}",
            bag.paths[0],
        )
    choices = []
    others = []
    for kind in order:
        topic, dialect = candidates[kind][0]
        choices.append(Choice(kind, topic, dialect, BagSensor(type=kind, topic=topic.name)))
        others += [f"{kind}: {other.name}" for other, _ in candidates[kind][1:]]
    taken = ", ".join(f"{choice.name} from {choice.topic.name}" for choice in choices)
    note = f"without a card these topics are taken: {taken}"
    if others:
        note += f"; also possible: {', '.join(others)}"
    return choices, [note, *_unused(bag, choices)]


def _unused(bag: Bag, choices: list[Choice]) -> list[str]:
    """What is said of topics that a card could make sensors of, and of those nobody can read."""
    taken = {choice.topic.name for choice in choices}
    offered = {
        topic.name: could_be(topic) for topic in bag.topics.values() if topic.name not in taken
    }
    some = [f"{name} ({', '.join(kinds)})" for name, kinds in offered.items() if kinds]
    unknown = [f"{t.name} ({t.type})" for t in bag.topics.values() if not t.readable]
    found = []
    if some:
        found.append(f"a card could also use: {'; '.join(some)}")
    if unknown:
        found.append(f"message types without a definition are left out: {', '.join(unknown)}")
    return found


def _by_default(bag: Bag, topic: Topic) -> list[Dialect]:
    """The ways in which a topic is read without a card."""
    known = dialects_of(topic.type)
    if TRUTH.search(topic.name):
        return [d for d in known if d.sensor == "reference"]
    if "dvl" in topic.name.lower() and any(d.sensor == "dvl" for d in known):
        # drivers of DVLs publish plain twists too; whose covariance says what they measure
        return [d for d in known if d.sensor == "dvl" and (d.default or topic.stamped)]
    found = [d for d in known if d.default]
    if any(d.sensor in ("heading", "attitude") for d in found) and not _is_oriented(bag, topic):
        found = [d for d in found if d.sensor not in ("heading", "attitude")]
    return found


def _is_oriented(bag: Bag, topic: Topic) -> bool:
    """Whether the first messages of a topic hold an orientation."""
    (heading,) = [d for d in dialects_of(topic.type) if d.sensor == "heading" and d.default]
    entry = BagSensor(type="heading")
    for _, _, raw in islice(bag.raw_messages([topic]), LOOKED_AT):
        message = bag.decode(topic, raw)
        if message is not None and not isinstance(heading.read(message, entry), str):
            return True
    return False


def could_be(topic: Topic) -> tuple[str, ...]:
    """Everything that a topic can be read as, with what is needed for it."""
    if not topic.readable:
        return ("unknown message type",)
    found: dict[str, Any] = {}
    for dialect in dialects_of(topic.type):
        needed = f" (needs {dialect.needs})" if dialect.needs else ""
        found[f"{dialect.sensor}{needed}"] = None
    return tuple(found)
