"""What a ROS bag holds, and on which clock: topics, stamps and static transforms.

ROS 1 ``.bag`` files, ROS 2 folders (``metadata.yaml`` beside ``.db3`` or ``.mcap``) and such files
by themselves are read by `rosbags`, without ROS.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gtsam_nav.errors import DataError
from gtsam_nav.frames import Array, rotation_from_quaternion
from gtsam_nav.readers._ros_archives import bound_chunks
from gtsam_nav.readers._ros_definitions import DEFINITIONS

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection

METADATA = "metadata.yaml"
ROS1, STORAGES = ".bag", (".db3", ".mcap")
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
HEADER = "std_msgs/msg/Header"

MAGIC = {".bag": b"#ROSBAG V", ".db3": b"SQLite format 3", ".mcap": b"\x89MCAP0"}
REPAIR = (
    "a bag that was cut off or never closed can be repaired with 'rosbag reindex' (ROS 1),"
    " 'ros2 bag reindex' or 'mcap recover'"
)

Transform = tuple[str, Array, Array]
"""Parent frame, rotation (3, 3) and translation (3,) of a frame in it, in ROS's axes."""


@dataclass(frozen=True)
class Topic:
    """One topic of a bag.

    Attributes
    ----------
    name, type : str
        Type as ROS 2 writes it, ``package/msg/Name``.
    n_messages : int
    readable : bool
        Whether its message type is defined in the bag or here.
    stamped : bool
        Whether its messages begin with a header.
    connections : tuple of Connection
        Of `rosbags`.
    """

    name: str
    type: str
    n_messages: int
    readable: bool
    stamped: bool
    connections: tuple[Connection, ...]


@dataclass(frozen=True)
class Clock:
    """Stamps of a topic's messages, s since the bag's second zero, and the frame of the first.

    ``header_s`` is NaN where a header holds no time; None of messages without a header.
    """

    log_s: Array
    header_s: Array | None
    frame: str

    @cached_property
    def lag_s(self) -> float | None:
        """Median of log less header time; None without headers that tell a time."""
        if self.header_s is None or np.mean(np.isfinite(self.header_s)) < 0.5:
            return None
        return float(np.nanmedian(self.log_s - self.header_s))

    @cached_property
    def jitter_s(self) -> float:
        """Spread of the log's delay: its 95th percentile less the 5th, s."""
        if self.header_s is None or not np.any(np.isfinite(self.header_s)):
            return 0.0
        low, high = np.nanpercentile(self.log_s - self.header_s, [5, 95])
        return float(high - low)

    @cached_property
    def drift_ppm(self) -> float | None:
        """Slope of the log's clock over the header's; None below a minute."""
        if self.header_s is None:
            return None
        known = np.isfinite(self.header_s)
        header_s, delay_s = self.header_s[known], (self.log_s - self.header_s)[known]
        if len(header_s) < 10 or np.ptp(header_s) < 60.0:
            return None
        # medians of the two ends: single late messages say nothing of a drift
        third = len(header_s) // 3
        rise = np.median(delay_s[-third:]) - np.median(delay_s[:third])
        return float(1e6 * rise / (np.median(header_s[-third:]) - np.median(header_s[:third])))

    @property
    def rate_hz(self) -> float | None:
        """Of the median interval on the log's clock."""
        steps = np.diff(np.unique(self.log_s))
        return float(1.0 / np.median(steps)) if len(steps) else None


class Bag:
    """An open bag of ``duration_s``. Times are seconds since ``zero_s``, a whole POSIX second."""

    def __init__(self, reader: AnyReader, paths: tuple[Path, ...]) -> None:
        self.paths = paths
        self._reader = reader
        for time_ns in (reader.start_time, reader.duration):
            if abs(time_ns) >= 2**63:  # ROS counts in 64 bits; a damaged metadata.yaml need not
                raise ValueError("its start or duration is no time")
        self.topics = {topic.name: topic for topic in self._topics()}
        self.zero_s = reader.start_time // 10**9 if reader.message_count else 0
        self.duration_s = reader.duration * 1e-9 if reader.message_count else 0.0

    def _topics(self) -> Iterator[Topic]:
        known: Mapping[str, Any] = self._reader.typestore.fielddefs
        by_name: dict[str, list[Connection]] = {}
        for connection in self._reader.connections:
            by_name.setdefault(connection.topic, []).append(connection)
        for name, connections in sorted(by_name.items()):
            kind = connections[0].msgtype
            stamped = bool(fields := known.get(kind, ((), ()))[1]) and fields[0][1][1] == HEADER
            count = sum(connection.msgcount for connection in connections)
            yield Topic(name, kind, count, kind in known, stamped, tuple(connections))

    @property
    def spans_ns(self) -> list[tuple[int, int, str]]:
        """Start, end and name of each file that holds messages, in the order of their starts."""
        return sorted(
            (part.start_time, part.end_time, Path(str(part.path)).name)
            for part in self._reader.readers
            if part.message_count
        )

    @property
    def is_posix(self) -> bool:
        """Whether its clock is the world's, and not a simulation's or one since power-up."""
        return self.zero_s > 10**8

    def since_zero(self, seconds: int, nanoseconds: int) -> float:
        """A stamp, s since the bag's zero; NaN for the stamp zero, which tells nothing."""
        if seconds == 0 and nanoseconds == 0:
            return np.nan
        return (seconds - self.zero_s) + 1e-9 * nanoseconds

    def raw_messages(self, topics: list[Topic]) -> Iterator[tuple[str, float, bytes]]:
        """Topic, log time and bytes of all messages on some topics, in the order of the log."""
        connections = [c for topic in topics for c in topic.connections]
        for connection, log_ns, raw in self._messages(connections):
            yield connection.topic, (log_ns - self.zero_s * 10**9) * 1e-9, raw

    def raw_messages_at(self, topic: Topic, log_s: float) -> Iterator[bytes]:
        """Bytes of the messages on a topic at a log time that `raw_messages` gave."""
        log_ns = self.zero_s * 10**9 + round(log_s * 1e9)
        for _, _, raw in self._messages(list(topic.connections), log_ns, log_ns + 1):
            yield raw

    def _messages(
        self, connections: list[Connection], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[tuple[Connection, int, bytes]]:
        if not connections:
            return
        try:
            for connection, log_ns, raw in self._reader.messages(connections, start_ns, stop_ns):
                # SQLite keeps values of any type in any column
                if not (isinstance(log_ns, int) and isinstance(raw, bytes | memoryview)):
                    raise ValueError(f"a message on {connection.topic} has no time or no bytes")
                yield connection, log_ns, raw
        except Exception as error:  # rosbags raises whatever the damage leads to
            raise self._damaged(error) from error

    def decode(self, topic: Topic, raw: bytes) -> Any | None:
        """A message; None where its bytes do not fit its type."""
        try:
            return self._reader.deserialize(raw, topic.type)
        except Exception:  # noqa: BLE001
            return None

    def clock(self, topic: Topic) -> Clock:
        """The stamps of a topic; only the headers are decoded."""
        log_s: list[float] = []
        header_s: list[float] = []
        frame = ""
        for _, log, raw in self.raw_messages([topic]):
            log_s.append(log)
            if topic.stamped:
                seconds, nanoseconds, name = self._header(raw)
                header_s.append(self.since_zero(seconds, nanoseconds))
                frame = frame or name
        return Clock(np.array(log_s), np.array(header_s) if topic.stamped else None, frame)

    def _header(self, raw: bytes) -> tuple[int, int, str]:
        """Stamp and frame of a message that begins with a header, from its first bytes."""
        try:
            if self._reader.is2:
                order = "<" if raw[1] & 1 else ">"
                seconds, nanoseconds, size = struct.unpack_from(f"{order}iII", raw, 4)
                size -= 1  # the closing zero of a CDR string
            else:
                _, seconds, nanoseconds, size = struct.unpack_from("<IIII", raw)
            name = bytes(raw[16 : 16 + size]).decode("utf-8", "replace").strip("/")
        except (struct.error, IndexError):
            return 0, 0, ""
        return seconds, nanoseconds, name

    def static_transforms(self) -> dict[str, Transform]:
        """Frame to its place in its parent, from ``tf_static``."""
        topics = [
            topic
            for topic in self.topics.values()
            if topic.type in TF_TYPES and topic.name.rpartition("/")[2] == "tf_static"
        ]
        found: dict[str, Transform] = {}
        for name, _, raw in self.raw_messages(topics):
            message = self.decode(self.topics[name], raw)
            for entry in [] if message is None else message.transforms:
                p, q = entry.transform.translation, entry.transform.rotation
                wxyz = np.array([q.w, q.x, q.y, q.z])
                if not (np.all(np.isfinite(wxyz)) and np.any(wxyz)):
                    continue
                parent = entry.header.frame_id.strip("/")
                R = rotation_from_quaternion(wxyz)
                found[entry.child_frame_id.strip("/")] = parent, R, np.array([p.x, p.y, p.z])
        return found

    def _damaged(self, error: Exception) -> DataError:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        return DataError(f"the bag is damaged: {reason}; {REPAIR}", self.paths[0])


def bag_paths(path: Path) -> tuple[Path, ...]:
    """What `rosbags` must be given for a path: a file, a ROS 2 folder, or all files of a folder.

    Empty where the path is no bag.
    """
    if path.is_file():
        return (path,) if path.suffix in (ROS1, *STORAGES) else ()
    if not path.is_dir():
        return ()
    if (path / METADATA).is_file():
        return (path,)
    files = [p for p in sorted(path.iterdir()) if p.is_file()]
    # the two kinds do not go together
    ros1 = tuple(p for p in files if p.suffix == ROS1)
    return ros1 or tuple(p for p in files if p.suffix in STORAGES)


def _remedy(paths: tuple[Path, ...]) -> str:
    """What helps with a bag that does not open."""
    files = [f for path in paths for f in (path.iterdir() if path.is_dir() else [path])]
    for path in sorted(f for f in files if f.suffix in MAGIC):
        magic = MAGIC[path.suffix]
        with suppress(OSError), path.open("rb") as stream:
            begin = stream.read(len(magic))
            if begin != magic:
                return f"; {path.name} " + ("does not begin like one" if begin else "is empty")
    return f"; {REPAIR}"


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a bag, or the files of one.

    Raises
    ------
    DataError
        Where it is damaged or unfinished.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    bound_chunks()
    standard = get_typestore(Stores.ROS2_HUMBLE)
    paths = bag_paths(path)
    with ExitStack() as stack:
        try:
            reader = stack.enter_context(AnyReader(paths, default_typestore=standard))
            _add_missing(reader.typestore, _spare_types())
            bag = Bag(reader, paths)
        except Exception as error:  # rosbags raises whatever the damage leads to
            reason = " ".join(str(error).split())[:300] or type(error).__name__
            raise DataError(f"the bag cannot be opened: {reason}{_remedy(paths)}", path) from error
        yield bag


@cache
def _spare_types() -> Any:
    """The types of messages that a bag need not define: those of ROS 2, and some more."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    spare = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        lines = "\n".join(line.strip() for line in text.splitlines())
        spare.register(get_types_from_msg(lines, name))
    return spare


def _add_missing(store: Any, spare: Any) -> None:
    """Add the types that a bag's store lacks, as they are: to register them is to compile them."""
    for name in spare.fielddefs.keys() - store.fielddefs.keys():
        store.fielddefs[name], store.types[name] = spare.fielddefs[name], spare.types[name]
