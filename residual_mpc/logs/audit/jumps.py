"""Samples that lie off their channel's curve: values that jump away, or stamps that are late."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from residual_mpc.logs.audit.facts import RobotFacts
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.jumps import Jumps, find_jumps, spikes
from residual_mpc.logs.run import Run
from residual_mpc.logs.signals import continuous, noise_sigma

MANY_SPIKES = 0.005  # share of the samples of all runs
FEW_LATE = 5  # late stamps, and their share of a run's samples, below which nothing is said
LATE = 0.002
AGREEING = 0.8  # share of them that are late and not early
NAMED = 3  # runs
FOLLOWS = 2  # samples within which a speed follows its command


def check_jumps(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    """Every column that the robot has over all runs, and the stamps of each run by all its columns."""
    names = dict.fromkeys(name for run in runs for name in run.measured if name in robot.channels)
    found = [_jumps_of(run, [n for n in names if n in run.measured], robot) for run in runs]
    findings = [finding for name in names for finding in _spikes(name, runs, found)]
    return findings + [finding for run, jumps in zip(runs, found, strict=True) for finding in _late(run, jumps)]


def _jumps_of(run: Run, names: Sequence[str], robot: RobotFacts) -> dict[str, Jumps]:
    """The jumps of these columns, without outliers of a speed that follow a short pulse of its own command."""
    drives = {f"velocity.{a.joint}": f"command.{a.name}" for a in robot.actuators}
    out = {}
    for name in names:
        y = continuous(name, run.columns[name])
        jumps = find_jumps(run.t, y, noise_sigma(run.t, y))
        command = run.columns.get(drives.get(name, ""))
        if command is not None and jumps.outlier.any():
            pulses = spikes(run.t, command, 0.0)
            following = np.convolve(pulses, np.ones(FOLLOWS + 1), "full")[: len(pulses)] > 0
            jumps = replace(jumps, outlier=jumps.outlier & ~following)
        out[name] = jumps
    return out


def _spikes(name: str, runs: Sequence[Run], found: Sequence[Mapping[str, Jumps]]) -> list[Finding]:
    having = [(run, jumps[name].outlier) for run, jumps in zip(runs, found, strict=True) if name in jumps]
    jumping = [(run, flags) for run, flags in having if flags.any()]
    if not jumping:
        return []
    first, flags = jumping[0]
    row = int(np.flatnonzero(flags)[0])
    alone = len(jumping) == 1
    count = sum(int(flags.sum()) for _, flags in jumping)
    sizes = {run.name: int(np.isfinite(run.columns[name]).sum()) for run, _ in having}
    severity = "warning" if count > MANY_SPIKES * sum(sizes.values()) else "info"
    total = sizes[first.name] if alone else sum(sizes.values())
    message = f"{count} of {total} samples of {name} are isolated outliers, the first at t = {first.t[row]:.6g} s"
    if alone:
        return [Finding(severity, "spikes", first.name, name, row, message)]  # type: ignore[arg-type]
    shares = ", ".join(f"{run.name} ({int(flags.sum())})" for run, flags in jumping[:NAMED])
    rest = len(jumping) - NAMED
    more = f" and {rest} more run{'s' if rest > 1 else ''}" if rest > 0 else ""
    message = f"{message} of {first.name}; outliers per run: {shares}{more}"
    return [Finding(severity, "spikes", "", name, None, message)]  # type: ignore[arg-type]


def _late(run: Run, jumps: Mapping[str, Jumps]) -> list[Finding]:
    """Stamps that are late by what all columns agree on, where they say anything."""
    if not jumps:
        return []
    late = np.stack([found.late for found in jumps.values()])  # (columns, n) s
    outlier = np.any([found.outlier for found in jumps.values()], axis=0)
    rows = np.flatnonzero(np.isfinite(late).any(axis=0) & ~outlier)
    if len(rows) < max(FEW_LATE, LATE * len(run.t)):
        return []
    by = np.nanmedian(late[:, rows], axis=0)  # (m,) s
    if np.mean(by > 0.0) < AGREEING:
        return []
    usual = float(np.median(by[by > 0.0]))
    message = (
        f"{len(rows)} of {len(run.t)} samples match the position about {usual * 1e3:.2g} ms earlier:"
        " their time stamps appear to be late by that much"
    )
    remedy = "stamp each sample when it is measured; late stamps cause errors in fast motion"
    return [Finding("info", "late stamps", run.name, "t", int(rows[0]), message, remedy)]
