"""Incidents: stretches of a log that no model of the robot explains, since a sensor failed or the robot was off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.logs.audit.facts import ActuatorFacts, RobotFacts, wheel_commands
from residual_mpc.logs.audit.pose_speed import PLANE
from residual_mpc.logs.audit.standing import carried, standing
from residual_mpc.logs.audit.steps import Step, steps_of
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import Run, held
from residual_mpc.logs.signals import continuous

RARE = 0.25  # share of the time of all runs up to which incidents of a kind are left out
SELDOM = 5.0  # s of a run for each step, below which steps are how the sensor works
BEFORE = 0.5  # s before a sudden step in which a position servo's command may have told it to
TOLD = 0.3  # of the step, that its command has changed by at once


@dataclass(frozen=True)
class Incident:
    """One stretch. run: its index; first, last: rows; column: where it shows; size: of a step, in its unit."""

    kind: str
    run: int
    first: int
    last: int
    column: str
    size: float = 0.0


def with_incidents(runs: Sequence[Run], robot: RobotFacts) -> tuple[Run, ...]:
    """The runs, each with the stretches of its incidents, which fits and verdicts leave out, if these are rare."""
    found = [i for kind in _by_kind(find_incidents(runs, robot)) if _rare(kind, runs) for i in kind]
    spans = [[(float(r.t[i.first]), float(r.t[i.last])) for i in found if i.run == k] for k, r in enumerate(runs)]
    return tuple(replace(r, incidents=tuple(sorted(s))) if s else r for r, s in zip(runs, spans, strict=True))


def check_incidents(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    """One warning for all incidents of a kind."""
    return [_finding(kind, runs) for kind in _by_kind(find_incidents(runs, robot))]


def find_incidents(runs: Sequence[Run], robot: RobotFacts) -> list[Incident]:
    """Every incident of these runs, by run and row."""
    out = []
    for k, run in enumerate(runs):
        steps = _steps(k, run, robot)
        frozen = [(i.first, i.last) for i in steps if i.kind == "frozen sensor"]
        disobeys = _disobeying(k, run, robot)
        out += [*steps, *(i for i in disobeys if not any(a < i.last and i.first < b for a, b in frozen))]
    return out


def _steps(k: int, run: Run, robot: RobotFacts) -> list[Incident]:
    """Steps of the pose, as a whole, and of each joint, unless a servo was told to make them."""
    servos = {f"position.{a.joint}": a for a in robot.actuators if a.kind == "position"}
    out = []
    for name in run.measured:
        if not (name in PLANE or name.startswith("position.")) or name not in robot.channels:
            continue
        found = steps_of(run.t, continuous(name, run.columns[name]))
        if len(found) * SELDOM > run.t[-1] - run.t[0]:
            continue
        column = "pose" if name in PLANE else name
        for step in found:
            if step.frozen or name not in servos or not _told(run, servos[name], step):
                kind = "frozen sensor" if step.frozen else "step"
                out.append(Incident(kind, k, step.first, step.last, column, step.size))
    return _one_of_each(out)


def _one_of_each(found: Sequence[Incident]) -> list[Incident]:
    """The pose steps as a whole: one incident for all of its parts."""
    seen: dict[tuple[str, str, int], Incident] = {}
    for i in sorted(found, key=lambda i: -abs(i.size)):
        seen.setdefault((i.kind, i.column, i.last), i)
    return sorted(seen.values(), key=lambda i: i.first)


def _told(run: Run, servo: ActuatorFacts, step: Step) -> bool:
    """Whether a servo's command has just stepped by enough for its joint to step."""
    column = f"command.{servo.name}"
    if column not in run.columns:
        return False
    recent = slice(int(np.searchsorted(run.t, run.t[step.last] - BEFORE)), step.last + 1)
    sent = held(run, column)[recent] / servo.gear
    return bool((np.abs(np.diff(sent)) > TOLD * abs(step.size)).any())


def _disobeying(k: int, run: Run, robot: RobotFacts) -> list[Incident]:
    wheels = wheel_commands(run, robot)
    kinds = ("standing", standing(run, wheels)), ("carried", carried(run, wheels))
    return [Incident(kind, k, a, b, "pose") for kind, found in kinds for a, b in found]


def _by_kind(found: Sequence[Incident]) -> list[list[Incident]]:
    """The incidents of each kind and column."""
    kinds = dict.fromkeys((i.kind, i.column) for i in found)
    return [[i for i in found if (i.kind, i.column) == kind] for kind in kinds]


def _rare(found: Sequence[Incident], runs: Sequence[Run]) -> bool:
    seconds = sum(runs[i.run].t[i.last] - runs[i.run].t[i.first] for i in found)
    return bool(seconds <= RARE * sum(r.t[-1] - r.t[0] for r in runs))


def _finding(found: Sequence[Incident], runs: Sequence[Run]) -> Finding:
    worst = max(found, key=lambda i: (abs(i.size), runs[i.run].t[i.last] - runs[i.run].t[i.first]))
    run = runs[worst.run]
    begin, end = float(run.t[worst.first]), float(run.t[worst.last])
    often = "" if len(found) == 1 else f", and {len(found) - 1} more {'time' if len(found) == 2 else 'times'}"
    names = {runs[i.run].name for i in found}
    where = f" in {len(names)} of {len(runs)} runs" if len(found) > 1 and len(runs) > 1 else ""
    if worst.kind == "standing":
        text = f"the robot stands still from t = {begin:.4g} to {end:.4g} s although it is told to drive"
        remedy = "log `enabled.*` where motors are switched off"
    elif worst.kind == "carried":
        text = f"the robot sets off from t = {begin:.4g} to {end:.4g} s although it is told to stand"
        remedy = "cut out what was done by hand"
    elif worst.kind == "frozen sensor":
        text = f"{worst.column} freezes from t = {begin:.4g} to {end:.4g} s and then catches up"
        remedy = "look for lost messages of this sensor"
    else:
        text = f"{worst.column} jumps by {abs(worst.size):.3g} at t = {end:.4g} s and stays there"
        cause = "a localisation that corrects itself" if worst.column == "pose" else "an encoder that slips"
        remedy = f"look for {cause}"
    fits = "fits leave these windows out" if _rare(found, runs) else "too long to be left out of fits"
    message = f"{text}{often}{where}"
    return Finding("warning", worst.kind, run.name, worst.column, worst.first, message, f"{remedy}; {fits}")
