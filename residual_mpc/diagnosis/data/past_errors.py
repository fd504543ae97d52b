"""The past errors of position servos, from a run's log."""

from collections.abc import Mapping, Sequence
from dataclasses import fields

import numpy as np

from residual_mpc.diagnosis.data.signals import Signal
from residual_mpc.effects.position_servo import SERVO_INTEGRAL
from residual_mpc.logs.run import Run, held
from residual_mpc.models import optional
from residual_mpc.models.past_errors import PastErrors
from residual_mpc.models.protocol import Robot

FIELDS = len(fields(PastErrors))
FIRST = 0.5  # s of a run from which what its servos' integral parts held at its start is told


def past_errors(
    robot: Robot,
    runs: Sequence[Run],
    starts: Sequence[np.ndarray],
    index: Sequence[int],
    signals: Mapping[tuple[int, str], Signal],
) -> PastErrors | None:
    """Of one robot's windows, which begin at starts[k] (W_k,) s in runs[k], whose number is index[k]; None for a robot
    without position servos that could have an integral part."""
    if not robot.slots(SERVO_INTEGRAL.name):
        return None
    each = [_of_run(robot, run, t0, i, signals) for run, t0, i in zip(runs, starts, index, strict=True)]
    return PastErrors(*np.concatenate(each, axis=1))


def _of_run(robot: Robot, run: Run, start: np.ndarray, i: int, signals: Mapping[tuple[int, str], Signal]) -> np.ndarray:
    """(FIELDS, W, nu) in the order of the record's fields."""
    joints = optional.actuator_joints(robot)
    columns = []
    for a, kind, joint in zip(robot.actuators, robot.command_kinds, joints, strict=True):
        signal = signals.get((i, f"position.{joint}"))
        known = kind == "position" and signal is not None and len(signal.t) > 1
        nothing = np.zeros((FIELDS, len(start)))
        columns.append(_of_one(run, a, start, signal) if known and signal is not None else nothing)
    return np.stack(columns, axis=-1)


def _of_one(run: Run, actuator: str, start: np.ndarray, signal: Signal) -> np.ndarray:
    """(FIELDS, W) in the order of the record's fields."""
    t = run.t
    u = held(run, f"command.{actuator}")
    u = np.where(np.isfinite(u), u, u[np.isfinite(u)][0])
    q = np.interp(t, signal.t, signal.y)
    switch = f"enabled.{actuator}"
    on = np.nan_to_num(held(run, switch), nan=1.0) > 0 if switch in run.columns else np.ones(len(t), dtype=bool)
    gap = np.diff(t)
    sent = np.concatenate([[0.0], np.cumsum(u[:-1] * gap)])
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (q[1:] + q[:-1]) * gap)])
    # since when it has been on: the first stamp after the last one at which it was off; nowhere where it is off
    since = np.maximum.accumulate(np.where(on, 0, np.arange(len(t)) + 1)).clip(max=len(t) - 1)
    k = np.clip(np.searchsorted(t, start, side="right") - 1, 0, len(t) - 1)
    begin = since[k]
    whole = (begin == 0).astype(float)

    def until(total: np.ndarray) -> np.ndarray:
        return np.where(on[k], np.interp(start, t, total) - total[begin], 0.0)

    first = t <= t[0] + FIRST
    first[:2] = True
    early = np.array([
        np.mean(u[first]), np.mean(q[first]), (q[first][-1] - q[first][0]) / max(t[first][-1] - t[0], 1e-9),
        np.mean(sent[first]), np.mean(turned[first]),
    ])  # fmt: skip
    since_then = [np.ones(len(start)), until(sent), until(turned), whole, u[begin]]
    return np.concatenate([since_then, np.repeat(early[:, None], len(start), axis=1)])
