"""Messages of a ROS 1 or ROS 2 bag by topic and time, through the library rosbags."""

import re
import struct
import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dsmap.errors import InputError
from dsmap.folders import temporary_folder
from dsmap.sequences.extra import optional_library

_SUFFIXES = (".bag", ".db3", ".mcap")


@dataclass(frozen=True)
class Topic:
    """One topic of a bag."""

    name: str
    type: str
    """Message type, `sensor_msgs/msg/Image`."""
    count: int


@dataclass(frozen=True)
class Stamp:
    """Where a message is: enough to read it again."""

    part: int
    topic: str
    recorded_ns: int
    """Time at which it was recorded [ns]."""
    repeat: int
    """How many messages of the topic and the same time come before it."""
    time: float
    """Stamp of the message's header [s]; that of the recording where it has none."""


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: a file of a known suffix, or a folder of such files."""
    if path.is_file():
        return path.suffix.lower() in _SUFFIXES and _magic(path)
    if not path.is_dir():
        return False
    if (path / "metadata.yaml").is_file():
        with (path / "metadata.yaml").open("rb") as file:
            return b"rosbag2_bagfile_information" in file.read(4096)
    return bool(bag_files(path)) and not any(child.is_dir() for child in path.iterdir())


def typestore(path: Path, is_ros1: bool) -> Any:
    """Message types that readers decode; a bag's own definitions are not needed. Raises InputError: no rosbags."""
    types = optional_library("rosbags.typesys", path, "a bag")
    store = types.get_typestore(types.Stores.ROS1_NOETIC if is_ros1 else types.Stores.ROS2_HUMBLE)
    for name in ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"):
        if name not in store.types:
            store.register(types.get_types_from_msg("geometry_msgs/TransformStamped[] transforms", name))
    return store


def _magic(path: Path) -> bool:
    with path.open("rb") as file:
        head = file.read(16)
    known = (b"#ROSBAG", b"SQLite format 3", b"\x89MCAP")
    return not head or any(head.startswith(begin) for begin in known)  # an empty file gets its sentence later


def bag_files(folder: Path) -> list[Path]:
    """The parts of one bag in a folder: its files of one suffix, if their names differ by a last number only."""
    children = list(folder.iterdir())
    for suffix in _SUFFIXES:
        if found := sorted((f for f in children if f.suffix.lower() == suffix), key=_part):
            return found if len({_part(file)[0] for file in found}) == 1 else []
    return []


def _part(file: Path) -> tuple[str, int]:
    match = re.fullmatch(r"(.*?)_?(\d*)", file.stem)
    return (match[1], int(match[2] or -1)) if match else (file.stem, -1)


def _in_lower_case(part: Path) -> Path:
    """A file with the suffix in lower case, by which rosbags knows its format: the part itself or a link to it."""
    if part.is_dir() or part.suffix == part.suffix.lower():
        return part
    link = temporary_folder("bag") / (part.stem + part.suffix.lower())
    link.symlink_to(part.resolve())
    return link


class Bag:
    """A bag opened for reading. Each thread that reads gets readers of its own."""

    def __init__(self, path: Path):
        """Open a bag.

        Args:
            path: a `.bag`, `.db3` or `.mcap` file, or a folder of them.

        Raises:
            InputError: rosbags is not installed, or the bag is damaged.
        """
        self.path = path
        self._parts = [path] if path.is_file() or (path / "metadata.yaml").is_file() else bag_files(path)
        self.is_ros1 = self._parts[0].suffix.lower() == ".bag"
        store = typestore(path, self.is_ros1)
        self._decode = store.deserialize_ros1 if self.is_ros1 else store.deserialize_cdr
        self._local = threading.local()
        counts: dict[tuple[str, str], int] = {}
        for reader in self._readers():
            for c in reader.connections:
                counts[c.topic, c.msgtype] = counts.get((c.topic, c.msgtype), 0) + c.msgcount
        self.topics = [Topic(name, kind, count) for (name, kind), count in sorted(counts.items())]

    def of_type(self, *types: str) -> list[Topic]:
        """Topics that have messages of one of these types."""
        return [t for t in self.topics if t.type in types and t.count]

    def messages(self, topics: Iterable[Topic]) -> Iterator[tuple[Topic, Any]]:
        """The decoded messages of some topics, in order of time. Raises InputError."""
        for topic, _, raw in self._raw({t.name: t for t in topics}):
            yield topic, self._decoded(raw, topic)

    def first(self, topic: Topic) -> Any:
        """The first message of a topic. Raises InputError if there is none."""
        for _, message in self.messages([topic]):
            return message
        raise InputError(f"{self.path}, {topic.name}: found no message, expected some")

    def stamps(self, topic: Topic) -> list[Stamp]:
        """Where each message of a topic is, in order of their header's stamps; they are not decoded."""
        found, recorded = [], -1
        repeat = 0
        for _, (part, time_ns), raw in self._raw({topic.name: topic}):
            repeat = repeat + 1 if time_ns == recorded else 0
            recorded = time_ns
            found.append(Stamp(part, topic.name, time_ns, repeat, self._header_stamp(raw)))
        if all(stamp.time == 0 for stamp in found):  # written by a program that leaves headers empty
            found = [Stamp(s.part, s.topic, s.recorded_ns, s.repeat, s.recorded_ns / 1e9) for s in found]
        return sorted(found, key=lambda stamp: stamp.time)

    def read(self, stamp: Stamp, topic: Topic) -> Any:
        """Read one message again. Raises InputError."""
        reader = self._readers()[stamp.part]
        connections = [c for c in reader.connections if c.topic == topic.name and c.msgtype == topic.type]
        try:
            found = reader.messages(connections, start=stamp.recorded_ns, stop=stamp.recorded_ns + 1)
            for i, (_, _, raw) in enumerate(found):
                if i == stamp.repeat:
                    return self._decoded(raw, topic)
        except InputError:
            raise
        except Exception as error:  # whatever a reader of damaged bytes comes to
            raise self._damaged(error) from error
        raise InputError(f"{self.path}, {topic.name}: the message at {stamp.time} s is gone")

    def _raw(self, topics: dict[str, Topic]) -> Iterator[tuple[Topic, tuple[int, int], bytes]]:
        for part, reader in enumerate(self._readers()):
            chosen = [
                c for c in reader.connections if c.topic in topics and c.msgtype == topics[c.topic].type
            ]
            if not chosen:
                continue
            try:
                for connection, time_ns, raw in reader.messages(chosen):
                    yield topics[connection.topic], (part, time_ns), raw
            except GeneratorExit:
                raise
            except Exception as error:  # whatever a reader of damaged bytes comes to
                raise self._damaged(error) from error

    def _decoded(self, raw: bytes, topic: Topic) -> Any:
        try:
            return self._decode(raw, topic.type)
        except Exception as error:  # whatever a reader of damaged bytes comes to
            raise InputError(
                f"{self.path}, {topic.name}: a message does not decode as {topic.type} ({error})"
            ) from error

    def _readers(self) -> list[Any]:
        if not hasattr(self._local, "readers"):
            library = optional_library(
                "rosbags.rosbag1" if self.is_ros1 else "rosbags.rosbag2", self.path, "a bag"
            )
            try:
                readers = [library.Reader(_in_lower_case(part)) for part in self._parts]
                for reader in readers:
                    reader.open()
            except Exception as error:  # whatever a reader of damaged bytes comes to
                raise self._damaged(error) from error
            self._local.readers = readers
        return self._local.readers

    def _damaged(self, error: Exception) -> InputError:
        advice = (
            "; `rosbag reindex` makes a recording that was cut off readable" if "index" in str(error) else ""
        )
        text = str(error) or type(error).__name__
        return InputError(
            f"{self.path}: found a bag that cannot be read ({text}), expected a whole one{advice}"
        )

    def _header_stamp(self, raw: bytes) -> float:
        """Seconds of the std_msgs/Header that a message begins with."""
        try:
            if self.is_ros1:
                _, seconds, nanoseconds = struct.unpack_from("<III", raw)
            else:
                seconds, nanoseconds = struct.unpack_from("<iI" if raw[1] & 1 else ">iI", raw, 4)
        except (struct.error, IndexError):
            return 0.0
        return float(
            f"{seconds}.{nanoseconds:09d}"
        )  # the double nearest to the decimal number, as text files give
