"""Run tables from files: read, checked cell by cell, put in order, and named as the log format names them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.logs.clock import Stamps, count_from_start
from residual_mpc.logs.columns import PER_ACTUATOR, PER_BODY, PER_JOINT, group, is_measured, likely_run, likely_time
from residual_mpc.logs.finding import Finding, Severity, rows_were
from residual_mpc.logs.readers.body_velocity import as_wheel_speeds, said_of_wheel_speeds
from residual_mpc.logs.readers.find import find_tables
from residual_mpc.logs.readers.headers import read_headers
from residual_mpc.logs.readers.layout import ColumnNames, Layout, check_log, lay_out, recognised, worth_reading
from residual_mpc.logs.readers.orientation import as_heading
from residual_mpc.logs.readers.pieces import Piece, pieces_of, unique_names
from residual_mpc.logs.readers.remarks import gathered, remarks_on_columns
from residual_mpc.logs.readers.stamps import CLASHES, Order, order_rows
from residual_mpc.logs.readers.table import Header, Remark
from residual_mpc.logs.run import FloatArray, Run

CHOICE = "several topics"  # the kind of remark on a choice that [log] has to make
MEMORY_LIMIT = 2 << 30  # bytes of numbers in one call
BRIEF = 1.0  # s without a command, up to which nobody has to look


@dataclass(frozen=True)
class ReadResult:
    """The runs of a call, in the order of their files, and what was mended or noticed while reading."""

    runs: tuple[Run, ...]
    findings: tuple[Finding, ...]


def read_runs(paths: Sequence[Path | str], robot: ColumnNames, memory_limit: float = MEMORY_LIMIT) -> ReadResult:
    """Read runs from files and recordings, folders of them, or glob patterns.

    Args:
        paths: files, folders or patterns; a file that they mean twice is read once.
        robot: a robot file, whose [log] (of the variant that fits a run) names the columns.
        memory_limit: bytes of numbers up to which tables are read.

    Raises:
        BadInput: a table that cannot be used, with the file, the row and the column at fault.
    """
    headers = [header for path in find_tables(paths) for header in read_headers(path)]
    check_log(robot, [header.names for header in headers])
    pieces = [piece for header in _within(headers, robot, memory_limit) for piece in pieces_of(*header, robot)]
    runs, findings = [], []
    for name, piece in zip(unique_names(pieces), pieces, strict=True):
        run, seen = _read_run(name, piece, robot.log_of(name), robot.wheels_of(name))
        runs.append(run)
        findings.extend(seen)
    return ReadResult(tuple(runs), tuple(gathered(findings, len(runs))))


def _within(headers: Sequence[Header], robot: ColumnNames, limit: float) -> list[tuple[Header, tuple[str, ...]]]:
    """Each table with the columns to read: all, or where memory would not do, those that are needed."""
    wanted = [worth_reading(header, robot) for header in headers]
    if sum(h.bytes_of(n) for h, n in zip(headers, wanted, strict=True)) <= limit:
        return list(zip(headers, wanted, strict=True))
    needed = [tuple(n for n in h.names if n in recognised(h, robot)) for h in headers]
    size = sum(h.bytes_of(n) for h, n in zip(headers, needed, strict=True))
    if size > limit:
        largest = max(headers, key=lambda header: header.size)
        raise BadInput(
            f"the tables need about {size / 2**30:.3g} GiB of memory, more than the limit of {limit / 2**30:.3g} GiB",
            str(largest.path),
            "give fewer runs, split this file, subsample its rows,"
            " or keep only the columns that the robot needs (Parquet is smallest)",
        )
    return list(zip(headers, needed, strict=True))


def _stamps(piece: Piece, column: str) -> Stamps:
    whole = piece.whole.get(column)
    unit = "ns" if column in piece.dates else piece.header.unit if column == "t" else None
    return count_from_start(piece.cells[column][piece.rows], None if whole is None else whole[piece.rows], unit)


def _read_run(
    name: str, piece: Piece, log: Mapping[str, str], wheels: tuple[float, float] | None
) -> tuple[Run, list[Finding]]:
    where = f"{piece.header.path}" + (f", run {piece.label}" if piece.label else "")
    layout = lay_out(piece.header, log)
    open_choices = [r for r in piece.remarks if r.kind == CHOICE and r.column not in layout.columns]
    _check_columns(layout, where, open_choices)
    findings = [Finding("warning", "table format", name, "", None, text) for text in piece.warnings]
    findings += [
        Finding(r.severity, r.kind, name, r.column, None, r.message, r.remedy)
        for r in piece.remarks
        if r.kind != CHOICE or r in open_choices
    ]
    if piece.header.note:
        findings.append(Finding("info", "list columns", name, "", None, piece.header.note))
    stamps = _stamps(piece, layout.columns["t"])
    if layout.columns["t"] in piece.dates:
        text = "the time stamps are dates and were converted to seconds"
        findings.append(Finding("info", "stamps as dates", name, "t", None, text))
    elif stamps.unit == "ns" and piece.header.unit is None:
        text = "the time stamps are in nanoseconds and were converted to seconds"
        findings.append(Finding("info", "stamps in ns", name, "t", None, text))
    order = order_rows(stamps, where, _apart(layout), joined=bool(piece.header.topics))
    findings += [Finding("warning", kind, name, "t", None, text) for kind, text in order.warnings]
    columns = {
        key: order.apply(piece.cells[column][piece.rows])
        for key, column in layout.columns.items()
        if group(key) is not None
    }
    logged, columns = columns, as_wheel_speeds(as_heading(columns), wheels)
    findings += said_of_wheel_speeds(name, logged, columns, wheels)
    findings += _repeated(layout, piece, order, name, where)
    _check_values(columns, layout, where, open_choices)
    extra_columns = {key: order.apply(piece.cells[key][piece.rows]) for key in layout.extra if key in piece.cells}
    start = _first_command(columns)
    if start:
        seconds = float(order.t[start] - order.t[0])
        severity: Severity = "warning" if seconds > BRIEF else "info"
        text = f"{rows_were(start, f'before the first command ({seconds:.2g} s)')} dropped"
        findings.append(Finding(severity, "no command yet", name, "", 0, text))
    if start > len(order.t) - 2:
        what = "fewer than two rows remain after every actuator has received a command"
        raise BadInput(what, where, "leave the run out")
    run = Run(
        name,
        order.t[start:] - order.t[start],
        {key: _from_row(start, key, values) for key, values in columns.items()},
        layout.served_as_command,
        tuple(key for key in layout.extra if key in piece.cells or key not in piece.header.topics),
        {key: values[start:] for key, values in extra_columns.items()},
        str(piece.header.path),
        float(stamps.start + order.t[start]),
    )
    return run, findings + remarks_on_columns(run, layout, piece.left_out, piece.header.topics)


def _check_columns(layout: Layout, where: str, open_choices: Sequence[Remark]) -> None:
    here = [*layout.columns, *layout.extra]
    listed = ", ".join(here[:30]) + (", ..." if len(here) > 30 else "")
    if "t" not in layout.columns:
        likely = likely_time(here) or "the column's name"
        raise BadInput(
            f"column 't' (time stamps in s) is missing; the columns are {listed}",
            where,
            f'map it under [log] in the robot file: "t" = "{likely}"',
        )
    for wanted, example, found in (
        ("command", "command.<actuator>", [n for n in layout.columns if group(n) == "command"]),
        (
            "measured",
            "position.<joint>, velocity.<joint>, pose.x",
            [n for n in layout.columns if is_measured(n) and n not in layout.served_as_command],
        ),
    ):
        if not found:
            choice = next((r for r in open_choices if r.column.startswith(_groups(wanted))), None)
            if choice is not None:
                raise BadInput(choice.message, where, choice.remedy)
            raise BadInput(
                f"no {wanted} column ({example}) was found; the columns are {listed}",
                where,
                'map the columns under [log] in the robot file: "' + example.split(",")[0] + '" = "the column\'s name"',
            )


def _groups(wanted: str) -> tuple[str, ...]:
    return ("command",) if wanted == "command" else PER_JOINT + PER_BODY


def _apart(layout: Layout) -> str:
    """What would tell the runs of a table apart."""
    likely = None if "run" in layout.columns else likely_run(layout.extra)
    return "a column 'run'" if likely is None else f'"run" = "{likely}" under [log] in the robot file'


def _check_values(columns: dict[str, FloatArray], layout: Layout, where: str, open_choices: Sequence[Remark]) -> None:
    for name, values in columns.items():
        finite = np.isfinite(values)
        if group(name) == "command" and not finite.any():
            raise BadInput(
                f"command column {layout.columns.get(name, name)!r} has no values",
                where,
                "remove the column if the actuator was not driven, or fill in the commands that were sent",
            )
        if group(name) == "enabled" and not np.isin(values[finite], (0.0, 1.0)).all():
            odd = values[finite][~np.isin(values[finite], (0.0, 1.0))][0]
            raise BadInput(f"column {layout.columns.get(name, name)!r} must be 0 or 1, got {odd:g}", where)
    measured = [n for n in columns if is_measured(n) and n not in layout.served_as_command]
    if not any(np.isfinite(columns[n]).any() for n in measured):
        if open_choices:
            raise BadInput(open_choices[0].message, where, open_choices[0].remedy)
        what = f"none of the measured columns has any values ({', '.join(measured[:10])})"
        raise BadInput(what, where, "leave the run out")


def _repeated(layout: Layout, piece: Piece, order: Order, name: str, where: str) -> list[Finding]:
    """What became of rows with the stamp of the row before. They may share out the columns between them, as the topics
    of a robot do; where they contradict each other, the first value counts, and many contradictions mean that the
    stamps are too coarse."""
    repeated = len(order.rows) - len(order.first)
    if not repeated:
        return []
    data = [column for key, column in layout.columns.items() if group(key) is not None]
    clash = np.any([order.clashes(piece.cells[column][piece.rows]) for column in data], axis=0)
    if clash.sum() > CLASHES * len(order.rows):
        k = int(np.flatnonzero(clash)[0])
        raise BadInput(
            f"data row {piece.rows[order.rows[k]] + 1} has the same time stamp as the row before but other values,"
            f" as do {int(clash.sum())} of {len(order.rows)} rows",
            where,
            "write 't' with more digits (a 32-bit float is too coarse for the time of day),"
            " or distinguish the runs by a column 'run'",
        )
    text = f"{rows_were(repeated, 'with the previous time stamp')} merged with the row before"
    if not clash.any():
        return [Finding("info", "repeated stamps", name, "t", None, f"{text}: they fill each other's empty cells")]
    differ = f"{text}; {int(clash.sum())} of them held other values, which are left out"
    return [Finding("warning", "repeated stamps", name, "t", None, differ)]


def _first_command(columns: dict[str, FloatArray]) -> int:
    """The first sample at which every actuator has had a command."""
    commands = [values for name, values in columns.items() if group(name) == "command"]
    return max(int(np.flatnonzero(np.isfinite(values))[0]) for values in commands)


def _from_row(start: int, name: str, values: FloatArray) -> FloatArray:
    """A column from a row on; what was last sent to an actuator before is still held there."""
    rest = values[start:]
    before = values[:start][np.isfinite(values[:start])]
    if group(name) not in PER_ACTUATOR or np.isfinite(rest[0]) or not len(before):
        return rest
    return np.concatenate([before[-1:], rest[1:]])
