"""Joint torques of servos, motors, springs and dampers, with the effects on them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plants.mujoco_robot.edits.force_ranges import raise_factor
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.mujoco_robot.structure.force_limits import NO_LIMIT
from plants.mujoco_robot.structure.servo_damping import share_left
from plants.mujoco_robot.symbolic.implicit import Torques
from plants.mujoco_robot.symbolic.numbers import Parameters
from residual_mpc.effects.chain import Chain, scaled
from residual_mpc.effects.effect import Site
from residual_mpc.effects.laws import NEAR, rounded, slope
from residual_mpc.effects.library import BY_NAME, changes, elastic_line, fitted_laws, present
from residual_mpc.effects.ops import Array, Kinks, clip
from residual_mpc.extras import extra


@dataclass(frozen=True, eq=False)
class JointTorques:
    """The torque laws of a robot's actuators and joints. errors: effects on the errors of position servos. In its
    methods, clock is the time since the run began, s, at the middle of the step.
    """

    robot: CompiledRobot
    parameters: Parameters
    errors: Chain
    kinks: Kinks

    def torques(
        self, q: Sequence[Any], v: Sequence[Any], u: Sequence[Any], p: Sequence[Any], clock: Any,
        change: tuple[Sequence[Any], float] | None = None,
    ) -> Torques:  # fmt: skip
        """The torques at positions q, velocities v (n,) and commands u (nu,) after their chain of effects.

        change: (estimated change of the velocities, length of the step in s). A force that would leave its range by the
        end of the step is held at the limit; without `change` no force is limited.
        """
        robot, n = self.robot, len(q)
        given: list[Any] = [0.0] * n
        damping: list[Any] = [0.0] * n
        stiffness: list[Any] = [0.0] * n
        for i, joint in enumerate(robot.driven.tolist()):
            by, h = (0.0, 0.0) if change is None else (change[0][joint], change[1])
            force, slope, spring = self._force(i, q[joint], v[joint], u[i], p, clock, (by, h) if change else None)
            gear = float(robot.model.actuator_gear[i, 0])
            given[joint] = given[joint] + gear * force
            damping[joint] = damping[joint] + gear * gear * slope
            stiffness[joint] = stiffness[joint] + gear * gear * spring
        whole = list(given)
        for j in range(n):
            number = int(robot.model.dof_jntid[robot.dofs[j]])
            if robot.model.jnt_actfrclimited[number] and change is not None:
                low, high = robot.model.jnt_actfrcrange[number].tolist()
                laws = whole[j], damping[j], stiffness[j]
                whole[j], damping[j], stiffness[j] = self._limited(*laws, v[j], change[0][j], change[1], low, high)
            given[j], yields = whole[j], (damping[j], stiffness[j])
            drag, spring = self._damping(j, p), float(robot.model.jnt_stiffness[number])
            rest = float(robot.model.qpos_spring[robot.places[j]])
            beside = self.parameters.at(robot.joints[j], p, "elastic")
            at_zero, more = elastic_line(self.kinks.exact, beside) or (0.0, 0.0)
            whole[j] = whole[j] - drag * v[j] - spring * (q[j] - rest) + at_zero - more * q[j]
            damping[j], stiffness[j] = damping[j] + drag, stiffness[j] + spring + more
            law, by_speed, by_position = self._law(j, self._signals(j, q, v, u, given, clock), yields, p)
            whole[j], damping[j], stiffness[j] = whole[j] + law, damping[j] - by_speed, stiffness[j] - by_position
        return Torques(whole, damping, stiffness, self._dry(q, v, u, given, p, clock))

    def forces(self, q: Sequence[Any], v: Sequence[Any], u: Sequence[Any], p: Sequence[Any], clock: Any) -> list[Any]:
        """(nu,) actuator forces before any force limit."""
        driven = enumerate(self.robot.driven.tolist())
        return [self._force(i, q[joint], v[joint], u[i], p, clock, None)[0] for i, joint in driven]

    def integral_range(self, i: int, p: Sequence[Any], clock: Any) -> tuple[Any, Any]:
        """The limits of an actuator's force over its stiffness, command unit; (None, None) without any."""
        name = self.robot.actuators[i]
        supply, law = self._strength(name, p, clock)
        low, high = self._range(i, name, supply, p, 0.0)
        stiff = law * self._position_gain(i, p)
        return (None, None) if low is None else (low / stiff, high / stiff)

    def derivative_time(self, i: int, p: Sequence[Any]) -> Any:
        """A position servo's damping over its stiffness, s."""
        return self._velocity_gain(i, p) / self._position_gain(i, p)

    def rotors(self, p: Sequence[Any]) -> list[Any]:
        """(n,) rotor inertias reflected to the joints, kg m^2."""
        out = []
        for joint in self.robot.joints:
            own = self.parameters.own(f"joint.{joint}.armature", p)
            out.append(self._never_below_zero(own, changes(self.parameters.at(joint, p, "rotor"), "rotor inertia")))
        return out

    def limits(self, p: Sequence[Any]) -> bool:
        """Whether any force is limited."""
        model, robot = self.robot.model, self.robot
        ranges = any(self._range(i, a, 1.0, p, 0.0)[0] is not None for i, a in enumerate(robot.actuators))
        return ranges or bool(model.jnt_actfrclimited.any())

    def _force(
        self, i: int, q: Any, v: Any, u: Any, p: Sequence[Any], clock: Any, change: tuple[Any, float] | None
    ) -> tuple[Any, Any, Any]:
        """An actuator's force, and minus its derivatives with respect to the rate of its length and its length."""
        model, name = self.robot.model, self.robot.actuators[i]
        gear = float(model.actuator_gear[i, 0])
        kp, kv = self._position_gain(i, p), self._velocity_gain(i, p)
        constant, by_length = float(model.actuator_biasprm[i, 0]), float(model.actuator_biasprm[i, 1])
        spring = -by_length * kp / float(model.actuator_gainprm[i, 0]) if by_length else 0.0
        supply, law = self._strength(name, p, clock)
        length, seen = gear * q, 1.0
        if self.robot.servo[i] and self.errors.effects:
            error, seen = self._error(name, u - length, p)
            u = length + error
        affine = constant if model.actuator_biastype[i] else 0.0
        force = law * (kp * u + affine - spring * length - kv * gear * v)
        slope, hold = law * kv, law * (spring - kp * (1.0 - seen)) if by_length else 0.0
        low, high = self._range(i, name, supply, p, gear * v) if change is not None else (None, None)
        if low is None or change is None:
            return force, slope, hold
        return self._limited(force, slope, hold, gear * v, gear * change[0], change[1], low, high)

    def _limited(
        self, force: Any, slope: Any, hold: Any, rate: Any, change: Any, h: float, low: Any, high: Any
    ) -> tuple[Any, Any, Any]:
        """A force and its coefficients, unchanged if it is within its range at the end of the step, else constant."""
        after = force - slope * change - h * hold * (rate + change)
        over, under = after >= high, after <= low  # comparisons have no derivative
        where = self.kinks.exact.where
        return (
            where(over, high, where(under, low, force)),
            where(over, 0.0, where(under, 0.0, slope)),
            where(over, 0.0, where(under, 0.0, hold)),
        )

    def _strength(self, name: str, p: Sequence[Any], clock: Any) -> tuple[Any, Any]:
        """Factors of effects on the supply, and of all effects on strength."""
        effects = self.parameters.at(name, p, "strength")
        here = list(present(effects, "strength"))
        ops = self.kinks.exact
        supply = scaled(ops, [(e, x) for e, x in here if e.supply], 1.0, clock, 0.0)
        return supply, scaled(ops, [(e, x) for e, x in here if not e.supply], supply, clock, 0.0)

    def _range(self, i: int, name: str, supply: Any, p: Sequence[Any], rate: Any) -> tuple[Any, Any]:
        """Lowest and highest force at this rate of the actuator's length; (None, None) without a limit."""
        own = self.robot.model.actuator_forcerange[i].tolist()
        limits = list(present(self.parameters.at(name, p, "limit"), "limit"))
        lines = list(present(self.parameters.at(name, p, "speed limit"), "speed limit"))
        if not limits and not lines and max(map(abs, own)) >= 0.5 * NO_LIMIT:
            return None, None
        most: Any = NO_LIMIT
        for effect, values in limits:
            assert effect.step is not None
            most, _ = effect.step(self.kinks.exact, values, (), most, 0.0, 0.0)
        factor = raise_factor(self.kinks.exact, max(map(abs, own)), most) if limits else 1.0
        low, high = (supply * factor * x for x in own)
        for effect, values in limits:
            assert effect.step is not None
            low, high = (effect.step(self.kinks.exact, values, (), y, 0.0, 0.0)[0] for y in (low, high))
        for effect, values in lines:
            assert effect.step is not None
            least, most = effect.step(self.kinks.exact, values, rate)
            low, high = (clip(self.kinks.exact, x, least, most) for x in (low, high))
        return low, high

    def _error(self, name: str, error: Any, p: Sequence[Any]) -> tuple[Any, Any]:
        """A servo's position error after the effects on it, and its derivative with respect to the true error."""
        with extra("mpc"):
            import casadi as ca

        e = ca.SX.sym("e")
        seen = self.errors(self.kinks, name, e, lambda effect, t: self.parameters.values(effect, t, p), {}, {})
        both = ca.substitute([seen, ca.jacobian(seen, e)], [e], [ca.SX(error)])
        return both[0], both[1]

    def _damping(self, j: int, p: Sequence[Any]) -> Any:
        joint = self.robot.joints[j]
        own = self.parameters.own(f"joint.{joint}.damping", p)
        return self._never_below_zero(own, self._friction(joint, p))

    def _friction(self, joint: str, p: Sequence[Any]) -> Array | None:
        """The viscous friction that is added to a joint; None without."""
        return changes(self.parameters.at(joint, p, "damping"), "viscous damping")

    def _position_gain(self, i: int, p: Sequence[Any]) -> Any:
        """An actuator's own, scaled where it is a position servo; of a motor the force per unit of its command."""
        name = self.robot.actuators[i]
        own = self.parameters.own(f"actuator.{name}.kp", p)
        factor = changes(self.parameters.at(name, p, "position gain"), "servo stiffness")
        return own if factor is None else own * factor

    def _velocity_gain(self, i: int, p: Sequence[Any]) -> Any:
        """An actuator's own, less what a negative friction takes from its servo."""
        robot, ops, j = self.robot, self.kinks.exact, int(self.robot.driven[i])
        own = self.parameters.own(f"actuator.{robot.actuators[i]}.kv", p)
        added = self._friction(robot.joints[j], p)
        if added is None or not robot.servo[i] or isinstance(own, float) and own <= 0.0:
            return own
        taken = ops.maximum(-(self.parameters.own(f"joint.{robot.joints[j]}.damping", p) + added), 0.0)
        given: Any = 0.0
        for k in np.flatnonzero(robot.servo & (robot.driven == j)).tolist():
            gain = self.parameters.own(f"actuator.{robot.actuators[k]}.kv", p)
            given = given + ops.maximum(gain, 0.0) * float(robot.model.actuator_gear[k, 0]) ** 2
        here = present(self.parameters.at(robot.actuators[i], p, "strength"), "strength")
        strength = scaled(ops, [(e, x) for e, x in here if e.steady], 1.0, 0.0, 0.0)
        return own * share_left(ops, taken, given, strength)

    def _never_below_zero(self, own: Array, change: Array | None) -> Array:
        return own if change is None else self.kinks.exact.maximum(own + change, 0.0)

    def _signals(
        self, j: int, q: Sequence[Any], v: Sequence[Any], u: Sequence[Any], given: Sequence[Any], clock: Any
    ) -> dict[str, Any]:
        """What a fitted law on a joint is a function of."""
        sent = next((u[i] for i, joint in enumerate(self.robot.driven.tolist()) if joint == j), 0.0)
        return {"position": q[j], "speed": v[j], "command": sent, "load": given[j], "time": clock}

    def _law(self, j: int, signals: dict[str, Any], yields: tuple[Any, Any], p: Sequence[Any]) -> tuple[Any, Any, Any]:
        """The torque of the fitted laws on a joint, and its derivatives by speed and position; yields: minus those of
        the actuators' torque."""
        laws = self.parameters.at(self.robot.joints[j], p, "law")
        if not laws:
            return 0.0, 0.0, 0.0
        slopes = []
        for name in ("speed", "position", "load"):

            def law(z: Any, name: str = name) -> Any:
                return fitted_laws(rounded(self.kinks), laws, "law", {**signals, name: z})

            torque, by = slope(law, signals[name], NEAR)
            slopes.append(by)
        by_speed, by_position, by_load = slopes
        by_load = self.kinks.exact.maximum(by_load, -1.0)  # no load makes an actuator push less than nothing
        return torque, by_speed - by_load * yields[0], by_position - by_load * yields[1]

    def _dry(
        self, q: Sequence[Any], v: Sequence[Any], u: Sequence[Any], given: Sequence[Any], p: Sequence[Any], clock: Any
    ) -> list[Any] | None:
        """Levels of dry friction, N m (N); None without friction."""
        ops, robot = self.kinks.exact, self.robot
        sites: tuple[Site, ...] = ("dry friction", "friction", "law friction")
        tuned = any((n.parameter.endswith(".frictionloss")) for n in self.parameters.numbers)
        if not tuned and not any(BY_NAME[e].place in sites for e in self.parameters.effects):
            return None
        out = []
        for j, joint in enumerate(robot.joints):
            level = self.parameters.own(f"joint.{joint}.frictionloss", p)
            for effect, values in present(self.parameters.at(joint, p, *sites[:2]), *sites[:2]):
                assert effect.step is not None
                level = level + effect.step(ops, values, v[j], given[j])
            laws = self.parameters.at(joint, p, sites[2])
            if laws:
                signals = self._signals(j, q, v, u, given, clock)
                level = level + fitted_laws(rounded(self.kinks), laws, sites[2], signals)
            out.append(ops.maximum(level, 0.0))
        return out


def dry_clip(kinks: Kinks) -> Any:
    """(x, bound) -> x limited to +-bound, for dry friction. Its derivative at the bound is 0, even if the bound is 0:
    otherwise a joint at rest without friction would seem to stick."""
    if kinks.width > 0.0:
        return lambda x, bound: clip(kinks.rough(1.0), x, -bound, bound)
    ops = kinks.exact
    return lambda x, bound: ops.where(x < bound, ops.where(x > -bound, x, -bound), bound)
