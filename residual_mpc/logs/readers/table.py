"""The common form of every format: a header that names the columns, and the columns, read when they are needed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from residual_mpc.errors import BadInput
from residual_mpc.logs.finding import Severity


@dataclass(frozen=True)
class Remark:
    """A finding about a table before its runs have names; the fields are those of `Finding`."""

    severity: Severity
    kind: str
    column: str
    message: str
    remedy: str = ""


@dataclass(frozen=True)
class Table:
    """The rows.

    Attributes:
        columns: by name, as Arrow arrays of one length.
        warnings: what was corrected while reading.
        faults: column that cannot be read -> reason.
        remarks: further findings.
    """

    columns: dict[str, Any]
    warnings: tuple[str, ...] = ()
    faults: Mapping[str, str] = field(default_factory=dict)
    remarks: tuple[Remark, ...] = ()


@dataclass(frozen=True, eq=False)
class Header:
    """What a table says about itself before its rows are read.

    Attributes:
        path: the file, or the folder of a recording.
        names: its columns, in order, without duplicates; a list column is replaced by its elements.
        size: estimated memory of all columns as numbers, bytes.
        read: the named columns; raises BadInput for damaged files and rows that do not fit the header.
        label: the run, in a file that holds several; else empty.
        note: how its list columns were split, empty without any.
        meanings: column -> name of the log format, if the file's format defines it. Several columns may have one
            meaning.
        preferred: name of the log format -> the one column that stands for it where [log] says nothing.
        topics: column -> topic, in a recording, where each topic has rows of its own; empty for a plain table.
        topic_rows: topic -> its rows.
        unit: of the column `t`, if the format fixes it.
        remarks: findings about the file.
    """

    path: Path
    names: tuple[str, ...]
    size: float
    read: Callable[[Sequence[str]], Table]
    label: str = ""
    note: str = ""
    meanings: Mapping[str, str] = field(default_factory=dict)
    preferred: Mapping[str, str] = field(default_factory=dict)
    topics: Mapping[str, str] = field(default_factory=dict)
    topic_rows: Mapping[str, int] = field(default_factory=dict)
    unit: Literal["s", "ns"] | None = None
    remarks: tuple[Remark, ...] = ()

    def __post_init__(self) -> None:
        twins = [name for name, count in Counter(self.names).items() if count > 1]
        if twins:
            raise BadInput(f"column {twins[0]!r} appears twice in the header", str(self.path), "rename one of them")

    @property
    def where(self) -> str:
        """The table, for messages."""
        return f"{self.path}, run {self.label}" if self.label else str(self.path)

    def bytes_of(self, columns: Collection[str]) -> float:
        """The part of `size` that these columns take."""
        share = len(columns) / max(1, len(self.names))
        if self.topic_rows:
            there = {self.topics[name] for name in columns if name in self.topics}
            share *= sum(self.topic_rows[topic] for topic in there) / max(1, sum(self.topic_rows.values()))
        return self.size * share


def first_line(fault: BaseException) -> str:
    """A library's message, shortened."""
    return (str(fault).splitlines() or [type(fault).__name__])[0][:200]
