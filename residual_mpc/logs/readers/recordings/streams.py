"""The topics of a recording whose messages can be read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice

from residual_mpc.logs.readers.recordings.messages import TYPES, MessageType, Sample
from residual_mpc.logs.readers.recordings.source import Source, Topic, readable
from residual_mpc.logs.readers.recordings.types import Decode, decoder, plain_name

FIRST = 200  # messages of a topic that determine its columns
STILL = "/tf_static"  # constant transforms, which are not read


@dataclass(frozen=True)
class Stream:
    """A topic whose messages can be read.

    Attributes:
        topic: as recorded.
        type: what its messages hold.
        decode: decodes the bytes of a message.
        fields: column -> (part, field) of the samples.
    """

    topic: Topic
    type: MessageType
    decode: Decode
    fields: Mapping[str, tuple[str, str]]


def open_streams(source: Source) -> tuple[list[Stream], list[str]]:
    """The topics that can be read, and the reasons why others of a known type cannot."""
    streams, unread = [], []
    for topic in source.topics.values():
        type = TYPES.get(plain_name(topic.kind))
        if type is None or topic.name == STILL:
            continue
        with readable(source.path):
            first = [raw for _, _, raw in islice(source.messages([topic.name]), FIRST)]
        if not first:
            continue
        with readable(source.path):
            decode = decoder(topic.kind, topic.encoding, topic.definition, topic.language, first[0])
        if decode is None:
            unread.append(
                f"topic {topic.name}: messages of {topic.kind} in the encoding {topic.encoding!r} cannot be read"
                + ("" if topic.definition else ", since the recording does not define the type")
            )
            continue
        fields: dict[str, tuple[str, str]] = {}
        for sample in _samples(source, type, decode, first):
            head = f"{topic.name}.{sample.part}." if sample.part else f"{topic.name}."
            fields.update({head + field: (sample.part, field) for field in sample.values})
        if fields:
            streams.append(Stream(topic, type, decode, fields))
    return streams, unread


def _samples(source: Source, type: MessageType, decode: Decode, raws: list[bytes]) -> Iterator[Sample]:
    with readable(source.path):
        for raw in raws:
            yield from type.samples(decode(raw))
