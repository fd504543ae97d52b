"""A MuJoCo robot as the diagnosis sees it: names, slots, bounds, and the batched replay."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from plants.mujoco_robot.base import PLANAR, Base, hinges_and_slides
from plants.mujoco_robot.edits import tunable_values
from plants.mujoco_robot.gears import Gears, split, splittable
from plants.mujoco_robot.lengths import Lengths
from plants.mujoco_robot.loops import Loops
from plants.mujoco_robot.physical import largest_inertias, largest_torques, physical_bounds
from plants.mujoco_robot.replay import replay
from plants.mujoco_robot.variants import merge
from plants.mujoco_robot.wheels import Wheels, find_wheels
from residual_mpc.effects.library import Sites, slots_of
from residual_mpc.models.protocol import Drive, State
from residual_mpc.models.settings import Settings
from residual_mpc.models.simulating import Mjcf

if TYPE_CHECKING:
    import mujoco

    from plants.mujoco_robot.corrected import CorrectedMujoco

PLAY = 0.25  # of what a wheel may have: 0.008 to 0.13 rad between an arm's motor and link
POSITION, VELOCITY, TORQUE = "position", "velocity", "torque"


@dataclass(frozen=True, eq=False)  # two compiled models are the same robot only if they are the same object
class MujocoRobot:
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
    settings: "tuple[MujocoRobot, ...]" = ()  # where several settings were merged: the robot in each
    differing: tuple[str, ...] = ()  # the model fields in which they differ
    held: tuple[str, ...] = ()  # actuators of the model file that act on no joint and are not commanded

    @cached_property
    def actuators(self) -> tuple[str, ...]:
        return tuple(self.model.actuator(i).name for i in range(self.model.nu))

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Hinge and slide joints; a driving robot's free joint is its `base`."""
        return tuple(self.model.joint(j).name for j in self._numbers.tolist())

    @cached_property
    def _numbers(self) -> np.ndarray:
        every = hinges_and_slides(self.model)
        return every if self.gears is None else np.setdiff1d(every, self.gears.numbers)

    @cached_property
    def places(self) -> np.ndarray:
        """(joints,) where each joint is in qpos."""
        return np.asarray(self.model.jnt_qposadr[self._numbers])

    @cached_property
    def dofs(self) -> np.ndarray:
        """(joints,) where each joint is in qvel."""
        return np.asarray(self.model.jnt_dofadr[self._numbers])

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
        return np.searchsorted(self._numbers, self.model.actuator_trnid[:, 0])

    @cached_property
    def sliding(self) -> frozenset[str]:
        """Joints that slide; the others turn."""
        import mujoco

        slide = int(mujoco.mjtJoint.mjJNT_SLIDE)
        types = self.model.jnt_type[self._numbers]
        return frozenset(j for j, kind in zip(self.joints, types.tolist(), strict=True) if kind == slide)

    @cached_property
    def limits(self) -> Mapping[str, tuple[float, float]]:
        """Range of each joint that has one, rad or m."""
        m = self.model
        return {
            j: (float(m.jnt_range[i, 0]), float(m.jnt_range[i, 1]))
            for i, j in zip(self._numbers.tolist(), self.joints, strict=True)
            if m.jnt_limited[i]
        }

    @cached_property
    def command_limits(self) -> Mapping[str, tuple[float, float]]:
        """Range of each actuator's command: its own, else of a position servo that of its joint."""
        m, out = self.model, {}
        for i, (name, kind) in enumerate(zip(self.actuators, self.command_kinds, strict=True)):
            joint, gear = self.joints[self.driven[i]], float(m.actuator_gear[i, 0])
            if m.actuator_ctrllimited[i]:
                out[name] = (float(m.actuator_ctrlrange[i, 0]), float(m.actuator_ctrlrange[i, 1]))
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
        """Joints between whose motor and link there may be a spring or play."""
        return splittable(self) if self.gears is None else self.gears.names

    def split(self, joints: tuple[str, ...]) -> "MujocoRobot":
        """This robot with motor and link of these joints apart; made once."""
        if joints not in self._split:
            parts = [split(part, joints) for part in self.settings or (self,)]
            whole = merge(parts) if self.settings else parts[0]
            assert whole is not None, "settings that were merged differ in numbers alone"
            self._split[joints] = whole
        return self._split[joints]

    @cached_property
    def _split(self) -> "dict[tuple[str, ...], MujocoRobot]":
        return {}

    @cached_property
    def lengths(self) -> Lengths | None:
        """Of an open chain on a fixed base: elsewhere another length opens a loop, or moves a wheel off the ground."""
        return Lengths(self.model) if self.base is None and self.loops is None else None

    @property
    def step(self) -> float:
        return float(self.model.opt.timestep)

    @property
    def substeps(self) -> int:
        """Steps of the model in one of the robot's."""
        return 1 if self.gears is None else self.gears.substeps

    def merged(self, others: "Sequence[MujocoRobot]") -> "MujocoRobot | None":
        """This robot and others as one, whose settings are told apart by Drive.setting; None where that cannot be."""
        return merge((self, *others))

    @cached_property
    def sites(self) -> Sites:
        """Where effects can act."""
        robot, lengths = (self.name,), () if self.lengths is None else self.lengths.links
        return {
            **dict.fromkeys(("command", "strength", "limit"), self.actuators),
            **dict.fromkeys(("dry friction", "friction", "damping", "rotor"), self.joints),
            **dict.fromkeys(("play", "spring"), self.geared),
            **dict.fromkeys(("tool", "samples"), robot),
            "link": self.links,
            "length": tuple(self.links[b - 1] for b in lengths),
            "rolling": () if self.wheels is None else robot,
            **self._sensor_sites,
        }

    @property
    def _sensor_sites(self) -> Sites:
        if self.base is None:
            return {"delay": self.joints, "offset": tuple(f"position.{j}" for j in self.joints)}
        others = tuple(j for j, rolls in zip(self.joints, self.base.rolling, strict=True) if not rolls.any())
        return {  # a wheel's angle is not measured, and says nothing of where the robot is
            "delay": ("pose", *others),
            "offset": ("pose.theta", *(f"position.{j}" for j in others)),
            "point": (self.name,),
        }

    def slots(self, effect: str) -> tuple[str, ...]:
        return slots_of(effect, self.sites)

    @cached_property
    def inertias(self) -> np.ndarray:
        """(joints,) kg m^2 (kg): the most that each joint carries."""
        return largest_inertias(self)

    @cached_property
    def torques(self) -> np.ndarray:
        """(joints,) N m (N): the most that the actuators of each joint give; inf where the model sets no limit."""
        return largest_torques(self)

    def bounds(self, effect: str, parameter: str, slot: str | None) -> tuple[float, float]:
        return physical_bounds(self, effect, parameter, slot)

    def reference(self, kind: str, slot: str | None) -> float:
        m = self.model
        if kind == "inertia":
            inertia = m.dof_M0[self.dofs]
            return float(np.median(inertia) if slot is None else inertia[self.joints.index(slot)])
        if kind == "mass":
            body = self.payload[0] if slot is None or slot not in self.links else self.links.index(slot) + 1
            return float(max(m.body_mass[body], 0.1 * m.body_mass[1:].sum() / (m.nbody - 1)))
        if kind == "play":
            return PLAY
        if kind == "length":
            return float(max(np.linalg.norm(m.body_pos[1:], axis=1).mean(), 1e-3))
        return 1.0

    def nominal(self) -> Mapping[str, float]:
        return tunable_values(self.model)

    def replay(
        self, start: Mapping[str, np.ndarray], drive: Drive, settings: Settings, wanted: tuple[str, ...]
    ) -> Mapping[str, np.ndarray]:
        return replay(self, start, drive, settings, wanted)

    def to_mjcf(self, settings: Settings, folder: Path) -> Mjcf:
        from plants.mujoco_robot.mjcf import to_mjcf

        return to_mjcf(self, settings, folder)

    def simulator(self, settings: Settings, rows: int, period: float) -> "CorrectedMujoco":
        from plants.mujoco_robot.corrected import CorrectedMujoco

        return CorrectedMujoco(self, settings, rows, period)
