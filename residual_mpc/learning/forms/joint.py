"""A residual on the accelerations of a robot of joints: x_{k+1} = Dyn(x_k, u_k) + delta, the paper's general model.

The base is the robot's own replay of the whole window, with all of its internal memory. The deviation from the base
that the residual has caused is propagated by Dyn, the robot's replay over one step: it becomes the difference between
the step from the corrected state and the step from the base's state. The model thus determines how a joint's servo or
gravity responds to the correction, and without a correction the robot is reproduced to the last bit, whatever memory it
has. Only the deviation loses, at each step, the memory that is not a channel (play, the spring in a gear, a filter
inside an actuator): commands before the step still warm up delays and lags, but the replay of 0.6 s that initialises a
joint with play at the start of a window is not repeated at every step.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.learning.forms.form import Delta, FormRollout, steps_of
from residual_mpc.models import optional
from residual_mpc.models.protocol import Drive, Robot
from residual_mpc.models.settings import Settings


@dataclass(frozen=True)
class JointForm:
    """delta is an acceleration held over the step (for a state without velocity: a rate).

    Inputs: every position and velocity of the state, and the commands; of a position servo how far its command lies
    from its joint.
    """

    name: str = "joint"

    def inputs(self, base: Robot) -> tuple[str, ...]:
        channels = [c for s in base.states for c in (s.position, s.velocity) if c is not None]
        ahead = _servo_joints(base)
        return (*channels, *(f"{'ahead' if j else 'command'}.{a}" for a, j in zip(base.actuators, ahead, strict=True)))

    def outputs(self, base: Robot) -> tuple[str, ...]:
        return tuple(f"{'rate' if s.velocity is None else 'acceleration'}.{_name(s.position)}" for s in base.states)

    def moved_by(self, base: Robot, channel: str) -> tuple[str, ...]:
        found = [o for o, s in zip(self.outputs(base), base.states, strict=True) if channel in (s.position, s.velocity)]
        return tuple(found)

    def roll(
        self,
        base: Robot,
        delta: Delta,
        step: float,
        start: Mapping[str, np.ndarray],
        drive: Drive,
        settings: Settings,
        wanted: tuple[str, ...],
        push: np.ndarray | None = None,
    ) -> FormRollout:
        sub, count = steps_of(step, drive)
        states = base.states
        channels = tuple(c for s in states for c in (s.position, s.velocity) if c is not None)
        asked = tuple(dict.fromkeys((*channels, *wanted)))
        ahead = _servo_joints(base)
        every = np.arange(settings.rows)
        own = every[:1] if _alike(start, drive, settings) else every  # rows of the base's own motion
        free = base.replay({c: v[own] for c, v in start.items()}, drive.take(own), settings.take(own), asked)
        x = {c: np.repeat(free[c][:, 0], len(every) // len(own)) for c in channels}
        parts: dict[str, list[np.ndarray]] = {c: [np.empty((len(every), 0))] for c in wanted}
        z, d, v = [], [], []
        for k in range(count):
            first, last = k * sub, min((k + 1) * sub, drive.steps)
            u = drive.command[:, drive.lead + first : drive.lead + last].mean(axis=1)
            columns = [u[:, i] - x[j] if j else u[:, i] for i, j in enumerate(ahead)]
            z.append(np.stack([*(x[c] for c in channels), *columns], axis=1))
            d.append(delta(z[-1]) if push is None else delta(z[-1]) + push[:, k])
            t = drive.dt * np.arange(last - first + 1)
            added: dict[str, np.ndarray] = {}
            for i, s in enumerate(states):
                if s.velocity is None:
                    added[s.position] = d[-1][:, i, None] * t
                else:
                    added[s.position], added[s.velocity] = d[-1][:, i, None] * (0.5 * t**2), d[-1][:, i, None] * t
            from_base = {c: free[c][:, first] for c in channels}
            apart = _carried(base, x, from_base, own, _part(drive, first, last), settings, asked)
            whole = {c: free[c][:, first : last + 1] + apart[c] + added.get(c, 0.0) for c in asked}
            for c in wanted:
                parts[c].append(whole[c] if k == count - 1 else whole[c][:, :-1])
            before, x = x, {c: whole[c][:, -1] for c in channels}
            v.append(
                np.stack(
                    [
                        (x[s.position] - before[s.position]) / t[-1] if s.velocity is None else x[s.velocity]
                        for s in states
                    ],
                    axis=1,
                )
            )
        return FormRollout(
            {c: np.concatenate(p, axis=1) for c, p in parts.items()},
            np.stack(z, axis=1),
            np.stack(d, axis=1),
            np.stack(v, axis=1),
        )


def _carried(
    base: Robot, x: Mapping[str, np.ndarray], from_base: Mapping[str, np.ndarray], own: np.ndarray, drive: Drive,
    settings: Settings, asked: tuple[str, ...],
) -> dict[str, np.ndarray]:  # fmt: skip
    """The difference between one step from the state x (B,) and one from the base's state (R,), at each node.

    own (R,): the rows of the base among the B rows, either all of them or one that stands for all.
    """
    rows = settings.rows
    if all((x[c] == from_base[c]).all() for c in x):
        return {c: np.zeros((rows, drive.steps + 1)) for c in asked}
    both = np.concatenate([np.arange(rows), own])
    start = {c: np.concatenate([x[c], from_base[c]]) for c in x}
    found = base.replay(start, drive.take(both), settings.take(both), asked)
    return {c: found[c][:rows] - found[c][rows:] for c in asked}


def _alike(start: Mapping[str, np.ndarray], drive: Drive, settings: Settings) -> bool:
    """Whether all rows are the same window under the same hypothesis, as when outputs are perturbed one at a time."""
    past = () if drive.past is None else vars(drive.past).values()
    given = [v for v in (*start.values(), *vars(drive).values(), *past) if isinstance(v, np.ndarray)]
    return len(settings.distinct()[0]) == 1 and all(bool((v == v[:1]).all()) for v in given)


def _name(channel: str) -> str:
    return channel.partition(".")[2]


def _servo_joints(base: Robot) -> tuple[str | None, ...]:
    """For each actuator the position channel of the joint that it servoes; None where it servoes none."""
    joints = optional.actuator_joints(base)
    known = {s.position for s in base.states}
    out: list[str | None] = []
    for joint, kind in zip(joints, base.command_kinds, strict=True):
        channel = f"position.{joint}"
        out.append(channel if kind == "position" and channel in known else None)
    return tuple(out)


def _part(drive: Drive, first: int, last: int) -> Drive:
    """Steps first to last of a window, with the commands before them."""
    return replace(
        drive,
        command=drive.command[:, first : drive.lead + last],
        enabled=None if drive.enabled is None else drive.enabled[:, first:last],
        clock=drive.clock + first * drive.dt,
        midway=first > 0,
    )
