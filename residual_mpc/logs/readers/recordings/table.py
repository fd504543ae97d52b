"""The columns of a recording: messages in one pass, numbers kept, topics joined on time."""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.logs.clock import IntArray
from residual_mpc.logs.readers.recordings.clocks import NO_STAMP, TopicClock, choose_clocks
from residual_mpc.logs.readers.recordings.messages import Sample
from residual_mpc.logs.readers.recordings.source import Source, readable
from residual_mpc.logs.readers.recordings.streams import Stream
from residual_mpc.logs.readers.table import Remark, Table
from residual_mpc.logs.run import FloatArray

LATEST = 2**63 - 1  # ns


@dataclass
class TopicSamples:
    """The numbers of those samples of a topic that have the same fields, in the order of the recording.

    Attributes:
        columns: one for each field.
        receive: time of receipt of each sample, ns. header: header stamp of each sample, ns; NO_STAMP without one.
        values: the fields of the first sample, then of the second, and so on.
    """

    columns: tuple[str, ...]
    receive: array[int] = field(default_factory=lambda: array("q"))
    header: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))


def read_columns(source: Source, streams: Sequence[Stream], columns: Sequence[str]) -> Table:
    """The named columns and `t` in ns: one row for each stamp of any of their topics, NaN where a topic has no sample.

    The recording is read once, message by message; only the numbers of the columns stay in memory.

    Raises:
        BadInput: a damaged recording, or one without messages.
    """
    wanted = frozenset(columns)
    needed = [stream for stream in streams if wanted & set(stream.fields)]
    kept, unknown = _collect(source, needed, wanted)
    kept = {key: samples for key, samples in kept.items() if len(samples.receive)}
    if not kept:
        raise BadInput("the topics that are needed have no messages", str(source.path), "record it again")
    receive = {key: np.frombuffer(s.receive, dtype=np.int64) for key, s in kept.items()}
    header = {key: np.frombuffer(s.header, dtype=np.int64) for key, s in kept.items()}
    clocks, remarks = choose_clocks({key: TopicClock(key[0], receive[key], header[key]) for key in kept})
    remarks += [
        Remark("warning", "late column", name, f"{name} first appears after {count} messages and is ignored")
        for name, count in unknown.items()
    ]
    remarks += _still_twists(kept)
    return Table(_joined(kept, clocks, columns), (), {}, tuple(remarks))


Key = tuple[str, tuple[str, ...]]  # topic, columns
Kept = dict[Key, TopicSamples]


def _collect(source: Source, streams: Sequence[Stream], wanted: frozenset[str]) -> tuple[Kept, dict[str, int]]:
    """The samples of all messages; and the fields that the header does not list, with the number of messages before
    the first that has them."""
    by_topic = {stream.topic.name: stream for stream in streams}
    known = {(s.topic.name, *place): column for s in streams for column, place in s.fields.items()}
    layouts: dict[tuple[str, ...], tuple[TopicSamples, list[str]]] = {}  # by topic, part and fields of a sample
    kept: Kept = {}
    unknown: dict[str, int] = {}
    for number, (topic, receive, raw) in enumerate(source.messages(list(by_topic))):
        stream = by_topic[topic]
        with readable(source.path):
            samples = [_checked(sample) for sample in stream.type.samples(stream.decode(raw))]
            if receive > LATEST:
                raise ValueError(f"a message was received at {receive} ns")
        for sample in samples:
            shape = (topic, sample.part, *sample.values)
            if shape not in layouts:
                places = {f: known.get((topic, sample.part, f)) for f in sample.values}
                for f, column in places.items():
                    if column is None:
                        unknown.setdefault(".".join(x for x in (topic, sample.part, f) if x), number)
                fields = [f for f, column in places.items() if column in wanted]
                names = tuple(str(places[f]) for f in fields)
                layouts[shape] = kept.setdefault((topic, names), TopicSamples(names)), fields
            into, fields = layouts[shape]
            if fields:
                into.receive.append(receive)
                into.header.append(NO_STAMP if sample.stamp is None else sample.stamp)
                into.values.extend(sample.values[f] for f in fields)
    return kept, unknown


def _checked(sample: Sample) -> Sample:
    """A sample whose stamp fits into 64 bits and whose values are numbers, which JSON does not guarantee.

    Raises:
        ValueError, TypeError: any other sample.
    """
    if sample.stamp is not None and abs(sample.stamp) > LATEST:
        raise ValueError(f"a header is stamped {sample.stamp} ns")
    return Sample(sample.stamp, sample.part, {field: float(x) for field, x in sample.values.items()})


def _joined(kept: Kept, clocks: Mapping[Key, IntArray], columns: Sequence[str]) -> dict[str, Any]:
    """The samples of all topics on the sorted stamps of all; of several samples of a topic at one stamp, the first."""
    import pyarrow as pa

    rows = np.unique(np.concatenate([stamps[stamps != NO_STAMP] for stamps in clocks.values()]))
    joined: dict[str, FloatArray] = {}
    for key, samples in kept.items():
        stamps = clocks[key]
        values = np.frombuffer(samples.values, dtype=np.float64).reshape(len(stamps), -1)
        mine = np.flatnonzero(stamps != NO_STAMP)[::-1]  # the first of a stamp is written last
        place = np.searchsorted(rows, stamps[mine])
        for j, name in enumerate(samples.columns):
            column = joined.setdefault(name, np.full(len(rows), np.nan))
            there = np.isfinite(values[mine, j])
            column[place[there]] = values[mine[there], j]
    arrays = {name: pa.array(values) for name, values in joined.items()}
    empty = pa.nulls(len(rows), pa.float64())
    return {name: pa.array(rows) if name == "t" else arrays.get(name, empty) for name in columns}


def _still_twists(kept: Kept) -> list[Remark]:
    """Set a twist to missing if it is zero throughout while the pose moves, since it was not measured."""
    remarks = []
    for (topic, names), samples in kept.items():
        twist = [j for j, name in enumerate(names) if name.startswith(f"{topic}.twist.")]
        values = np.frombuffer(samples.values, dtype=np.float64).reshape(len(samples.receive), -1)
        moved = [j for j, name in enumerate(names) if name.startswith(f"{topic}.pose.") and np.ptp(values[:, j]) > 0.0]
        if twist and moved and not values[:, twist].any():
            values[:, twist] = np.nan
            text = f"the twist of {topic} is zero throughout, although its pose moves; it is treated as not measured"
            remarks.append(Remark("info", "empty twist", "", text))
    return remarks
