"""The arm as the paper's task-space model has it: joint angles, servos without inertia, no physics engine; batched."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from plants.scaler_arm.dynamics.gravity import masses
from plants.scaler_arm.dynamics.servo import Load, Servo, advance, weights
from plants.scaler_arm.dynamics.step import RATES, arm_step, nominal
from plants.scaler_arm.kinematics.forward import chain
from plants.scaler_arm.kinematics.geometry import MOTORS, SCALER, Arm
from plants.scaler_arm.kinematics.skeleton import skeleton
from plants.scaler_arm.robot import with_servo
from residual_mpc.effects.body import TOOL_AXES
from residual_mpc.effects.chain import command_chain, on_errors, scaled
from residual_mpc.effects.library import BY_NAME, Effects, Sites, changes, present, slots_of
from residual_mpc.effects.ops import NUMPY
from residual_mpc.models.drawing import Motion
from residual_mpc.models.protocol import Drive, State
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Settings
from residual_mpc.models.stepping import StepOptions, Stepped

FARTHEST_TOOL = 0.15  # m: half of the arm's reach


@dataclass(frozen=True)
class ServoArm:
    """See `residual_mpc.models.protocol.Robot`. Commands are motor angles in rad."""

    name: str
    arm: Arm = SCALER
    actuators: tuple[str, ...] = MOTORS
    command_kinds: tuple[str, ...] = ("position",) * len(MOTORS)

    @property
    def step(self) -> float:
        return self.arm.period

    @property
    def period(self) -> float:
        """s between commands."""
        return self.arm.period

    @property
    def disturbed(self) -> tuple[str, ...]:
        return RATES

    @property
    def states(self) -> tuple[State, ...]:
        return tuple(State(f"position.{m}", None) for m in MOTORS)

    @property
    def channels(self) -> tuple[str, ...]:
        return (*(f"position.{m}" for m in MOTORS), *RATES)

    @property
    def limits(self) -> Mapping[str, tuple[float, float]]:
        return dict(zip(MOTORS, self.arm.limits, strict=True))

    def skeleton(self, motion: Motion) -> np.ndarray:
        """See residual_mpc.models.drawing.Skeletal."""
        return skeleton(self.arm, motion)

    @property
    def sites(self) -> Sites:
        """Where effects can act. No delay of readings: in a log the few ms that the servos' inertia takes, which this
        model lacks, would pass for one."""
        return {
            **dict.fromkeys(("command", "strength", "position gain", "dry friction", "damping"), MOTORS),
            **dict.fromkeys(("tool", "samples"), (self.name,)),
            **dict.fromkeys(("offset", "range", "encoder"), tuple(f"position.{m}" for m in MOTORS)),
        }

    def slots(self, effect: str) -> tuple[str, ...]:
        return slots_of(effect, self.sites)

    def bounds(self, effect: str, parameter: str, slot: str | None) -> tuple[float, float]:
        least: dict[str | None, float] = {
            "viscous damping": -0.9 * self.arm.servo.damping,
            "dry friction": 0.0,
            "tool mass": -0.9 * self.arm.gripper_body.mass,
        }
        quantity = BY_NAME[effect].parameter(parameter).quantity
        if quantity in TOOL_AXES.values():
            return -FARTHEST_TOOL, FARTHEST_TOOL
        return least.get(quantity, -np.inf), np.inf

    def reference(self, kind: str, slot: str | None) -> float:
        return {"mass": 0.1, "inertia": self.arm.servo.armature, "length": 0.1}.get(kind, 1.0)

    def nominal(self) -> Mapping[str, float]:
        return nominal(self.arm)

    def one_step(self, settings: Settings, options: StepOptions) -> Stepped:
        """See residual_mpc.models.stepping.Stepping."""
        return arm_step(self.arm, self.name, settings, options, self.slots)

    def replay(
        self, start: Mapping[str, np.ndarray], drive: Drive, settings: Settings, wanted: tuple[str, ...]
    ) -> Mapping[str, np.ndarray]:
        effects, dt = settings.effects, drive.dt
        u = command_chain(effects, drive.command, drive.lead, dt, np.zeros(len(MOTORS), dtype=bool))
        number = {n: settings.tuned.get(n, np.full(settings.rows, v)) for n, v in self.nominal().items()}
        bare = [
            Servo(number[f"actuator.{m}.kp"], number[f"actuator.{m}.kv"], number[f"joint.{m}.damping"]) for m in MOTORS
        ]
        tool = changes(effects, "tool mass")
        bodies = {n: number[f"body.{n}.mass"] for n in masses(self.arm)}
        offset = [changes(effects, quantity) for quantity in TOOL_AXES.values()]
        beside = [x[:, 0] for x in offset if x is not None] if any(x is not None and x.any() for x in offset) else None
        load = Load(bodies, 0.0 if tool is None else tool[:, 0], {}, {}, beside)
        errors = on_errors(effects, np.ones(len(MOTORS), dtype=bool))
        q = np.stack([start[f"position.{m}"] for m in MOTORS], axis=-1).astype(np.float64)
        nodes = np.empty((settings.rows, drive.steps + 1, len(MOTORS)))
        rates, force = np.empty_like(nodes), np.empty_like(nodes)
        nodes[:, 0] = q
        links = chain(self.arm)
        for k in range(drive.steps):
            weight = weights(NUMPY, self.arm, links, [*q.T], load)
            new = np.empty_like(q)
            for i in range(len(MOTORS)):
                law = _with_effects(bare[i], i, effects, drive.clock + (k + 0.5) * dt, dt)
                error = u[:, k, i] - q[:, i]
                for effect, p in errors:
                    assert effect.step is not None
                    error, _ = effect.step(NUMPY, {k: v[:, i] for k, v in p.items()}, (), error, dt)
                move = advance(NUMPY, NUMPY, law, error, weight[i], dt)
                if drive.enabled is not None:  # a motor that is off is braked by its gear
                    move = move * drive.enabled[:, k, i]
                new[:, i] = q[:, i] + move
                rates[:, k + 1, i] = move / dt
                force[:, k, i] = law.kp * error - law.kv * move / dt
            q = new
            nodes[:, k + 1] = q
        rates[:, 0] = rates[:, 1] if drive.steps else 0.0
        force[:, -1] = force[:, -2] if drive.steps else 0.0
        kinds = {"position": nodes, "velocity": rates, "output": force}
        split = {c: c.split(".") for c in wanted}
        return {c: np.ascontiguousarray(kinds[kind][..., MOTORS.index(m)]) for c, (kind, m) in split.items()}


def build(robot: RobotFile) -> ServoArm:
    """The robot of a file whose plant is `scaler_arm_servo`, or of that name alone.

    Raises BadInput for a parameter that is unknown or not positive.
    """
    return ServoArm(robot.name, with_servo(SCALER, robot))


def _with_effects(law: Servo, i: int, effects: Effects, clock: np.ndarray, dt: float) -> Servo:
    """Motor i's law in every row."""
    damping = changes(effects, "viscous damping")
    b = law.b if damping is None else law.b + damping[:, i]
    mine = [(e, {k: v[:, i] for k, v in p.items()}) for e, p in present(effects, "strength")]
    stiffness = changes(effects, "servo stiffness")
    kp, kv = law.kp if stiffness is None else law.kp * stiffness[:, i], law.kv
    for one in mine:
        scale = scaled(NUMPY, [one], 1.0, clock, dt)
        kp, kv = scale * kp, scale * kv
    level: np.ndarray | None = None
    for effect, p in present(effects, "dry friction"):
        assert effect.step is not None
        more = effect.step(NUMPY, {k: v[:, i] for k, v in p.items()}, kp, kp)
        level = more if level is None else level + more
    return Servo(kp, kv, b, level)
