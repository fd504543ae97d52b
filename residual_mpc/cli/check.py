"""`residual-mpc check`: everything that `load` would refuse or warn of, listed at once."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from residual_mpc.cli.common import (
    allow_user_modules,
    emit,
    json_option,
    robot_option,
    runs_argument,
    seed_option,
)
from residual_mpc.errors import BadInput

if TYPE_CHECKING:
    from residual_mpc.logs.finding import Finding
    from residual_mpc.logs.run import Run
    from residual_mpc.models.protocol import Robot
    from residual_mpc.models.robot_file import RobotFile

LISTED = 40  # runs of one shape up to which each is listed; of more, the first FEW
FEW = 5


@click.command()
@robot_option
@runs_argument
@json_option
@seed_option
def check(robot: str, runs: tuple[str, ...], as_json: bool, seed: int) -> None:
    """Audit the runs against the robot and each other, and say what to mend before anything is fitted.

    Exit status 2 where the runs cannot be used as they are.
    """
    from residual_mpc.models.load import load_robot
    from residual_mpc.models.robot_file import read_robot_file

    allow_user_modules()
    robot_file = read_robot_file(robot)
    model = load_robot(robot_file)
    read, findings = _examine(robot_file, model, runs)
    errors = [f for f in findings if f.severity == "error"]
    described = [_described(run, model) for run in read]
    if as_json:
        emit({"runs": described, "findings": [asdict(f) for f in findings], "usable": not errors})
    else:
        _print_runs(described)
        _print_findings(findings)
        if not errors:
            warned = sum(f.severity == "warning" for f in findings)
            click.echo("usable" if not warned else f"usable, with {_count(warned, 'warning')} to look at first")
    if errors:
        first = errors[0]
        where = ", ".join(x for x in (first.run, first.column) if x)
        raise BadInput(
            f"{_count(len(errors), 'error')} to mend before these can be used; the first: {first.message}",
            where,
            first.remedy,
        )


def _examine(
    robot_file: "RobotFile", model: "Robot", paths: Sequence[str]
) -> "tuple[tuple[Run, ...], tuple[Finding, ...]]":
    """The runs that can be read, and what is wrong or remarkable, errors first.

    A table that cannot be read or does not fit is a finding too, so that one fault does not hide the next.
    """
    from residual_mpc.logs.audit import audit
    from residual_mpc.models.facts import check_columns, facts_of
    from residual_mpc.models.load import load_robot
    from residual_mpc.models.robot_file import for_run

    read, findings = _read(robot_file, paths)
    built: dict[object, Robot] = {(robot_file.plant, robot_file.model): model}
    fitting = []
    for run in read:
        mine = for_run(robot_file, run.name)
        key = (mine.plant, mine.model)
        try:
            if key not in built:
                built[key] = load_robot(mine)
            check_columns([run], [built[key]])
            fitting.append(run)
        except BadInput as fault:
            findings.append(_fault("columns", run.name, fault))
    if fitting:
        findings += audit(fitting, facts_of(model))
    rank = {"error": 0, "warning": 1, "info": 2}
    return read, tuple(sorted(findings, key=lambda f: rank[f.severity]))


def _read(robot_file: "RobotFile", paths: Sequence[str]) -> "tuple[tuple[Run, ...], list[Finding]]":
    """All runs at once; where that fails, each table on its own, to find every one that is at fault."""
    from residual_mpc.logs.find import find_tables
    from residual_mpc.logs.read import read_runs

    try:
        result = read_runs(paths, robot_file)
        return result.runs, list(result.findings)
    except BadInput as fault:
        whole = fault
    faults, good = [], []
    for path in paths:
        try:
            tables = find_tables([path])
        except BadInput as fault:
            faults.append(_fault("file", "", fault))
            continue
        for table in tables:
            try:
                read_runs([table], robot_file)
                good.append(table)
            except BadInput as fault:
                faults.append(_fault("table", "", fault))
    if not faults:  # each is sound alone: the fault is in their being together
        return (), [_fault("table", "", whole)]
    if not good:
        return (), faults
    result = read_runs(good, robot_file)
    return result.runs, [*faults, *result.findings]


def _fault(kind: str, run: str, fault: BadInput) -> "Finding":
    from residual_mpc.logs.finding import Finding

    return Finding("error", kind, run or fault.where, "", None, fault.what, fault.remedy)


def _described(run: "Run", model: "Robot") -> dict[str, Any]:
    """One run as `--json` has it: s and Hz; `start` is what the log's own clock showed at t = 0.

    A channel's rate counts neither missing nor repeated samples.
    """
    import numpy as np

    from residual_mpc.diagnosis.dataset import compared_channels
    from residual_mpc.logs.columns import group, member
    from residual_mpc.logs.signals import fresh_samples

    known = [c for c in run.measured if c in model.channels]
    seconds = float(run.t[-1] - run.t[0])
    channels = {}
    for c in known:
        there = np.isfinite(run.columns[c])
        fresh = fresh_samples(run.columns[c][there])
        channels[c] = {
            "rate": float(fresh.sum()) / len(run.t) / run.period,
            "missing": float(1.0 - there.mean()),
        }
    return {
        "run": run.name,
        "source": run.source,
        "start": run.start,
        "samples": len(run.t),
        "seconds": seconds,
        "rate": 1.0 / run.period,
        "commands": [c for c in run.columns if group(c) == "command" and member(c) in model.actuators],
        "enabled": [c for c in run.columns if group(c) == "enabled"],
        "channels": channels,
        "compared": list(compared_channels(known, known)),
        "unused": [c for c in run.measured if c not in model.channels] + list(run.extra),
    }


def _print_runs(described: list[dict[str, Any]]) -> None:
    shapes: dict[tuple[tuple[str, ...], ...], list[dict[str, Any]]] = {}
    for d in described:
        key = tuple(tuple(d[k]) for k in ("commands", "enabled", "channels", "compared", "unused"))
        shapes.setdefault(key, []).append(d)
    for (commands, enabled, channels, compared, unused), runs in shapes.items():
        total = sum(d["seconds"] for d in runs)
        click.echo(f"{_count(len(runs), 'run')}, {total:.4g} s in all")
        for d in runs if len(runs) <= LISTED else runs[:FEW]:
            size = f"{d['seconds']:8.2f} s  {d['samples']:7d} samples  {d['rate']:7.1f} Hz"
            click.echo(f"  {d['run']:<28} {size}")
        if len(runs) > LISTED:
            rates = [d["rate"] for d in runs]
            rest = len(runs) - FEW
            click.echo(f"  and {rest} more; the table rates run from {min(rates):.1f} to {max(rates):.1f} Hz")
        other = [c for c in channels if c not in compared]
        for label, names in (
            ("commands", commands),
            ("motor switches", enabled),
            ("compared", compared),
            ("also measured", other),
            ("beside these", unused),
        ):
            if names:
                click.echo(f"  {label}: {', '.join(names)}")


def _print_findings(findings: "Sequence[Finding]") -> None:
    """Each finding once: those that differ in the run alone share a line."""
    alike: dict[tuple[str, str, str, str], list[str]] = {}
    for f in findings:
        if f.kind != "unknown column":  # the runs' own lines list these
            alike.setdefault((f.severity, f.column, f.message, f.remedy), []).append(f.run)
    for (severity, column, message, remedy), runs in alike.items():
        named = [r for r in runs if r]
        run = f"{named[0]} and {len(named) - 1} more runs" if len(named) > 1 else "".join(named)
        about = "" if column in message else column  # most messages begin with the column
        where = "".join(f"{x}: " for x in (run, about) if x)
        mend = f" -> {remedy}" if remedy else ""
        click.echo(f"{severity}: {where}{message}{mend}")


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"
