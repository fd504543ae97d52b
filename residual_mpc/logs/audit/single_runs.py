"""Some runs with another unit, sign or order of columns than the rest: all runs together hide them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from residual_mpc.logs.audit.driving import check_driving
from residual_mpc.logs.audit.facts import RobotFacts
from residual_mpc.logs.audit.pairing import check_pairing
from residual_mpc.logs.audit.rates import check_rates
from residual_mpc.logs.audit.values import check_values
from residual_mpc.logs.columns import group
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import Run

MOST = 100  # runs that are looked at one by one: among more of them, one bad run hardly matters
KINDS = frozenset({"swapped channels", "swapped", "sign", "degrees", "rpm", "unit", "kind of drive"})


def check_single_runs(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    """Column mistakes that runs show by themselves, and all runs together do not."""
    if not 1 < len(runs) <= MOST:
        return []
    each = [_wrong_columns([run], robot) for run in runs]
    if not any(each):
        return []
    told = {(f.kind, f.column) for f in (*_wrong_columns(runs, robot), *check_values(runs, robot))}
    found: dict[tuple[str, str], dict[str, Finding]] = {}
    for run, findings in zip(runs, each, strict=True):
        for f in findings:
            found.setdefault((f.kind, f.column), {}).setdefault(run.name, f)
    return [_in_some(some, len(runs)) for key, some in found.items() if key not in told]


def _wrong_columns(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    checks = (check_pairing, check_rates, check_driving)
    return [f for check in checks for f in check(runs, robot) if f.kind in KINDS and not _weak(f)]


def _weak(found: Finding) -> bool:
    """A reversed sign that is too uncertain to trust in one short run."""
    return found.kind == "sign" and found.severity != "error" and group(found.column) in ("position", "velocity")


def _in_some(some: dict[str, Finding], count: int) -> Finding:
    """The finding of the first of these runs, by name."""
    run, found = next(iter(some.items()))
    alone = len(some) == 1
    where = "only in this run" if alone else f"in {len(some)} of {count} runs, this one first"
    files = "its file" if alone else "each of their files"
    how = f"exchange the two columns in {files}" if found.kind.startswith("swapped") else found.remedy
    which, them = ("this run", "it") if alone else ("these runs", "them")
    return replace(
        found, run=run, message=f"{found.message} ({where})", remedy=f"correct {which}, or leave {them} out: {how}"
    )
