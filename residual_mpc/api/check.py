"""Everything that the other functions would refuse or warn of, at once."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from residual_mpc.api.display import brief, page
from residual_mpc.api.robot import NominalRobot
from residual_mpc.api.run_models import RunModels
from residual_mpc.api.runs import Paths, Runs, listed
from residual_mpc.diagnosis.data.dataset import compared_channels
from residual_mpc.errors import BadInput
from residual_mpc.files import write_json
from residual_mpc.logs.audit import audit
from residual_mpc.logs.columns import group, member
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.mended import mended
from residual_mpc.logs.readers.find import find_tables
from residual_mpc.logs.readers.read import read_runs as read_tables
from residual_mpc.logs.run import Run
from residual_mpc.logs.signals import fresh_samples
from residual_mpc.models.facts import check_columns, facts_of
from residual_mpc.models.optional import held_joints
from residual_mpc.models.protocol import Robot
from residual_mpc.models.refuted import refuted_by
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.wheel_sizes import implausible_sizes
from residual_mpc.report.words.numbers import count

if TYPE_CHECKING:
    from pandas import DataFrame

LISTED = 40  # runs of one shape up to which each is listed; of more, the first FEW
FEW = 5
RANK = {"error": 0, "warning": 1, "info": 2}


@dataclass(frozen=True, eq=False)
class Check:
    """runs: one description a run, as `check --json` has it (s, Hz); findings: errors first."""

    runs: tuple[dict[str, Any], ...]
    findings: tuple[Finding, ...]

    @property
    def errors(self) -> tuple[Finding, ...]:
        return tuple(f for f in self.findings if f.severity == "error")

    @property
    def usable(self) -> bool:
        return not self.errors

    @property
    def document(self) -> dict[str, Any]:
        """What `check --json` prints."""
        return {"runs": list(self.runs), "findings": [asdict(f) for f in self.findings], "usable": self.usable}

    def to_frame(self) -> "DataFrame":
        """One row a finding."""
        import pandas as pd

        columns = ["severity", "kind", "run", "column", "row", "message", "remedy"]
        return pd.DataFrame([asdict(f) for f in self.findings], columns=columns)

    def save(self, file: str | Path) -> Path:
        """Write what `check --json` prints to a JSON file."""
        write_json(Path(file), self.document)
        return Path(file)

    def lines(self) -> list[str]:
        """The runs, the findings and the verdict in words."""
        out = [*_run_lines(self.runs), *_finding_lines(self.findings)]
        if self.usable:
            warned = sum(f.severity == "warning" for f in self.findings)
            out.append("usable" if not warned else f"usable, with {count(warned, 'warning')} to review")
        return out

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def __repr__(self) -> str:
        return brief(self, str(self))

    def _repr_html_(self) -> str:
        return page(self.lines())


def check(robot: NominalRobot, runs: Runs | Paths) -> Check:
    """Audit runs against the robot and each other.

    Args:
        runs: what `read_runs` gave, or paths: then tables that cannot be read are findings too, so that one fault does
            not hide the next.
    """
    if isinstance(runs, Runs):
        read, findings = runs.runs, list(runs.findings)
    else:
        read, findings = _examine(robot, listed(runs))
    described = tuple(_described(run, robot.model) for run in read)
    return Check(described, tuple(sorted(findings, key=lambda f: RANK[f.severity])))


def _examine(robot: NominalRobot, paths: Sequence[str]) -> tuple[tuple[Run, ...], list[Finding]]:
    """The runs that can be read, and what is wrong or remarkable."""
    read, findings = _read(robot.file, paths)
    models, fitting = RunModels(robot), []
    read, mends = mended(read, [_channels(models, run.name) for run in read])
    findings += [*mends, *implausible_sizes(robot.file, [run.name for run in read])]
    for run in read:
        try:
            check_columns([run], [models.of(run.name)])
            fitting.append(run)
        except BadInput as fault:
            findings.append(_fault("columns", run.name, fault))
    if fitting:
        findings += [overlap.finding() for overlap in refuted_by(robot.model, fitting).overlaps]
        findings += audit(fitting, facts_of(robot.model))
    return read, findings


def _channels(models: RunModels, run: str) -> tuple[str, ...]:
    """Those that the run's model predicts; none where its variant cannot be built, which the columns' check says."""
    try:
        return tuple(models.of(run).channels)
    except BadInput:
        return ()


def _read(robot_file: RobotFile, paths: Sequence[str]) -> tuple[tuple[Run, ...], list[Finding]]:
    """All runs at once; where that fails, each table on its own, to find every one that is at fault."""
    try:
        result = read_tables(paths, robot_file)
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
                read_tables([table], robot_file)
                good.append(table)
            except BadInput as fault:
                faults.append(_fault("table", "", fault))
    faults = list(dict.fromkeys(faults))  # one of the robot file is found with every table
    if not faults:  # each is sound alone: the fault is in their being together
        return (), [_fault("table", "", whole)]
    if not good:
        return (), faults
    result = read_tables(good, robot_file)
    return result.runs, [*faults, *result.findings]


def _fault(kind: str, run: str, fault: BadInput) -> Finding:
    return Finding("error", kind, run or fault.where, "", None, fault.what, fault.remedy)


def _described(run: Run, model: Robot) -> dict[str, Any]:
    """One run, s and Hz; `start` is what the log's own clock showed at t = 0.

    A channel's rate counts neither missing nor repeated samples.
    """
    known = [c for c in run.measured if c in model.channels]
    channels = {}
    for c in known:
        there = np.isfinite(run.columns[c])
        fresh = fresh_samples(run.columns[c][there])
        channels[c] = {
            "rate": float(fresh.sum()) / len(run.sampled) / run.period,
            "missing": float(1.0 - there.mean()),
        }
    return {
        "run": run.name,
        "source": run.source,
        "start": run.start,
        "samples": len(run.t),
        "seconds": float(run.t[-1] - run.t[0]),
        "rate": 1.0 / run.period,
        "commands": [c for c in run.columns if group(c) == "command" and member(c) in model.actuators],
        "enabled": [c for c in run.columns if group(c) == "enabled"],
        "channels": channels,
        "compared": list(compared_channels(known, known, held_joints(model))),
        "unused": [c for c in run.measured if c not in model.channels] + list(run.extra),
    }


def _run_lines(described: Sequence[dict[str, Any]]) -> list[str]:
    shapes: dict[tuple[tuple[str, ...], ...], list[dict[str, Any]]] = {}
    for d in described:
        key = tuple(tuple(d[k]) for k in ("commands", "enabled", "channels", "compared", "unused"))
        shapes.setdefault(key, []).append(d)
    out = []
    for (commands, enabled, channels, compared, unused), runs in shapes.items():
        total = sum(d["seconds"] for d in runs)
        out.append(f"{count(len(runs), 'run')}, {total:.4g} s in total")
        for d in runs if len(runs) <= LISTED else runs[:FEW]:
            size = f"{d['seconds']:8.2f} s  {d['samples']:7d} samples  {d['rate']:7.1f} Hz"
            out.append(f"  {d['run']:<28} {size}")
        if len(runs) > LISTED:
            rates = [d["rate"] for d in runs]
            rest = len(runs) - FEW
            out.append(f"  and {rest} more; sampling rates from {min(rates):.1f} to {max(rates):.1f} Hz")
        other = [c for c in channels if c not in compared]
        for label, names in (
            ("commands", commands),
            ("motor switches", enabled),
            ("compared", compared),
            ("also measured", other),
            ("not in the model", unused),
        ):
            if names:
                out.append(f"  {label}: {', '.join(names)}")
    return out


def _finding_lines(findings: Sequence[Finding]) -> list[str]:
    """Each finding once: those that differ in the run alone share a line."""
    alike: dict[tuple[str, str, str, str], list[str]] = {}
    for f in findings:
        if f.kind != "unknown column":  # the runs' own lines list these
            alike.setdefault((f.severity, f.about, f.message, f.remedy), []).append(f.run)
    out = []
    for (severity, about, message, remedy), runs in alike.items():
        named = [r for r in runs if r]
        run = f"{named[0]} and {count(len(named) - 1, 'more run')}" if len(named) > 1 else "".join(named)
        where = "".join(f"{x}: " for x in (run, about) if x)
        mend = f" -> {remedy}" if remedy else ""
        out.append(f"{severity}: {where}{message}{mend}")
    return out
