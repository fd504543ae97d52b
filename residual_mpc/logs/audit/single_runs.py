"""A few runs with another unit, sign or order of columns than the rest: all runs together hide them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from residual_mpc.logs.audit.driving import check_driving
from residual_mpc.logs.audit.facts import RobotFacts
from residual_mpc.logs.audit.pairing import check_pairing
from residual_mpc.logs.audit.rates import check_rates
from residual_mpc.logs.columns import group
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import Run

MOST = 100  # runs that are looked at one by one: a mistake in one of more of them does little
KINDS = frozenset({"swapped channels", "swapped", "sign", "degrees", "rpm", "unit", "kind of drive"})


def check_single_runs(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    """What the columns of at most half of the runs say by themselves, and those of all runs together do not."""
    if not 1 < len(runs) <= MOST:
        return []
    each = [_wrong_columns([run], robot) for run in runs]
    if not any(each):
        return []
    together = {(f.kind, f.column) for f in _wrong_columns(runs, robot)}
    found: dict[tuple[str, str], list[tuple[Run, Finding]]] = {}
    for run, findings in zip(runs, each, strict=True):
        for f in findings:
            found.setdefault((f.kind, f.column), []).append((run, f))
    return [
        _in_some(some, len(runs)) for key, some in found.items() if key not in together and 2 * len(some) <= len(runs)
    ]


def _wrong_columns(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    checks = (check_pairing, check_rates, check_driving)
    return [f for check in checks for f in check(runs, robot) if f.kind in KINDS and not _weak(f)]


def _weak(found: Finding) -> bool:
    """A joint that moves against its command by a correlation that a single run with little motion may have."""
    return found.kind == "sign" and found.severity != "error" and group(found.column) in ("position", "velocity")


def _in_some(some: Sequence[tuple[Run, Finding]], count: int) -> Finding:
    """The finding of the first of these runs."""
    run, found = some[0]
    alone = len(some) == 1
    where = "this run alone" if alone else f"{len(some)} of {count} runs, this one first"
    which = "this run" if alone else "these runs"
    how = "exchange the two columns in its file" if found.kind.startswith("swapped") else found.remedy
    remedy = f"correct {which}, or leave {'it' if alone else 'them'} out: {how}"
    return replace(found, run=run.name, message=f"{found.message}, in {where}", remedy=remedy)
