"""The record of a compiled robot: what its model consists of, where it is in the model's arrays, and its names."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from plants.mujoco_robot.structure.base import PLANAR, Base, hinges_and_slides
from plants.mujoco_robot.structure.force_limits import largest_forces
from plants.mujoco_robot.structure.gears import Gears
from plants.mujoco_robot.structure.lengths import Lengths
from plants.mujoco_robot.structure.loops import Loops
from plants.mujoco_robot.structure.wheels import Wheels, find_wheels
from residual_mpc.effects.library import Sites, slots_of
from residual_mpc.effects.sensor import EVERY_SENSOR
from residual_mpc.models.protocol import State

if TYPE_CHECKING:
    import mujoco

POSITION, VELOCITY, TORQUE = "position", "velocity", "torque"


@dataclass(frozen=True, eq=False)  # two compiled models are the same robot only if they are the same object
class CompiledRobot:
    """A compiled model of hinge and slide joints, on a base that is fixed or drives."""

    name: str
    model: "mujoco.MjModel"
    payload: tuple[int, np.ndarray]  # body, position in its frame (3,) m
    servo_feedback: str
    position_sensor: str
    base: Base | None = None  # of a robot that drives
    loops: Loops | None = None  # of a robot with closed chains
    spec: "mujoco.MjSpec | None" = None  # what the model was compiled from, for effects that change its structure
    gears: Gears | None = None  # of a robot whose motors and links were told apart
    settings: "tuple[CompiledRobot, ...]" = ()  # where several settings were merged: the robot in each
    differing: tuple[str, ...] = ()  # the model fields in which they differ
    finer: int = 1  # simulation steps in one of the robot's
    own: "CompiledRobot | None" = None  # of a robot with a longer step: the same with the step of the model file
    longer: int = 1  # steps of the model file in one of the robot's
    held: tuple[str, ...] = ()  # actuators of the model file that act on no joint and are not commanded
    # (3, 3) the payload site's axes in its body's frame
    payload_axes: np.ndarray = field(default_factory=lambda: np.eye(3), kw_only=True)
    speed_limits: Mapping[str, float] = field(default_factory=dict, kw_only=True)  # of joints, rad/s or m/s

    @cached_property
    def actuators(self) -> tuple[str, ...]:
        return tuple(self.model.actuator(i).name for i in range(self.model.nu))

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Hinge and slide joints; a driving robot's free joint is its `base`."""
        return tuple(self.model.joint(j).name for j in self.numbers.tolist())

    @cached_property
    def numbers(self) -> np.ndarray:
        """(joints,) number of each joint in the model."""
        every = hinges_and_slides(self.model)
        return every if self.gears is None else np.setdiff1d(every, self.gears.numbers)

    @cached_property
    def places(self) -> np.ndarray:
        """(joints,) where each joint is in qpos."""
        return np.asarray(self.model.jnt_qposadr[self.numbers])

    @cached_property
    def dofs(self) -> np.ndarray:
        """(joints,) where each joint is in qvel."""
        return np.asarray(self.model.jnt_dofadr[self.numbers])

    @cached_property
    def links(self) -> tuple[str, ...]:
        return tuple(self.model.body(b).name or f"body{b}" for b in range(1, self.model.nbody))

    @cached_property
    def command_kinds(self) -> tuple[str, ...]:
        bias = self.model.actuator_biasprm
        return tuple(
            POSITION if bias[i, 1] != 0 else VELOCITY if bias[i, 2] != 0 else TORQUE for i in range(self.model.nu)
        )

    @cached_property
    def servo(self) -> np.ndarray:
        """(nu,) bool: which actuators are position servos."""
        return np.array([kind == POSITION for kind in self.command_kinds])

    @cached_property
    def actuator_joints(self) -> tuple[str, ...]:
        """The joint that each actuator drives."""
        return tuple(self.joints[i] for i in self.driven.tolist())

    @cached_property
    def driven(self) -> np.ndarray:
        """(nu,) index in `joints` of the joint that each actuator drives."""
        return np.searchsorted(self.numbers, self.model.actuator_trnid[:, 0])

    @property
    def gear_ratios(self) -> tuple[float, ...]:
        """The torque (force) at the joint per unit of each actuator's force."""
        return tuple(self.model.actuator_gear[:, 0].tolist())

    @cached_property
    def sliding(self) -> frozenset[str]:
        """Joints that slide; the others turn."""
        import mujoco

        slide = int(mujoco.mjtJoint.mjJNT_SLIDE)
        types = self.model.jnt_type[self.numbers]
        return frozenset(j for j, kind in zip(self.joints, types.tolist(), strict=True) if kind == slide)

    @property
    def payload_place(self) -> tuple[float, float, float, float]:
        """The number of the body that holds the payload, and where, m in its frame."""
        body, (x, y, z) = self.payload[0], self.payload[1].tolist()
        return float(body), x, y, z

    @cached_property
    def limits(self) -> Mapping[str, tuple[float, float]]:
        """Range of each joint that has one, rad or m."""
        m = self.model
        return {
            j: (float(m.jnt_range[i, 0]), float(m.jnt_range[i, 1]))
            for i, j in zip(self.numbers.tolist(), self.joints, strict=True)
            if m.jnt_limited[i]
        }

    @cached_property
    def clamps(self) -> Mapping[str, tuple[float, float]]:
        """Range of each actuator's command that the model clips."""
        ranges = zip(self.actuators, self.model.actuator_ctrlrange.tolist(), strict=True)
        limited = self.model.actuator_ctrllimited.astype(bool).tolist()
        return {a: (low, high) for (a, (low, high)), clips in zip(ranges, limited, strict=True) if clips}

    @cached_property
    def force_limits(self) -> Mapping[str, float]:
        """Largest force of each actuator that the model limits, N m or N."""
        most = zip(self.actuators, largest_forces(self.model.actuator_forcerange).tolist(), strict=True)
        return {a: f for a, f in most if np.isfinite(f)}

    @cached_property
    def command_limits(self) -> Mapping[str, tuple[float, float]]:
        """Range of each actuator's command: its own, else of a position servo that of its joint."""
        m, out = self.model, {}
        for i, (name, kind) in enumerate(zip(self.actuators, self.command_kinds, strict=True)):
            joint, gear = self.joints[self.driven[i]], float(m.actuator_gear[i, 0])
            if name in self.clamps:
                out[name] = self.clamps[name]
            elif kind == POSITION and joint in self.limits:
                low, high = sorted(gear * x for x in self.limits[joint])
                out[name] = (low, high)
        return out

    @cached_property
    def rest(self) -> Mapping[str, float]:
        """Where joints are that nobody measures, by channel: as the model is drawn."""
        q = self.model.qpos0[self.places].tolist()
        return {f"position.{j}": x for j, x in zip(self.joints, q, strict=True) if j not in self.passive}

    @property
    def passive(self) -> tuple[str, ...]:
        """Joints without a motor whose angles follow from the others', because a closed chain holds them."""
        return () if self.loops is None else self.loops.passive

    @cached_property
    def states(self) -> tuple[State, ...]:
        joints = tuple(State(f"position.{j}", f"velocity.{j}") for j in self.joints if j not in self.passive)
        return joints if self.base is None else (*(State(f"pose.{a}", f"twist.{a}") for a in PLANAR), *joints)

    @cached_property
    def channels(self) -> tuple[str, ...]:
        joints = (*(f"position.{j}" for j in self.joints), *(f"velocity.{j}" for j in self.joints))
        return joints if self.base is None else (*(f"{k}.{a}" for k in ("pose", "twist") for a in PLANAR), *joints)

    @cached_property
    def wheels(self) -> Wheels | None:
        """Of a robot that drives."""
        return None if self.base is None else find_wheels(self.model, self.base)

    @cached_property
    def geared(self) -> tuple[str, ...]:
        """Joints between whose motor and link there may be a spring or play: a motor drives them, and they are alone in
        their body.

        None of a robot with closed chains, whose loops would have to be closed through the springs, nor of one that
        drives, whose wheels' speeds at the start follow from the ground and not from the motor.
        """
        if self.gears is not None:
            return self.gears.names
        if self.spec is None or self.base is not None or self.loops is not None:
            return ()
        driven, alone = set(self.driven.tolist()), self.model.body_jntnum[self.model.jnt_bodyid[self.numbers]] == 1
        return tuple(j for i, j in enumerate(self.joints) if i in driven and alone[i])

    @cached_property
    def with_gears(self) -> "dict[tuple[str, ...], CompiledRobot]":
        """Memory of split_gears: joints -> this robot with their motors and links apart."""
        return {}

    @cached_property
    def lengths(self) -> Lengths | None:
        """Of an open chain on a fixed base: elsewhere another length opens a loop, or moves a wheel off the ground."""
        return Lengths(self.model) if self.base is None and self.loops is None else None

    @property
    def step(self) -> float:
        return float(self.model.opt.timestep) * self.finer

    @property
    def substeps(self) -> int:
        """Steps of the model in one of the robot's."""
        return self.finer * (1 if self.gears is None else self.gears.substeps)

    @cached_property
    def sites(self) -> Sites:
        """Where effects can act."""
        robot, lengths = (self.name,), () if self.lengths is None else self.lengths.links
        return {
            **dict.fromkeys(("command", "strength", "limit", "speed limit"), self.actuators),
            "servo": tuple(a for a, own in zip(self.actuators, self.servo.tolist(), strict=True) if own),
            "position gain": self._damped_servos,
            **dict.fromkeys(("dry friction", "friction", "damping", "rotor"), self.joints),
            **dict.fromkeys(("elastic", "stop", "law", "law friction"), self._not_rolling),
            **dict.fromkeys(("play", "spring"), self.geared),
            "gravity": robot if self.base is None and self.model.opt.gravity.any() else (),
            "compensation": robot if self._may_be_compensated else (),
            **dict.fromkeys(("tool", "samples"), robot),
            "link": self.links,
            "length": tuple(self.links[b - 1] for b in lengths),
            "rolling": () if self.wheels is None else robot,
            **self._sensor_sites,
        }

    @property
    def _damped_servos(self) -> tuple[str, ...]:
        """Position servos with damping of their own; of one without it the position gain is the actuator's gain."""
        models = [part.model for part in self.settings] or [self.model]
        damped = self.servo & np.all([m.actuator_biasprm[:, 2] < 0.0 for m in models], axis=0)
        return tuple(a for a, own in zip(self.actuators, damped.tolist(), strict=True) if own)

    @property
    def _may_be_compensated(self) -> bool:
        """Whether its motors can bear its weight beside their commands: of an open chain on a fixed base, if the model
        does not compensate gravity itself."""
        fixed = self.base is None and self.loops is None
        return fixed and bool(self.model.opt.gravity.any()) and not self.model.body_gravcomp.any()

    @cached_property
    def _not_rolling(self) -> tuple[str, ...]:
        """The joints but for wheels."""
        if self.base is None:
            return self.joints
        return tuple(j for j, rolls in zip(self.joints, self.base.rolling, strict=True) if not rolls.any())

    @property
    def _sensor_sites(self) -> Sites:
        if self.base is None:
            encoders = tuple(f"position.{j}" for j in self.joints)
            return {
                **dict.fromkeys(("delay", "filter"), self.joints),
                **dict.fromkeys(("offset", "range"), encoders),
                "encoder": tuple(f"position.{j}" for j in self.joints if j not in self.sliding),
                "clock": (EVERY_SENSOR,),
            }
        others = self._not_rolling
        return {  # a wheel's angle is not measured, and says nothing of where the robot is
            **dict.fromkeys(("delay", "filter"), ("pose", *others)),
            **dict.fromkeys(("offset", "range"), ("pose.theta", *(f"position.{j}" for j in others))),
            "encoder": tuple(f"position.{j}" for j in others if j not in self.sliding),
            "clock": ("pose",),
            "point": (self.name,),
        }

    def slots(self, effect: str) -> tuple[str, ...]:
        return slots_of(effect, self.sites)
