"""How what a network adds in each step of a window stacks up to what is measured after it: one record a form."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import Augmented
from residual_mpc.learning.network.residual import Residual

Drive = Callable[[np.ndarray, np.ndarray], np.ndarray]  # x (nx,), u (nu,) -> x a sample later (nx,)


@dataclass(frozen=True, eq=False)
class WindowPrediction:
    """A window of n steps as the model has it: z (n, inputs) what the network saw, physical units; positions
    (n + 1, 3) m, m, rad or m, from the window's beginning on.
    """

    z: np.ndarray
    positions: np.ndarray


class OutputStack(Protocol):
    """Of a window of n steps, positions (n + 1, 3)."""

    def driven(self, drive: Drive, believed: np.ndarray, commands: np.ndarray) -> WindowPrediction:
        """The window with the model's `drive`, from what was believed at its samples, (n, nx), and sent, (n, nu)."""
        ...

    def measured(self, poses: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """(n, 3) the same as measured, from poses (n, channels); on the turn of the circle of positions (n, 3)."""
        ...

    def readout(self, positions: np.ndarray) -> np.ndarray:
        """(3 n, 3 n): what velocities added in each step do to the positions after."""
        ...

    def from_start(self, positions: np.ndarray) -> np.ndarray:
        """(3 n, 3): what an error of the start does to the positions after."""
        ...


@dataclass(frozen=True, eq=False)
class BodyStack:
    """Body velocities added to those of a robot that drives, heading and all."""

    model: Augmented
    residual: Residual

    def driven(self, drive: Drive, believed: np.ndarray, commands: np.ndarray) -> WindowPrediction:
        states = [believed[0]]  # what is learned moves the state itself: one belief, and the model from there on
        for u in commands:
            states.append(drive(states[-1], u))
        x = np.array(states)
        last = [self.model.stepped.states.index(f"last.{o}") for o in self.residual.outputs]
        return WindowPrediction(np.hstack([x[:-1, last], commands]), self.model.outputs(x))

    def measured(self, poses: np.ndarray, positions: np.ndarray) -> np.ndarray:
        y = poses.copy()
        y[:, 2] += 2 * np.pi * np.round((positions[:, 2] - y[:, 2]) / (2 * np.pi))
        return y

    def readout(self, positions: np.ndarray) -> np.ndarray:
        n = len(positions) - 1
        earlier = np.tril(np.ones((n, n)))  # row k: pose after step k; column j: step j
        middle = 0.5 * (positions[1:] + positions[:-1])
        c, s = np.cos(middle[:, 2]), np.sin(middle[:, 2])
        away = positions[1:, None, :2] - middle[None, :, :2]  # (k, j, 2)
        out = np.zeros((3, n, 3, n))
        out[0, :, 0], out[0, :, 1], out[0, :, 2] = earlier * c, -earlier * s, -earlier * away[..., 1]
        out[1, :, 0], out[1, :, 1], out[1, :, 2] = earlier * s, earlier * c, earlier * away[..., 0]
        out[2, :, 2] = earlier
        return self.model.build.dt * out.reshape(3 * n, 3 * n)

    def from_start(self, positions: np.ndarray) -> np.ndarray:
        n = len(positions) - 1
        away = positions[1:, :2] - positions[0, :2]
        out = np.zeros((3, n, 3))
        out[0, :, 0] = out[1, :, 1] = out[2, :, 2] = 1.0
        out[0, :, 2], out[1, :, 2] = -away[:, 1], away[:, 0]
        return out.reshape(3 * n, 3)


@dataclass(frozen=True, eq=False)
class TaskStack:
    """Velocities added to that of an arm's tool, which its joints' angles tell of.

    Each velocity is predicted from the joints as they were believed at its own sample, as in eq. (fk_prop). What is
    learned moves no joint: driven from the window's beginning alone, the model's joints would soon be elsewhere, and
    the network would learn of rates that no controller will ever show it.
    """

    model: Augmented
    residual: Residual

    def driven(self, drive: Drive, believed: np.ndarray, commands: np.ndarray) -> WindowPrediction:
        after = np.array([drive(x, u) for x, u in zip(believed, commands, strict=True)])
        joints = [self.model.stepped.states.index(i.replace("velocity.", "position.")) for i in self.residual.inputs]
        before = self.model.outputs(believed)[:, :3]
        moved = np.cumsum(self.model.outputs(after)[:, :3] - before, axis=0)
        z = (after - believed)[:, joints] / self.model.build.dt
        return WindowPrediction(z, before[0] + np.vstack([np.zeros(3), moved]))

    def measured(self, poses: np.ndarray, positions: np.ndarray) -> np.ndarray:
        at = self.model.stepped.poses
        rows = [self.model.at_rest(dict(zip(at, row.tolist(), strict=True))) for row in poses]
        return self.model.outputs(np.array(rows))[:, :3]

    def readout(self, positions: np.ndarray) -> np.ndarray:
        n = len(positions) - 1
        return self.model.build.dt * np.kron(np.eye(3), np.tril(np.ones((n, n))))

    def from_start(self, positions: np.ndarray) -> np.ndarray:
        return np.kron(np.eye(3), np.ones((len(positions) - 1, 1)))


def stack_of(model: Augmented) -> OutputStack:
    """The one that belongs to the model's network. Raises BadInput where online learning has none."""
    residual = model.residual
    if residual is not None and residual.form == "body" and "pose.theta" in model.stepped.poses:
        return BodyStack(model, residual)
    if residual is not None and residual.form == "task" and len(model.stepped.outputs) >= 3:
        return TaskStack(model, residual)
    raise BadInput(
        "online learning needs a network of form body, or of form task on an arm",
        model.robot.name,
        "augment the model with an untrained Residual of such a form",
    )
