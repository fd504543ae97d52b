"""The integral parts of position servos in the step of a robot: one state each, added to the setpoint."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.mujoco_robot.symbolic.numbers import Parameters
from plants.mujoco_robot.symbolic.torques import JointTorques
from residual_mpc.effects.chain import Chain
from residual_mpc.effects.ops import Array, Kinks
from residual_mpc.effects.position_servo import SERVO_INTEGRAL, held_integral


@dataclass(frozen=True, eq=False)
class Integrals:
    """errors: effects on the errors of position servos; dt: s, of the step."""

    robot: CompiledRobot
    parameters: Parameters
    errors: Chain
    dt: float

    @cached_property
    def actuators(self) -> tuple[str, ...]:
        """Those that have an integral part."""
        here = {slot for effect, slot, _ in self.parameters.index if effect == SERVO_INTEGRAL.name}
        return tuple(a for a in self.robot.actuators if a in here or (here == {""} and self.robot.servo.all()))

    @property
    def states(self) -> tuple[str, ...]:
        """Names of what they add to the setpoints."""
        return tuple(self._state(a) for a in self.actuators)

    def added(
        self, told: Sequence[Array], q: Sequence[Array], p: Sequence[Array], now: Mapping[str, Array], ahead: float
    ) -> list[Array]:
        """(nu,) setpoints at joint positions q (n,) for commands told (nu,), `ahead` s after the states `now`."""
        out = list(told)
        for i, a in self._numbered():
            out[i] = out[i] + self._stepped(i, now[self._state(a)], self._error(i, told, q), p, ahead)
        return out

    def after(
        self, kinks: Kinks, told: Sequence[Array], q: tuple[Sequence[Array], Sequence[Array]], p: Sequence[Array],
        now: Mapping[str, Array], clock: Array,
    ) -> dict[str, Array]:  # fmt: skip
        """The states after the step, by the trapezoidal rule over the positions q before and after it."""
        torques = JointTorques(self.robot, self.parameters, self.errors, kinks)
        out = {}
        for i, a in self._numbered():
            error = 0.5 * (self._error(i, told, q[0]) + self._error(i, told, q[1]))
            before = now[self._state(a)]
            x = self._stepped(i, before, error, p, self.dt)
            low, high = torques.integral_range(i, p, clock)
            if low is not None:
                damped = torques.derivative_time(i, p) * self._speed(i, q)
                x = held_integral(kinks.exact, before, x, error, damped, low, high)
            out[self._state(a)] = x
        return out

    def holding(self, held: np.ndarray) -> dict[str, float]:
        """The states that add `held` (nu,)."""
        return {self._state(a): float(held[i]) for i, a in self._numbered()}

    def _numbered(self) -> list[tuple[int, str]]:
        return [(self.robot.actuators.index(a), a) for a in self.actuators]

    def _error(self, i: int, told: Sequence[Array], q: Sequence[Array]) -> Array:
        gear = float(self.robot.model.actuator_gear[i, 0])
        return told[i] - gear * q[int(self.robot.driven[i])]

    def _speed(self, i: int, q: tuple[Sequence[Array], Sequence[Array]]) -> Array:
        """Of the actuator over the step, command unit/s."""
        gear, joint = float(self.robot.model.actuator_gear[i, 0]), int(self.robot.driven[i])
        return gear * (q[1][joint] - q[0][joint]) / self.dt

    def _stepped(self, i: int, x: Array, error: Array, p: Sequence[Array], dt: float) -> Array:
        assert SERVO_INTEGRAL.step is not None
        values = self.parameters.values(SERVO_INTEGRAL.name, self.robot.actuators[i], p)
        return SERVO_INTEGRAL.step(None, values, x, error, dt)

    def _state(self, actuator: str) -> str:
        return f"{SERVO_INTEGRAL.label}.{actuator}"
