"""A residual on the planar velocity of a robot that drives: in the body's frame, and literally as in the paper.

The paper's inputs (its equation wheel_prop) are the velocities that it corrects, in the world frame: what was learned
driving east says nothing of driving north, and a lag cannot be seen. The body form takes the previous velocity, as a
state, in the body's frame: the same in every heading, and delta = a (previous - model) is a first-order lag.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.learning.forms.form import Delta, FormRollout, steps_of
from residual_mpc.models.protocol import Drive, Robot
from residual_mpc.models.settings import Settings
from residual_mpc.models.stepping import BODY

POSE = ("pose.x", "pose.y", "pose.theta")
WORLD = ("twist.x", "twist.y", "twist.theta")  # m/s, m/s, rad/s


@dataclass(frozen=True)
class BodyForm:
    """v_k = Dyn(u_k) + delta(v_{k-1}, u_k) in the body's frame; v warms up on the commands before the window."""

    name: str = "body"

    def inputs(self, base: Robot) -> tuple[str, ...]:
        return (*(f"previous.{n}" for n in BODY), *(f"command.{a}" for a in base.actuators))

    def outputs(self, base: Robot) -> tuple[str, ...]:
        return BODY

    def moved_by(self, base: Robot, channel: str) -> tuple[str, ...]:
        return BODY[2:] if channel.endswith(".theta") else BODY[:2]

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
        nodes, v, heading = _base(base, start, drive, settings, wanted)
        before = drive.lead // sub
        model = _means(v, sub, count)
        if before:
            early = _earlier(drive, before * sub)
            _, lead_v, _ = _base(base, start, early, settings, ())
            model = np.concatenate([_means(lead_v, sub, before), model], axis=1)
        u = _means(drive.command[:, drive.lead - before * sub :], sub, before + count)
        z = np.empty((len(u), count, 3 + u.shape[2]))
        change = np.empty((len(u), count, 3))
        velocity = np.empty_like(change)
        last = model[:, 0]
        for k in range(before + count):
            now = np.concatenate([last, u[:, k]], axis=1)
            d = delta(now)
            if push is not None and k >= before:
                d = d + push[:, k - before]
            last = model[:, k] + d
            if k >= before:
                z[:, k - before], change[:, k - before], velocity[:, k - before] = now, d, last
        held = np.repeat(change, sub, axis=1)[:, : drive.steps]
        return FormRollout(_moved(nodes, start, v + held, drive.dt, wanted), z, change, velocity)


@dataclass(frozen=True)
class PaperForm:
    """The paper's equation wheel_prop: world velocities plus delta(world velocities of the model, commands)."""

    name: str = "paper"

    def inputs(self, base: Robot) -> tuple[str, ...]:
        return (*(f"model.{n}" for n in WORLD), *(f"command.{a}" for a in base.actuators))

    def outputs(self, base: Robot) -> tuple[str, ...]:
        return WORLD

    def moved_by(self, base: Robot, channel: str) -> tuple[str, ...]:
        return (f"twist.{channel.partition('.')[2]}",)

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
        nodes, v, _ = _base(base, start, drive, settings, wanted)
        model, u = _means(v, sub, count), _means(drive.command[:, drive.lead :], sub, count)
        rows = len(u)
        z, change = np.empty((rows, count, 3 + u.shape[2])), np.empty((rows, count, 3))
        velocity, body = np.empty_like(change), np.empty_like(change)
        theta = np.array(start["pose.theta"], dtype=np.float64)
        for k in range(count):
            span = sub * drive.dt
            middle = theta + 0.5 * span * model[:, k, 2]
            world = _turned(model[:, k], middle)
            z[:, k] = np.concatenate([world, u[:, k]], axis=1)
            d = delta(z[:, k])
            change[:, k] = d if push is None else d + push[:, k]
            velocity[:, k] = world + change[:, k]
            theta = theta + span * velocity[:, k, 2]
            body[:, k] = _turned(change[:, k], -(theta - 0.5 * span * velocity[:, k, 2]))
        held = np.repeat(body, sub, axis=1)[:, : drive.steps]
        return FormRollout(_moved(nodes, start, v + held, drive.dt, wanted), z, change, velocity)


def _base(
    base: Robot, start: Mapping[str, np.ndarray], drive: Drive, settings: Settings, wanted: tuple[str, ...]
) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """The model's nodes, its body velocity (B, K, 3) on the grid, and its heading (B, K + 1)."""
    nodes = dict(base.replay(start, drive, settings, tuple(dict.fromkeys((*wanted, *POSE)))))
    x, y, theta = (nodes[c] for c in POSE)
    d = np.stack([np.diff(x, axis=1), np.diff(y, axis=1), np.diff(theta, axis=1)], axis=-1) / drive.dt
    return nodes, _turned(d, -0.5 * (theta[:, 1:] + theta[:, :-1])), theta


def _turned(v: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Planar velocities (..., 3) turned by angle (...) rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * v[..., 0] - s * v[..., 1], s * v[..., 0] + c * v[..., 1], v[..., 2]], axis=-1)


def _means(x: np.ndarray, sub: int, count: int) -> np.ndarray:
    """(B, count, n) means over `sub` grid steps of x (B, K, n); the last one over what is left."""
    short = count * sub - x.shape[1]
    if short > 0:
        x = np.concatenate([x, np.repeat(x[:, -1:], short, axis=1)], axis=1)
    return np.asarray(x[:, : count * sub].reshape(len(x), count, sub, -1).mean(axis=2))


def _earlier(drive: Drive, steps: int) -> Drive:
    """The `steps` before the window as a window of their own."""
    on = None if drive.enabled is None else np.repeat(drive.enabled[:, :1], steps, axis=1)
    command = drive.command[:, : drive.lead]
    angle = drive.angle_before(np.full(len(command), steps))
    clock = drive.clock - steps * drive.dt
    return replace(drive, lead=drive.lead - steps, command=command, enabled=on, clock=clock, angle=angle)


def _moved(
    nodes: dict[str, np.ndarray], start: Mapping[str, np.ndarray], v: np.ndarray, dt: float, wanted: tuple[str, ...]
) -> dict[str, np.ndarray]:
    """The wanted channels with pose and twist from the body velocity v (B, K, 3) in place of the model's."""
    theta = _sum(start["pose.theta"], v[..., 2] * dt)
    world = _turned(v, 0.5 * (theta[:, 1:] + theta[:, :-1]))
    out = {}
    for c in wanted:
        kind, _, axis = c.partition(".")
        if kind not in ("pose", "twist") or axis not in ("x", "y", "theta"):
            out[c] = nodes[c]
        elif c == "pose.theta":
            out[c] = theta
        elif kind == "pose":
            out[c] = _sum(start[c], world[..., "xy".index(axis)] * dt)
        else:
            rate = world[..., ("x", "y", "theta").index(axis)]
            out[c] = 0.5 * (np.concatenate([rate[:, :1], rate], axis=1) + np.concatenate([rate, rate[:, -1:]], axis=1))
    return out


def _sum(start: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """(B, K + 1) from start (B,) and moves (B, K)."""
    total = np.concatenate([np.zeros((len(moves), 1)), np.cumsum(moves, axis=1)], axis=1)
    return np.asarray(total + np.asarray(start)[:, None])
