"""One step of an arm with its effects: the command chain, the motion of the joints, and the learned correction.

The state is the positions and velocities of the joints, followed by delayed commands, lag states and the run's clock.
NumPy and CasADi share one CasADi function of the motion: it is called on symbols, and mapped over a batch of arrays.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from plants.mujoco_robot.edits.force_ranges import raised
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.mujoco_robot.structure.force_limits import largest_forces
from plants.mujoco_robot.symbolic.integrals import Integrals
from plants.mujoco_robot.symbolic.motion import forces, motion, tool
from plants.mujoco_robot.symbolic.numbers import Parameters, parameters, unit_of
from plants.mujoco_robot.symbolic.ranges import home, reach, span
from plants.mujoco_robot.symbolic.rigid_joints import with_rigid_joints
from plants.mujoco_robot.symbolic.supported import left_out, refuse_without_step
from residual_mpc.effects.chain import Chain, chain_of
from residual_mpc.effects.laws import reads_clock
from residual_mpc.effects.library import BY_NAME
from residual_mpc.effects.ops import Array, Kinks, Ops, casadi_ops
from residual_mpc.errors import BadInput
from residual_mpc.export.soften import kinks as kinks_of
from residual_mpc.extras import extra
from residual_mpc.models.settings import Settings
from residual_mpc.models.stepping import Correction, StepOptions, Stepped

TOOL = ("tool.x", "tool.y", "tool.z")  # m
SMALL = 1e-6  # of a command's reach, for a difference quotient


@dataclass(frozen=True, eq=False)
class ArmStep:
    """The step of a robot with its parameters and chains of effects."""

    robot: CompiledRobot
    parameters: Parameters
    options: StepOptions
    servos: Chain  # effects on the commands of position servos
    others: Chain  # effects on the commands of the other actuators
    errors: Chain  # effects on the errors of position servos

    @cached_property
    def states(self) -> tuple[str, ...]:
        """Names of the states: positions, velocities, then memory."""
        joints = self.robot.joints
        names = [*(f"position.{j}" for j in joints), *(f"velocity.{j}" for j in joints)]
        names += [*self.servos.states, *self.others.states, *self.integrals.states]
        names += [f"last.{s}" for s in self.options.remember]
        names += [f"disturbance.{s}" for s in self.options.disturbances]
        if any(reads_clock(BY_NAME[e]) for e in self.parameters.effects):
            names.append("clock")
        return tuple(names)

    @cached_property
    def signals(self) -> tuple[str, ...]:
        """Signals that a correction reads or adds to, or to which an unknown constant may be added."""
        r = self.robot
        own = [f"{kind}.{j}" for kind in ("position", "velocity", "acceleration", "torque") for j in r.joints]
        return (*own, *(f"{kind}.{a}" for kind in ("command", "ahead") for a in r.actuators))

    @cached_property
    def integrals(self) -> Integrals:
        """The integral parts of position servos."""
        return Integrals(self.robot, self.parameters, self.errors, self.options.dt)

    @cached_property
    def _motions(self) -> dict[float, Any]:
        """Motion functions by the width of the rounded kinks."""
        return {}

    @cached_property
    def _forces(self) -> Any:
        return forces(self.robot, self.parameters, self.errors, kinks_of(casadi_ops(), 0.0))

    @cached_property
    def _tool(self) -> Any:
        return tool(self.robot, self.parameters)

    def __call__(
        self,
        kinks: Kinks,
        x: Sequence[Array],
        u: Sequence[Array],
        p: Sequence[Array],
        correction: Correction | None,
    ) -> tuple[Array, ...]:
        robot, dt, n = self.robot, self.options.dt, len(self.robot.joints)
        now = dict(zip(self.states, x, strict=True))
        new: dict[str, Array] = {}
        q, v = list(x[:n]), list(x[n : 2 * n])

        arrived = self._arrived(kinks, u, p, now, new)
        push = [now.get(f"disturbance.torque.{j}", 0.0) for j in robot.joints]
        clock = now["clock"] + 0.5 * dt if "clock" in now else 0.0
        told = arrived
        arrived = self.integrals.added(told, q, p, now, 0.5 * dt)
        ahead, speed = _called(self._motion(kinks.width), [q, v, arrived, list(p), push, [clock]])
        added = self._added(now, u, correction)
        for i, joint in enumerate(robot.joints):
            more = added.get(f"acceleration.{joint}", 0.0)
            new[f"position.{joint}"] = ahead[i] + 0.5 * dt * dt * more
            new[f"velocity.{joint}"] = speed[i] + dt * more
        after = [new[f"position.{joint}"] for joint in robot.joints]
        new |= self.integrals.after(kinks, told, (q, after), p, now, clock)
        new |= {s: now[s] for s in self.states if s.startswith("disturbance.")}
        if "clock" in now:
            new["clock"] = now["clock"] + dt
        return tuple(new[s] for s in self.states)

    def effort(self, kinks: Kinks, x: Sequence[Array], u: Sequence[Array], p: Sequence[Array]) -> tuple[Array, ...]:
        """(nu,) actuator forces at the beginning of the step before any force limit, N m (N)."""
        n, now = len(self.robot.joints), dict(zip(self.states, x, strict=True))
        arrived = self.integrals.added(self._arrived(kinks, u, p, now, {}), x[:n], p, now, 0.0)
        columns = [list(x[:n]), list(x[n : 2 * n]), arrived, list(p), [now.get("clock", 0.0)]]
        return tuple(_called(self._forces, columns)[0])

    def _arrived(
        self, kinks: Kinks, u: Sequence[Array], p: Sequence[Array], now: Mapping[str, Array], new: dict[str, Array]
    ) -> list[Array]:
        """(nu,) commands after their chain of effects; writes the next memory states into `new`."""

        def values(effect: str, target: str) -> dict[str, Array]:
            return self.parameters.values(effect, target, p)

        return [
            (self.servos if servo else self.others)(kinks, name, u[i], values, now, new)
            for i, (name, servo) in enumerate(zip(self.robot.actuators, self.robot.servo.tolist(), strict=True))
        ]

    def output(self, p: Sequence[float]) -> Callable[[Ops, Sequence[Array]], tuple[Array, ...]]:
        """The position of the payload site, m, as a function of the state, with the link lengths of p."""

        def place(ops: Ops, x: Sequence[Array]) -> tuple[Array, ...]:
            return tuple(_called(self._tool, [list(x[: len(self.robot.joints)]), list(p)])[0])

        return place

    def resting(self, pose: Mapping[str, float]) -> np.ndarray:
        """(nx,) at rest at these positions, by default `home`; delayed commands are those that hold it there."""
        at = home(self.robot)
        at |= {c: x for c, x in pose.items() if c in at}
        x = np.array([at.get(name, 0.0) for name in self.states])
        n = len(self.robot.joints)
        held = self._held(x) - _unloaded(self.robot, x[:n])
        command = dict(zip(self.robot.actuators, self.holding(x).tolist(), strict=True))

        def values(effect: str, target: str) -> dict[str, float]:
            return self.parameters.values(effect, target, self.parameters.now)

        known = {"clock": self.options.clock, **self.integrals.holding(held)}
        for chain in (self.servos, self.others):
            known |= chain.resting({a: command[a] for a in chain.targets}, values)
        return np.array([known.get(name, value) for name, value in zip(self.states, x.tolist(), strict=True)])

    def holding(self, x: np.ndarray) -> np.ndarray:
        """(nu,) commands that hold the joints at rest against gravity, within the commands' ranges; a servo with an
        integral part is told where its joint is."""
        own = np.isin(self.robot.actuators, self.integrals.actuators)
        return np.where(own, _unloaded(self.robot, x[: len(self.robot.joints)]), self._held(x))

    def _held(self, x: np.ndarray) -> np.ndarray:
        """(nu,) setpoints that hold the joints at rest, whether or not an integral part makes up a part of them."""
        robot, n = self.robot, len(self.robot.joints)
        u = _unloaded(robot, x[:n])
        push, clock = np.zeros(n), x[self.states.index("clock")] if "clock" in self.states else 0.0
        ranges = reach(robot, largest_forces(robot.model.actuator_forcerange))
        low, high = (np.array(side) for side in zip(*ranges, strict=True))
        small = SMALL * (high - low)  # too small for a force to leave its range
        gap = self._pulled(x[:n], u, push, clock)
        slope = np.stack([self._pulled(x[:n], u + e, push, clock) - gap for e in np.diag(small)], axis=1)
        held = u - small * np.linalg.lstsq(slope, gap, rcond=1e-9)[0]
        return np.asarray(np.clip(held, low, high))

    def _pulled(self, q: np.ndarray, u: np.ndarray, push: np.ndarray, clock: float) -> np.ndarray:
        """(n,) velocity after one step from rest, without friction and dead zones."""
        still = [0.0 if _stalls(n.effect, n.parameter) or n.stalls else n.value for n in self.parameters.numbers]
        return np.array(self._motion(0.0)(q, np.zeros(len(q)), u, still, push, clock)[1]).ravel()

    def _motion(self, width: float) -> Any:
        if width not in self._motions:
            how = kinks_of(casadi_ops(), width)
            self._motions[width] = motion(self.robot, self.parameters, self.errors, how, self.options.dt)
        return self._motions[width]

    def _added(self, now: Mapping[str, Array], u: Sequence[Array], correction: Correction | None) -> dict[str, Array]:
        """The learned correction, from the signals at the beginning of the step."""
        if correction is None:
            return {}
        robot = self.robot
        signals = {s: now[s] for s in self.states if s.startswith(("position.", "velocity."))}
        for i, (name, joint) in enumerate(zip(robot.actuators, robot.actuator_joints, strict=True)):
            signals[f"command.{name}"] = u[i]
            signals[f"ahead.{name}"] = u[i] - now[f"position.{joint}"]
        found = dict(correction(signals))
        if set(found) - set(self.options.corrected):
            raise KeyError(f"a correction may add only to {self.options.corrected}, got {sorted(found)}")
        return found


def arm_step(robot: CompiledRobot, settings: Settings, options: StepOptions, task: bool) -> Stepped:
    """The step of a robot on a fixed base. task: whether it tracks its tool (the payload site) or its joints.

    Raises BadInput for a robot that the step cannot express, settings of several rows, or an unknown signal.
    """
    robot, settings, rigid = with_rigid_joints(robot, settings)
    refuse_without_step(robot)
    if settings.rows != 1:
        raise BadInput(f"a step needs settings with one row, got {settings.rows}", robot.name)
    with extra("arm"):
        import adam
        import casadi
    assert adam and casadi
    numbers = parameters(robot, settings)
    effects = {e: settings.effects[e] for e in numbers.effects}
    servo = tuple(a for a, own in zip(robot.actuators, robot.servo, strict=True) if own)
    other = tuple(a for a in robot.actuators if a not in servo)
    step = ArmStep(
        robot, numbers, options,
        chain_of(effects, ("command",), servo, options.dt, on_error=False),
        chain_of(effects, ("command",), other, options.dt),
        chain_of(effects, ("command",), servo, options.dt, on_error=True),
    )  # fmt: skip
    unknown = {*options.remember, *options.corrected, *options.disturbances} - {*step.signals}
    if unknown or options.remember:
        raise BadInput(
            f"unknown signal {', '.join(sorted(unknown) or options.remember)}", robot.name,
            "corrections may add to acceleration.*, disturbances to torque.*, and no signal can be remembered",
        )  # fmt: skip
    poses = tuple(f"position.{j}" for j in robot.joints)
    most = largest_forces(raised(robot.model.actuator_forcerange[None], effects)[0])
    return Stepped(
        options.dt,
        step.states,
        poses,
        tuple(unit_of(s, robot.sliding) for s in step.states),
        robot.actuators,
        numbers.numbers,
        step.signals,
        step.resting({}),
        step,
        outputs=TOOL if task else (),
        output_units=("m",) * 3 if task else (),
        output=step.output(numbers.now) if task else None,
        resting=step.resting,
        holding=step.holding,
        reach=reach(robot, most),
        left_out=(*numbers.left_out, *rigid, *left_out(robot.model)),
        spans=tuple(span(robot, j) for j in robot.joints),
        rates=tuple(f"velocity.{j}" for j in robot.joints),
        effort=step.effort,
        strengths=tuple(most.tolist()),
    )


def _unloaded(robot: CompiledRobot, q: np.ndarray) -> np.ndarray:
    """(nu,) commands that would hold the joints at q (n,) without gravity."""
    length = robot.model.actuator_gear[:, 0] * q[robot.driven]
    return np.where(robot.servo, length, 0.0)


def _stalls(effect: str, parameter: str) -> bool:
    return effect in BY_NAME and parameter in BY_NAME[effect].stalls


def _called(function: Any, arguments: Sequence[Sequence[Array]]) -> list[list[Array]]:
    """A CasADi function of columns on lists of scalars: symbols, or numbers and arrays of one batch."""
    import casadi as ca

    if any(isinstance(a, ca.SX | ca.MX) for column in arguments for a in column):
        return [ca.vertsplit(r) for r in _results(function(*[ca.vertcat(*column) for column in arguments]))]
    batch = np.broadcast_shapes(*(np.shape(a) for column in arguments for a in column))
    count = int(np.prod(batch))
    columns = [
        np.stack([np.broadcast_to(a, batch).ravel() for a in c]) if c else np.zeros((0, count)) for c in arguments
    ]
    found = _results(function.map(count)(*columns) if count != 1 else function(*columns))
    return [[row.reshape(batch) for row in np.array(r)] for r in found]


def _results(found: Any) -> list[Any]:
    return list(found) if isinstance(found, tuple | list) else [found]
