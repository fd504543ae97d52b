"""A recording as the header of a table: its columns are the fields of its topics."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from residual_mpc.errors import BadInput
from residual_mpc.logs.readers.recordings.messages import TYPES, Meaning, words_of
from residual_mpc.logs.readers.recordings.source import open_recording
from residual_mpc.logs.readers.recordings.streams import open_streams
from residual_mpc.logs.readers.recordings.table import read_columns
from residual_mpc.logs.readers.recordings.types import plain_name
from residual_mpc.logs.readers.table import Header, Remark

SHOWN = 30  # topics in a message


def recording_header(path: Path) -> Header:
    """The columns of a recording: `topic.field` for each field of the first messages of each topic.

    Raises:
        BadInput: a damaged recording, one without a topic that can be read, or a package that is not installed.
    """
    source = open_recording(path)
    streams, unread = open_streams(source)
    if not streams:
        here = ", ".join(f"{t.name} ({plain_name(t.kind)})" for t in list(source.topics.values())[:SHOWN])
        raise BadInput(
            f"no topic of this recording can be read; it holds {here or 'no topics'}",
            str(path),
            f"topics of these types are read: {', '.join(TYPES)}" if not unread else "; ".join(unread),
        )
    topics = {"t": "", **{column: stream.topic.name for stream in streams for column in stream.fields}}
    meanings = {
        column: meaning
        for stream in streams
        for column, (part, field) in stream.fields.items()
        if (meaning := stream.type.meaning(words_of(stream.topic.name), part, field)) is not None
    }
    preferred, remarks = _choose(meanings)
    remarks += [Remark("warning", "unread topic", "", text) for text in unread]
    if source.broken:
        text = "the recording is truncated; everything before the break is read"
        remarks.append(Remark("warning", "broken off", "", text))
    rows = {stream.topic.name: stream.topic.count for stream in streams}
    return Header(
        path,
        tuple(topics),
        8.0 * sum(rows.values()) * len(topics),
        partial(read_columns, source, streams),
        meanings={column: meaning.name for column, meaning in meanings.items()},
        preferred=preferred,
        topics={column: topic for column, topic in topics.items() if topic},
        topic_rows=rows,
        unit="ns",
        remarks=tuple(remarks),
    )


def _choose(meanings: Mapping[str, Meaning]) -> tuple[dict[str, str], list[Remark]]:
    """The column for each name of the log format, and a remark for each name with several equally good columns."""
    candidates: dict[str, list[str]] = {}
    for column, meaning in meanings.items():
        candidates.setdefault(meaning.name, []).append(column)
    preferred: dict[str, str] = {}
    remarks = []
    for name, columns in candidates.items():
        lowest = min(meanings[column].rank for column in columns)
        best = [column for column in columns if meanings[column].rank == lowest]
        if len(best) == 1:
            preferred[name] = best[0]
        else:
            text = f"{name} may be {' or '.join(best)}; none is used until the robot file chooses one"
            remarks.append(
                Remark("warning", "several topics", name, text, f'choose under [log]: "{name}" = "{best[0]}"')
            )
    return preferred, remarks
