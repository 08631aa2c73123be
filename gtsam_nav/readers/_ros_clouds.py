"""Clouds that stay in their bag until they are needed: hours of a lidar do not fit in memory."""

from __future__ import annotations

import atexit
import os
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array
from gtsam_nav.mission import Rejection
from gtsam_nav.preprocess.cleaning import screen
from gtsam_nav.readers._ros_bag import Bag, open_bag
from gtsam_nav.readers._ros_card import BagSensor
from gtsam_nav.readers._ros_dialects import dialects_of
from gtsam_nav.readers._ros_rows import Rows
from gtsam_nav.series import Cloud, CloudSeries

PLACE = "place"
"""Key of what stands for a cloud among the rows: its `BagCloud`."""


@dataclass(frozen=True)
class BagCloud:
    """A message of a bag, by the time of the log.

    Attributes
    ----------
    path : Path
        Of the bag.
    topic : str
    log_s : float
        Since the bag's zero.
    nth : int
        Of the topic's messages at this very time; zero but for logs with coarse clocks.
    """

    path: Path
    topic: str
    log_s: float
    nth: int

    def read(self) -> Cloud:
        """The cloud, forward, starboard, down.

        Raises
        ------
        DataError
            Where the bag is no longer what it was.
        """
        bag, _ = _opened(self.path, os.getpid())
        topic = bag.topics.get(self.topic)
        if topic is not None:
            raw = next(islice(bag.raw_messages_at(topic, self.log_s), self.nth, None), None)
            message = None if raw is None else bag.decode(topic, raw)
            if message is not None:
                (dialect,) = dialects_of(topic.type)
                sample = dialect.read(message, BagSensor(type=dialect.sensor))
                if not isinstance(sample, str):
                    return Cloud(**dialect.convert(sample))
        raise DataError(f"the cloud on '{self.topic}' at {self.log_s:.3f} s is gone", self.path)


@lru_cache(maxsize=1)
def _opened(path: Path, _process: int) -> tuple[Bag, ExitStack]:
    """A bag that is open while the second is held; forked processes share no place in its file."""
    stack = ExitStack()
    return stack.enter_context(open_bag(path)), stack


atexit.register(_opened.cache_clear)


class CloudPlaces:
    """Where the messages of a bag's topics are, as they go by in the order of the log."""

    def __init__(self, path: Path) -> None:
        self._path = path.resolve()
        self._last: dict[str, BagCloud] = {}

    def next(self, topic: str, log_s: float) -> BagCloud:
        """The place of the message that went by on a topic just now."""
        last = self._last.get(topic)
        nth = last.nth + 1 if last is not None and last.log_s == log_s else 0
        self._last[topic] = BagCloud(self._path, topic, log_s, nth)
        return self._last[topic]


def cloud_series(name: str, t: Array, rows: Rows) -> tuple[CloudSeries | None, list[Rejection]]:
    """The clouds that have points, each where it is in the bag."""
    kept, rejections = screen(CloudSeries, name, {"t": t}, refused=rows.refused())
    if not len(kept):
        return None, rejections
    places = rows.objects(PLACE)
    return CloudSeries(t=t[kept], row=kept, clouds=tuple(places[k] for k in kept)), rejections
