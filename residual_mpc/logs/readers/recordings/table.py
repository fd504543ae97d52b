"""The columns of a recording: messages in one pass, numbers kept, topics joined on time."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.logs.clock import IntArray
from residual_mpc.logs.readers.recordings.clocks import NO_STAMP, Clock, choose_clocks
from residual_mpc.logs.readers.recordings.source import Source, readable
from residual_mpc.logs.readers.recordings.streams import Stream
from residual_mpc.logs.readers.table import Remark, Table
from residual_mpc.logs.run import FloatArray

LATEST = 2**63 - 1  # ns


@dataclass
class Samples:
    """The numbers of one kind of sample of one topic, as they come: fields are what all of them have.

    Attributes:
        columns: of the fields.
        receive: ns, when each was received. header: ns, the stamp of its header, NO_STAMP without one.
        values: of the fields of one sample after the other.
    """

    columns: tuple[str, ...]
    receive: array[int] = field(default_factory=lambda: array("q"))
    header: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))


def read_columns(source: Source, streams: Sequence[Stream], columns: Sequence[str]) -> Table:
    """The named columns, and `t` in ns: a row for each stamp that any of their topics has, NaN where a topic has none
    then.

    The recording is read once, message by message; what stays in memory are the columns' own numbers.

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
    clocks, remarks = choose_clocks({key: Clock(key[0], receive[key], header[key]) for key in kept})
    remarks += [
        Remark("warning", "late column", name, f"{name} first appears after {count} messages and is not read")
        for name, count in unknown.items()
    ]
    remarks += _still_twists(kept)
    return Table(_joined(kept, clocks, columns), (), {}, tuple(remarks))


Kept = dict[tuple[str, tuple[str, ...]], Samples]  # by topic and columns


def _collect(source: Source, streams: Sequence[Stream], wanted: frozenset[str]) -> tuple[Kept, dict[str, int]]:
    """The samples of all messages, and fields that the header does not know, with the messages before their first."""
    by_topic = {stream.topic.name: stream for stream in streams}
    known = {(s.topic.name, *place): column for s in streams for column, place in s.fields.items()}
    layouts: dict[tuple[Any, ...], tuple[Samples, list[str]]] = {}  # by topic, part and fields of a sample
    kept: Kept = {}
    unknown: dict[str, int] = {}
    for number, (topic, receive, raw) in enumerate(source.messages(list(by_topic))):
        stream = by_topic[topic]
        with readable(source.path):
            samples = list(stream.type.samples(stream.decode(raw)))
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
                layouts[shape] = kept.setdefault((topic, names), Samples(names)), fields
            into, fields = layouts[shape]
            if fields:
                into.receive.append(receive)
                into.header.append(NO_STAMP if sample.stamp is None else sample.stamp)
                into.values.extend(sample.values[f] for f in fields)
    return kept, unknown


def _joined(kept: Kept, clocks: dict[Any, IntArray], columns: Sequence[str]) -> dict[str, Any]:
    """All samples on the stamps of all, which increase; of samples of one topic and stamp the first is taken."""
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
    """Makes the samples of a twist missing that stays at zero while the pose moves: nobody measures it."""
    remarks = []
    for (topic, names), samples in kept.items():
        twist = [j for j, name in enumerate(names) if name.startswith(f"{topic}.twist.")]
        values = np.frombuffer(samples.values, dtype=np.float64).reshape(len(samples.receive), -1)
        moved = [j for j, name in enumerate(names) if name.startswith(f"{topic}.pose.") and np.ptp(values[:, j]) > 0.0]
        if twist and moved and not values[:, twist].any():
            values[:, twist] = np.nan
            text = f"the twist of {topic} is zero throughout, although its pose moves; it is taken as not measured"
            remarks.append(Remark("info", "empty twist", "", text))
    return remarks
