"""Single columns: wrapped angles, coarse steps, clipped commands, angles in degrees."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from residual_mpc.logs.audit.facts import RobotFacts
from residual_mpc.logs.columns import group, member
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import FloatArray, Run
from residual_mpc.logs.signals import resolution

TURN, TURN_DEGREES = 2.0 * np.pi, 360.0
WRAP = 0.15  # of a turn: how near to it a jump has to be
CLIPPED = 0.02  # share of a command's samples at its very end
REST = 5  # equal samples in a row from which a command rests
COARSE = 0.05  # rounding step over the spread of the motion


def check_values(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    """Every column that the robot has, one at a time over all runs."""
    findings: list[Finding] = []
    names = dict.fromkeys(name for run in runs for name in run.measured if name in robot.channels)
    for name in names:
        having = [run for run in runs if name in run.measured]
        findings += _wraps(name, having, robot)
        findings += _beyond_limits(name, having, robot)
        findings += _steps(name, having)
    commands = dict.fromkeys(name for run in runs for name in run.columns if group(name) == "command")
    for name in commands:
        findings += _clipped(name, [run for run in runs if name in run.columns])
    return findings


def _turns(name: str, robot: RobotFacts) -> bool:
    return name == "pose.theta" or group(name) == "position" and member(name) not in robot.sliding


def _wraps(name: str, runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    if not _turns(name, robot):
        return []
    for turn, unit in ((TURN_DEGREES, "degrees"), (TURN, "radians")):
        rows = {run.name: (run, row) for run in runs if (row := _first_wrap(run.columns[name], turn)) is not None}
        if not rows:
            continue
        run, row = next(iter(rows.values()))
        where = f" (in {len(rows)} of {len(runs)} runs, this one first)" if len(rows) > 1 else ""
        jump = f"{name} jumps by one turn, in {unit}, at t = {run.t[row]:.6g} s{where}"
        if unit == "degrees":
            remedy = "multiply it by pi / 180; angles must be in radians"
            return [Finding("error", "degrees", run.name, name, row, jump, remedy)]
        severity = "info" if name == "pose.theta" else "warning"  # the log format lets theta wrap
        message = f"{jump}; it is unwrapped before the comparison"
        return [Finding(severity, "wrapped angle", run.name, name, row, message)]  # type: ignore[arg-type]
    return []


def _first_wrap(y: FloatArray, turn: float) -> int | None:
    """The first sample after a jump by one turn between samples that otherwise move little, or None."""
    where = np.flatnonzero(np.isfinite(y))
    if len(where) < 4:
        return None
    step = np.diff(y[where])
    near = np.abs(np.abs(step) - turn) < WRAP * turn
    usual = float(np.quantile(np.abs(step), 0.9))
    # a wrapped angle reaches from one end of a turn to the other, and hardly farther
    if not near.any() or usual > 0.25 * turn or np.ptp(y[where]) > 1.5 * turn:
        return None
    return int(where[1:][near][0])


def _beyond_limits(name: str, runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    """Positions so far beyond the joint's range that they can only be in degrees."""
    if group(name) != "position":
        return []
    if member(name) not in robot.limits:
        return _many_turns(name, runs, robot)
    low, high = robot.limits[member(name)]
    reach = max(abs(low), abs(high), high - low)
    if not _turns(name, robot) or not reach > 0.0:
        return []
    fars = [float(np.nanquantile(np.abs(run.columns[name]), 0.9)) for run in runs]
    beyond = [(run, far) for run, far in zip(runs, fars, strict=True) if far > 5.0 * reach and far > TURN]
    if not beyond:
        return []
    run, far = beyond[0]
    message = f"{name} reaches {far:.4g}, beyond the joint range {low:.4g} to {high:.4g} rad: it is in degrees"
    remedy = "multiply position, velocity and command by pi / 180"
    if len(beyond) == len(runs):
        remedy += ", or let `residual-mpc init` write corrected runs (--mended DIR)"
    else:
        some = "this run" if len(beyond) == 1 else f"{len(beyond)} of {len(runs)} runs, this one first"
        message += f" in {some}"
        remedy += " there, or leave such runs out, and check the unit of the others, which reach less"
    return [Finding("error", "degrees", run.name, name, None, message, remedy)]


def _many_turns(name: str, runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    """A position servo rarely makes several turns; degrees always look as if it did."""
    servo = any(a.joint == member(name) and a.kind == "position" for a in robot.actuators)
    farthest = max(runs, key=lambda run: float(np.nanmax(np.abs(run.columns[name]))))
    reach = float(np.nanmax(np.abs(farthest.columns[name])))
    if not servo or not _turns(name, robot) or reach < 2.0 * TURN:
        return []
    message = f"{name} reaches {reach:.4g} rad, {reach / TURN:.2g} turns: it may be in degrees"
    return [Finding("warning", "many turns", farthest.name, name, None, message, "angles must be in radians")]


def _steps(name: str, runs: Sequence[Run]) -> list[Finding]:
    """Rounding that is coarse against the motion."""
    steps = np.array([resolution(run.columns[name]) for run in runs])
    spread = np.array([float(np.nanstd(run.columns[name])) for run in runs])
    coarse = (steps > 0.0) & (steps > COARSE * np.maximum(spread, 1e-12))
    # where the robot stands still every sensor is coarse
    if not coarse.any() or np.median(steps[coarse]) <= COARSE * float(spread.max()):
        return []
    message = (
        f"{name} is quantised in steps of {np.median(steps[coarse]):.4g}; its standard deviation is {spread.max():.4g}"
    )
    return [Finding("info", "coarse steps", "", name, None, message)]


def _clipped(name: str, runs: Sequence[Run]) -> list[Finding]:
    """Commands with many different values that rest at one and the same end, run after run."""
    y = np.concatenate([run.columns[name][np.isfinite(run.columns[name])] for run in runs])
    if len(np.unique(y)) < 0.2 * len(y):  # steps and ramps rest at their ends by design
        return []
    ends = (float(y.max()), float(y.min()))
    rests = sum(_resting(run.columns[name], (*ends, 0.0)) for run in runs) / len(y)
    for end, word in zip(ends, ("above", "below"), strict=True):
        share = float(np.mean(y == end))
        # a motion from place to place rests at others as well; 0 is where a drive, or an axis at its safe height, rests
        if share > max(CLIPPED, rests) and end != 0.0:
            message = f"{share:.0%} of {name} is exactly {end:.5g} and no value is {word}: it may be clipped"
            return [Finding("info", "clipped command", "", name, None, message)]
    return []


def _resting(y: FloatArray, but: Sequence[float]) -> int:
    """Number of samples in which a command rests, at other values than these."""
    y = y[np.isfinite(y)]
    begins = np.flatnonzero(np.diff(y, prepend=np.nan) != 0.0)
    lengths = np.diff(begins, append=len(y))
    long = (lengths >= REST) & ~np.isin(y[begins], but)
    return int(lengths[long].sum())
