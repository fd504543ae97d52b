"""Joints that something stops: their command goes on, and they stay where they are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from residual_mpc.logs.audit.facts import ActuatorFacts, RobotFacts
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import FloatArray, Run, held
from residual_mpc.logs.signals import resolution, unwrap_with_gaps

BEYOND = 0.1  # rad or m, and of the joint's motion: how far a command moves past the stop; less may be stiction
STILL = 0.005  # of the joint's motion, and a few counts of its encoder
COUNTS = 3.0
LASTING = 0.15  # s
VISITS = 2  # stretches at the same place


def check_stops(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    """A servo's joint that stays at one end of its motion, more than once, while its command moves on beyond it.

    Ends that the model knows of are left out: `robot.limits`.
    """
    found = []
    for actuator in robot.actuators:
        if actuator.kind != "position" or actuator.joint is None:
            continue
        known = robot.limits.get(actuator.joint, (-np.inf, np.inf))
        for run in runs:
            found += [
                _finding(run, actuator, place, visits, reach)
                for place, visits, reach in _ends(run, actuator)
                if min(abs(place - end) for end in known) > BEYOND
            ]
    return found


def _ends(run: Run, actuator: ActuatorFacts) -> list[tuple[float, list[int], float]]:
    """Ends at which the joint is stopped: where, the first sample of each visit, and how far its command went."""
    name, sent = f"position.{actuator.joint}", f"command.{actuator.name}"
    if name not in run.columns or sent not in run.columns or run.served_as_command:
        return []
    y, u = unwrap_with_gaps(run.columns[name]), held(run, sent)
    good = np.isfinite(y) & np.isfinite(u)
    if f"enabled.{actuator.name}" in run.columns:
        good &= held(run, f"enabled.{actuator.name}") != 0.0
    if good.sum() < 20:
        return []
    t, y, u = run.t[good], y[good], u[good]
    motion = float(np.ptp(y))
    still = max(STILL * motion, COUNTS * resolution(y))
    out = []
    for side in (-1.0, 1.0):
        end = float(np.max(side * y))
        visits = _visits(t, side * y > end - still, side * u - end, max(BEYOND, BEYOND * motion))
        if len(visits) >= VISITS:
            first = np.flatnonzero(good)
            out.append((side * end, [int(first[k]) for k in visits], float(side * np.max(side * u))))
    return out


def _visits(t: FloatArray, there: np.ndarray, past: FloatArray, beyond: float) -> list[int]:
    """First samples of the stretches `there` (n,) that last and in which the command moves past the end by `beyond`."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(int)))
    return [
        int(a)
        for a, b in zip(edges[::2], edges[1::2], strict=True)
        if t[b - 1] - t[a] > LASTING and past[a:b].max() > beyond and np.ptp(past[a:b]) > beyond
    ]


def _finding(run: Run, actuator: ActuatorFacts, place: float, visits: list[int], reach: float) -> Finding:
    return Finding(
        "warning",
        "stop",
        run.name,
        f"position.{actuator.joint}",
        visits[0],
        f"stays at {place:.3g} in {len(visits)} intervals while its command continues to {reach:.3g}: the joint "
        "is stopped there, and the model has no such end stop",
        "set this joint limit in the model, or leave these runs out",
    )
