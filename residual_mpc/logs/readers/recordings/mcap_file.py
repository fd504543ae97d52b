"""A single MCAP file, with or without an index, complete or truncated."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import IO, Any

from residual_mpc.errors import BadInput
from residual_mpc.extras import extra
from residual_mpc.logs.readers.recordings.source import RawMessage, Source, Topic, readable

LANGUAGES = {"ros2msg": "msg", "ros1msg": "msg", "ros2idl": "idl"}


def open_mcap(path: Path) -> Source:
    """The topics of an MCAP file, from its summary or, without one, from all of its records.

    Raises:
        BadInput: a file without a single channel, or a package that is not installed.
    """
    with extra("mcap"):
        from mcap.exceptions import McapError
        from mcap.reader import make_reader
    summary = None
    with readable(path), open(path, "rb") as file:
        try:
            summary = make_reader(file).get_summary()
        except (McapError, ValueError, KeyError):  # it breaks off before its end
            pass
    if summary is not None and summary.statistics is not None and summary.chunk_indexes:
        counts = summary.statistics.channel_message_counts
        pairs = [(c, summary.schemas.get(c.schema_id), counts.get(c.id, 0)) for c in summary.channels.values()]
        return Source(path, _topics(pairs), lambda names: _indexed(path, names))
    return _scanned(path)


def _scanned(path: Path) -> Source:
    """The topics of a file without an index, which is read once to find them."""
    counts: Counter[int] = Counter()
    schemas: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    broken = False
    with readable(path), open(path, "rb") as file:
        for record in _records(file, path):
            kind = type(record).__name__
            if kind == "Message":
                counts[record.channel_id] += 1
            elif kind == "Schema":
                schemas[record.id] = record
            elif kind == "Channel":
                channels[record.id] = record
            elif kind == "Broken":
                broken = True
    if not channels:
        raise BadInput("the recording is damaged (no channel can be read)", str(path), "record it again")
    pairs = [(c, schemas.get(c.schema_id), counts[c.id]) for c in channels.values()]

    def messages(names: Collection[str]) -> Iterator[RawMessage]:
        wanted = {c.id: c.topic for c in channels.values() if c.topic in names}
        with readable(path), open(path, "rb") as file:
            for record in _records(file, path):
                if type(record).__name__ == "Message" and record.channel_id in wanted:
                    yield wanted[record.channel_id], record.log_time, record.data

    return Source(path, _topics(pairs), messages, broken)


class Broken:
    """Marks the end of the records of a truncated file."""


def _records(file: IO[bytes], path: Path) -> Iterator[Any]:
    """Every record up to the end, or up to the point where the file is damaged."""
    from mcap.stream_reader import StreamReader

    records = iter(StreamReader(file, record_size_limit=path.stat().st_size).records)
    while True:
        try:
            record = next(records)
        except StopIteration:
            return
        except Exception:  # a record that was cut or overwritten fails in any way
            yield Broken()
            return
        yield record


def _indexed(path: Path, names: Collection[str]) -> Iterator[RawMessage]:
    from mcap.reader import make_reader

    with readable(path), open(path, "rb") as file:
        # in the order of the file, one chunk in memory at a time; the stamps are sorted later
        for _, channel, message in make_reader(file).iter_messages(list(names), log_time_order=False):
            yield channel.topic, message.log_time, message.data


def _topics(pairs: list[tuple[Any, Any, int]]) -> dict[str, Topic]:
    topics: dict[str, Topic] = {}
    for channel, schema, count in pairs:
        before = topics.get(channel.topic)
        language = LANGUAGES.get(schema.encoding, "") if schema is not None else ""
        definition = schema.data.decode("utf-8", "replace") if language else ""
        topics[channel.topic] = Topic(
            channel.topic,
            schema.name if schema is not None else "",
            count + (before.count if before else 0),
            channel.message_encoding,
            definition,
            language,
        )
    return topics
