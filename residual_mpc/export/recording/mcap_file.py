"""A run as an MCAP file of JSON messages, one topic a kind, which Foxglove plots without a converter.

A field's path in the message is the column's name: `/measured.pose.x`. https://mcap.dev/spec/registry names the
encodings `json` and `jsonschema`.
"""

import io
import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from residual_mpc.export.recording.recording import Recording
from residual_mpc.export.recording.trace import Array, Columns, Trace
from residual_mpc.extras import extra

SUFFIX = ".mcap"
NANO = 1e9
TIME = "s from the run's start"
Message = tuple[float, dict[str, Any]]  # s from the run's start, content


def mcap_bytes(recording: Recording, trace: Trace) -> bytes:
    """The whole file. Raises BadInput where the package mcap is missing."""
    with extra("mcap"):
        from mcap.writer import Writer
    out = io.BytesIO()
    writer = Writer(out)
    writer.start(library="residual-mpc")
    writer.add_metadata("residual_mpc", dict(recording.notes(trace)))
    begin = round(max(trace.start, 0.0) * NANO)  # MCAP counts from 0 up
    messages = []
    for topic, schema, content in _topics(recording, trace):
        text = json.dumps(schema).encode()
        number = writer.register_schema(f"residual_mpc{topic.replace('/', '.')}", "jsonschema", text)
        channel = writer.register_channel(topic, "json", number)
        messages += [(begin + round(t * NANO), channel, message) for t, message in content]
    for stamp, channel, message in sorted(messages, key=lambda m: m[:2]):
        writer.add_message(channel, stamp, json.dumps(message, allow_nan=False).encode(), stamp)
    writer.finish()
    return out.getvalue()


def _topics(recording: Recording, trace: Trace) -> Iterator[tuple[str, dict[str, Any], Iterable[Message]]]:
    """Topic, JSON schema and messages."""
    none = np.zeros(0)
    yield "/measured", _schema(trace.measured), _rows(trace.t, trace.measured)
    yield "/command", _schema(trace.sent), _rows(trace.t, trace.sent)
    for topic, columns in (("/nominal", trace.nominal), ("/corrected", trace.corrected)):
        shown = {c: columns.get(c, none) for c in trace.channels}
        yield topic, _schema(shown, "window"), _rows(trace.at, shown, window=trace.window)
    w = trace.windows
    floor = np.full(len(w.start), recording.noise_floor)
    gaps = {"until": w.end, "nominal": w.nominal, "corrected": w.corrected, "noise_floor": floor}
    yield "/gap", _schema(gaps), _rows(w.start, gaps)


def _rows(t: Array, columns: Columns, window: Array | None = None) -> Iterator[Message]:
    """One message a row in which something is known. A number that is missing or not finite is left out."""
    paths = [(c.split(".", 1), y, np.isfinite(y)) for c, y in columns.items()]
    for k in range(len(t)):
        fields: dict[str, Any] = {}
        for path, y, known in paths:
            if known[k]:
                inner = fields.setdefault(path[0], {}) if len(path) > 1 else fields
                inner[path[-1]] = float(y[k])
        if fields:
            index = {} if window is None else {"window": int(window[k])}
            yield float(t[k]), {"t": float(t[k]), **index, **fields}


def _schema(columns: Columns, *integers: str) -> dict[str, Any]:
    """The JSON schema of the messages of `_rows`."""
    number: Mapping[str, Any] = {"type": "number"}
    fields: dict[str, Any] = {"t": {**number, "description": TIME}}
    fields |= {name: {"type": "integer"} for name in integers}
    for column in columns:
        head, _, tail = column.partition(".")
        if tail:
            fields.setdefault(head, {"type": "object", "properties": {}})["properties"][tail] = dict(number)
        else:
            fields[head] = dict(number)
    return {"type": "object", "properties": fields}
