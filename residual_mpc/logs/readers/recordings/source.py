"""Raw messages from a rosbag2, a ROS 1 bag or an MCAP file, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from residual_mpc.errors import BadInput
from residual_mpc.extras import extra
from residual_mpc.logs.readers.table import first_line

RawMessage = tuple[str, int, bytes]  # topic, receive stamp in ns, content


@dataclass(frozen=True)
class Topic:
    """Attributes:
    name: name of the topic.
    kind: type of its messages.
    count: number of messages; 0 if the recording does not state it.
    encoding: of the messages: "cdr", "ros1", "json" or another.
    definition: of their type; empty if the recording contains none.
    language: of the definition, "msg" or "idl".
    """

    name: str
    kind: str
    count: int
    encoding: str
    definition: str
    language: str


@dataclass(frozen=True)
class Source:
    """One recording.

    Attributes:
        path: the file, or the folder of a rosbag2.
        topics: by name.
        messages: the messages of the named topics, in the order of the recording; each call opens the file anew.
        broken: whether the recording is truncated; everything before the break can be read.
    """

    path: Path
    topics: dict[str, Topic]
    messages: Callable[[Collection[str]], Iterator[RawMessage]]
    broken: bool = False


def open_recording(path: Path) -> Source:
    """The topics of a recording.

    Raises:
        BadInput: a damaged recording, or a package that is not installed.
    """
    if path.is_file() and _begins(path, b"\x89MCAP0\r\n"):
        from residual_mpc.logs.readers.recordings.mcap_file import open_mcap

        return open_mcap(path)
    return _open_bag(path)


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Turn any exception of a library that reads a file of unknown content into BadInput."""
    try:
        yield
    except BadInput:
        raise
    except OSError as fault:
        raise BadInput(f"cannot be read ({fault.strerror or first_line(fault)})", str(path)) from fault
    except Exception as fault:
        what = f"the recording is damaged ({first_line(fault)})"
        raise BadInput(what, str(path), "record it again, or repair it (`ros2 bag reindex`, `mcap recover`)") from fault


def _begins(path: Path, magic: bytes) -> bool:
    with readable(path), open(path, "rb") as file:
        return file.read(len(magic)) == magic


def _open_bag(path: Path) -> Source:
    with readable(path), _reader(path) as reader:
        topics: dict[str, Topic] = {}
        encoding = "ros1" if path.suffix == ".bag" else "cdr"
        for each in reader.connections:
            before = topics.get(each.topic)
            count = each.msgcount + (before.count if before else 0)
            language = each.msgdef.format.name.lower()
            definition = each.msgdef.data if language in ("msg", "idl") else ""
            topics[each.topic] = Topic(each.topic, each.msgtype, count, encoding, definition, language)

    def messages(names: Collection[str]) -> Iterator[RawMessage]:
        with readable(path), _reader(path) as reader:
            wanted = [c for c in reader.connections if c.topic in names]
            if wanted:  # without any the library would read all
                for each, stamp, raw in reader.messages(wanted):
                    yield each.topic, stamp, raw

    return Source(path, topics, messages)


def _reader(path: Path) -> Any:
    with extra("rosbag"):
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2
    return Reader1(path) if path.suffix == ".bag" else Reader2(path)
