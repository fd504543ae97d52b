"""Columns that are missing, that the robot does not have, or that never move."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from residual_mpc.logs.audit.facts import RobotFacts, wheel_commands
from residual_mpc.logs.columns import did_you_mean, group, is_measured, member
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import Run, held
from residual_mpc.logs.signals import resolution

FELL = 0.5  # rad, m: a servo with a constant command moves its joint by less than this, however it sags
MISSPELT = 0.92  # similarity of two names (difflib) from which one is taken for the other with a typing mistake
MOVED = 0.1  # rad, m: a position command that moves this far ought to move its joint


def check_channels(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    """Commands and channels that the robot has and the runs lack, and the other way round; stuck sensors."""
    return [
        *_absent_commands(runs, robot),
        *_strange_commands(runs, robot),
        *_channels(runs, robot),
        *(finding for run in runs for finding in (*_stuck(run, robot), *_stuck_pose(run, robot))),
        *_never_sent(runs, robot),
        *_switched_off(runs),
    ]


def _where(names: Sequence[str], runs: Sequence[Run]) -> tuple[str, str]:
    """The run to name in a finding, and the words that say how many runs it concerns."""
    if len(names) == 1:
        return names[0], f"in {names[0]}"
    return "", "in every run" if len(names) == len(runs) else f"in {len(names)} of {len(runs)} runs"


def _absent_commands(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    findings = []
    for actuator in robot.actuators:
        lacking = [run.name for run in runs if actuator.name not in run.actuators]
        if not lacking:
            continue
        run, words = _where(lacking, runs)
        column = f"command.{actuator.name}"
        used = {f"command.{a.name}" for a in robot.actuators}
        given = [name for r in runs for name in r.columns if name not in used and not is_measured(name)]
        none_left = all(a.name not in r.actuators for r in runs if r.name in lacking for a in robot.actuators)
        findings.append(
            Finding(
                "error" if none_left else "warning",
                "missing command",
                run,
                column,
                None,
                f"column {column!r} is missing {words}",
                f"map it under [log] in the robot file; {did_you_mean(column, dict.fromkeys(given))}",
            )
        )
    return findings


def _strange_commands(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    known = [actuator.name for actuator in robot.actuators]
    return _strange(
        runs,
        known,
        lambda run: (f"command.{name}" for name in run.actuators),
        "unknown actuator",
        "the robot has no such actuator; the column is not used",
        "command.",
    )


def _channels(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    findings = []
    blind = [run.name for run in runs if not set(run.measured) & set(robot.channels)]
    if blind:
        run, words = _where(blind, runs)
        findings.append(
            Finding(
                "error",
                "nothing to compare",
                run,
                "",
                None,
                f"the model predicts no measured column {words}; it predicts {', '.join(robot.channels[:12])}",
                "map the columns under [log] in the robot file, or leave these runs out",
            )
        )
    findings += _angles(runs, robot)
    strange = _strange(
        runs,
        robot.channels,
        lambda run: (n for n in run.measured if group(n) != "effort" and not _has_speed(n, run, robot)),
        "unknown channel",
        "the robot's model does not predict this channel; the column is not compared",
        "",
    )
    there = {name for run in runs for name in run.measured}
    findings += [_misspelt(f, [c for c in robot.channels if c not in there]) for f in strange]
    for name in dict.fromkeys(n for run in runs for n in run.columns):
        empty = [r.name for r in runs if name in r.columns and not np.isfinite(r.columns[name]).any()]
        if empty:
            run, words = _where(empty, runs)
            findings.append(Finding("info", "empty column", run, name, None, f"{name} has no values {words}"))
    return findings


def _misspelt(finding: Finding, lacking: Sequence[str]) -> Finding:
    """A column that the robot does not have, as an error where its name is that of one that is missing but for a typing
    mistake: left out, the joint would not be compared."""
    same = [c for c in lacking if group(c) == group(finding.column)]
    near = difflib.get_close_matches(finding.column, same, n=1, cutoff=MISSPELT)
    if not near:
        return finding
    message = f"{finding.column}: the model has no such channel, and {near[0]} is missing: the name looks misspelt"
    return replace(finding, severity="error", message=message, remedy=f"did you mean {near[0]!r}?")


def _has_speed(name: str, run: Run, robot: RobotFacts) -> bool:
    """Whether a column is an angle that the model does not predict beside its speed, which it does."""
    speed = f"velocity.{member(name)}"
    angle = group(name) == "position" and name not in robot.channels
    return angle and speed in robot.channels and speed in run.columns


def _angles(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    """Those of wheels whose speeds are logged as well, which say the same."""
    findings = []
    for name in dict.fromkeys(n for run in runs for n in run.measured):
        where = [run.name for run in runs if name in run.measured and _has_speed(name, run, robot)]
        if where:
            run, words = _where(where, runs)
            message = f"{name} ({words}): the angle is not used, since its speed velocity.{member(name)} is logged"
            findings.append(Finding("info", "unused angle", run, name, None, message))
    return findings


def _strange(
    runs: Sequence[Run],
    known: Sequence[str],
    names: Callable[[Run], Iterable[str]],
    kind: str,
    message: str,
    prefix: str,
) -> list[Finding]:
    full = [prefix + name for name in known]
    seen: dict[str, list[str]] = {}
    for run in runs:
        for name in names(run):
            if name not in full:
                seen.setdefault(name, []).append(run.name)
    findings = []
    for name, where in seen.items():
        run_name, words = _where(where, runs)
        remedy = did_you_mean(name, full)
        full_message = f"{name} ({words}): {message}"
        findings.append(Finding("warning", kind, run_name, name, None, full_message, remedy))
    return findings


def _stuck(run: Run, robot: RobotFacts) -> list[Finding]:
    """Joints that report one value throughout while their position servo is sent far."""
    findings = []
    for actuator in robot.actuators:
        command, position = f"command.{actuator.name}", f"position.{actuator.joint}"
        if actuator.kind != "position" or command not in run.columns or position not in run.measured:
            continue
        y = run.columns[position]
        y = y[np.isfinite(y)]
        sent = held(run, command)
        span = float(np.quantile(sent, 0.95) - np.quantile(sent, 0.05))
        if len(y) > 10 and span > max(MOVED, 5.0 * resolution(y)) and np.ptp(y) == 0.0:
            findings.append(
                Finding(
                    "warning",
                    "stuck sensor",
                    run.name,
                    position,
                    None,
                    f"{position} stays at {y[0]:.4g} while its command spans a range of {span:.3g}",
                    "remove the column if the sensor or its connection failed",
                )
            )
    return findings


def _never_sent(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    """Servo commands that keep one value in runs in which the joint moves far: the recorder took another column, or
    something else commands the joint."""
    findings = []
    for actuator in robot.actuators:
        command, position = f"command.{actuator.name}", f"position.{actuator.joint}"
        moved = {}
        for run in runs if actuator.kind == "position" else ():
            y = run.columns.get(position, np.zeros(0))
            y = y[np.isfinite(y)]
            sent = np.ptp(held(run, command)) if command in run.columns else np.inf
            if len(y) > 10 and sent == 0.0 and (far := float(np.quantile(y, 0.95) - np.quantile(y, 0.05))) > FELL:
                moved[run.name] = far
        if moved:
            run_name, words = _where(list(moved), runs)
            message = f"{command} never changes {words}, while {position} spans a range of {max(moved.values()):.3g}"
            remedy = "map the column with the command that was sent to the servo; leave these runs out if none was"
            findings.append(Finding("warning", "constant command", run_name, command, None, message, remedy))
    return findings


def _stuck_pose(run: Run, robot: RobotFacts) -> list[Finding]:
    """Parts of the pose that report one value throughout while a robot on wheels turns and drives: on a straight line
    along an axis two of them may."""
    findings = []
    wheels = wheel_commands(run, robot)
    pose = {n: y[np.isfinite(y)] for n in run.measured if group(n) == "pose" for y in [run.columns[n]]}
    moves = {n for n, y in pose.items() if len(y) > 10 and np.ptp(y) > 0.0}
    turns = len(wheels) == 2 and bool(np.any(wheels[0] != wheels[1]))
    if not turns or not moves or "pose.theta" not in pose:
        return []
    for name in pose:
        if name not in moves and (name == "pose.theta" or "pose.theta" in moves) and len(pose[name]) > 10:
            message = f"{name} stays at {pose[name][0]:.4g} while the wheels turn the robot and the rest changes"
            remedy = "remove the column if it was not measured"
            findings.append(Finding("warning", "stuck sensor", run.name, name, None, message, remedy))
    return findings


def _switched_off(runs: Sequence[Run]) -> list[Finding]:
    findings = []
    for name in dict.fromkeys(n for run in runs for n in run.columns if group(n) == "enabled"):
        off = {run.name: _time_off(run, name) for run in runs if name in run.columns}
        some = {run: time for run, time in off.items() if time > 0.0}
        if some:
            run, words = _where(list(some), runs)
            findings.append(
                Finding(
                    "info",
                    "motor off",
                    run,
                    name,
                    None,
                    f"{member(name)} is switched off for {sum(some.values()):.3g} s {words}",
                )
            )
    return findings


def _time_off(run: Run, name: str) -> float:
    return float(np.sum(np.diff(run.t)[held(run, name)[:-1] == 0.0]))
