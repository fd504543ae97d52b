"""A MuJoCo robot as the diagnosis sees it: bounds, typical sizes, the batched replay, the simulator, the export."""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np

from plants.mujoco_robot.drawing.outline import outline
from plants.mujoco_robot.drawing.renderer import shade
from plants.mujoco_robot.drawing.skeleton import skeleton
from plants.mujoco_robot.edits.batch import tunable_values
from plants.mujoco_robot.edits.bounds import PhysicalBounds, bounds_of_all
from plants.mujoco_robot.edits.reference import reference
from plants.mujoco_robot.exports.actuators import actuator_values, not_of_actuators
from plants.mujoco_robot.exports.sysid import to_sysid
from plants.mujoco_robot.exports.urdf import compare_urdf, to_urdf
from plants.mujoco_robot.loading.contacts import overlaps, without_contacts
from plants.mujoco_robot.loading.held import held_joints
from plants.mujoco_robot.mjcf import to_mjcf
from plants.mujoco_robot.simulation.replay import replay
from plants.mujoco_robot.simulation.simulator import CorrectedMujoco
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.mujoco_robot.structure.ranges import with_ranges
from plants.mujoco_robot.structure.setpoints import steady_setpoints
from plants.mujoco_robot.structure.variants import merge
from plants.mujoco_robot.symbolic.rigid_joints import rigid_joints
from plants.mujoco_robot.symbolic.step import arm_step
from residual_mpc.models.actuator_values import ActuatorValues
from residual_mpc.models.drawing import Camera, Motion, Size
from residual_mpc.models.optional import USUAL_PERIOD, Range
from residual_mpc.models.protocol import Drive
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Knob, Settings, Values
from residual_mpc.models.simulating import Exported, Mjcf, SysidSet
from residual_mpc.models.stepping import BODY, StepOptions, Stepped

PERIOD = 0.02  # s between commands of an arm


@dataclass(frozen=True, eq=False)
class MujocoRobot(CompiledRobot):
    """A compiled robot that keeps the protocols `Robot`, `Merging`, `Simulating` and `WritesMjcf`.

    It adds their methods to the record and overrides nothing: the protocols want most of the record's names anyway.
    """

    def merged(self, others: "Sequence[MujocoRobot]") -> "MujocoRobot | None":
        """This robot and others as one, whose settings are told apart by Drive.setting; None where that cannot be."""
        return merge((self, *others))

    def with_ranges(self, joints: Mapping[str, Range], commands: Mapping[str, Range]) -> "MujocoRobot":
        """See residual_mpc.models.optional.Widening."""
        return with_ranges(self, joints, commands)

    def overlaps(self, positions: Mapping[str, np.ndarray]) -> dict[tuple[str, str], np.ndarray]:
        """See residual_mpc.models.optional.Touching."""
        return overlaps(self, positions)

    def without_contacts(self, pairs: Sequence[tuple[str, str]]) -> "MujocoRobot":
        """See residual_mpc.models.optional.Touching."""
        return without_contacts(self, pairs)

    @cached_property
    def held_joints(self) -> tuple[str, ...]:
        """See residual_mpc.models.optional.HeldJoints."""
        return held_joints(self)

    @cached_property
    def _bounds(self) -> tuple[PhysicalBounds, ...]:
        """In each of the settings that were merged."""
        return tuple(PhysicalBounds(part) for part in self.settings or (self,))

    @property
    def rough(self) -> bool:
        """See residual_mpc.models.optional.Rough: a robot that drives rests on contacts."""
        return self.base is not None

    def with_half_step(self) -> "MujocoRobot | None":
        """See residual_mpc.models.optional.HalvingStep; None for a robot of several settings."""
        return self._halved

    @cached_property
    def _halved(self) -> "MujocoRobot | None":
        if self.settings:
            return None
        model, spec = copy(self.model), None if self.spec is None else self.spec.copy()
        model.opt.timestep *= 0.5
        if spec is not None:
            spec.option.timestep *= 0.5
        return replace(self, model=model, spec=spec, finer=2 * self.finer)

    def with_longer_step(self, times: int) -> "MujocoRobot | None":
        """See residual_mpc.models.optional.LengtheningStep; None for a robot on wheels, whose contacts need theirs."""
        if self.base is not None or self.finer != 1:
            return None
        if times not in self._longer:
            model = copy(self.model)
            model.opt.timestep *= times
            self._longer[times] = replace(self, model=model, own=self, longer=times)
        return self._longer[times]

    @cached_property
    def _longer(self) -> "dict[int, MujocoRobot]":
        return {}

    def bounds(self, effect: str, parameter: str, slot: str | None) -> tuple[float, float]:
        return bounds_of_all(self._bounds, effect, parameter, slot)

    def reference(self, kind: str, slot: str | None) -> float:
        return reference(self, kind, slot)

    def steady_setpoints(self, motion: Mapping[str, np.ndarray]) -> np.ndarray:
        return steady_setpoints(self, motion)

    def nominal(self) -> Mapping[str, float]:
        return self._nominal

    @cached_property
    def _nominal(self) -> Mapping[str, float]:
        return MappingProxyType(tunable_values(self.model))

    def replay(
        self, start: Mapping[str, np.ndarray], drive: Drive, settings: Settings, wanted: tuple[str, ...]
    ) -> Mapping[str, np.ndarray]:
        return replay(self, start, drive, settings, wanted)

    def to_mjcf(self, settings: Settings, folder: Path) -> Mjcf:
        return to_mjcf(self, settings, folder)

    def to_urdf(self, settings: Settings, file: RobotFile, folder: Path) -> Exported:
        assert file.model is not None
        return to_urdf(self, settings, file.model, folder)

    def compare_urdf(self, made: Exported, settings: Settings, file: RobotFile, path: Path) -> tuple[float, float, int]:
        return compare_urdf(self, made, settings, path, file)

    def to_sysid(self, values: Values, intervals: Mapping[Knob, tuple[float, float]], folder: Path) -> SysidSet:
        return to_sysid(self, values, intervals, folder)

    def actuator_values(self, settings: Settings) -> tuple[ActuatorValues, ...]:
        return actuator_values(self, settings)

    def not_of_actuators(self, settings: Settings) -> tuple[str, ...]:
        return not_of_actuators(settings)

    def skeleton(self, motion: Motion) -> np.ndarray:
        """See residual_mpc.models.drawing.Skeletal."""
        return skeleton(self, motion)

    def shade(self, motions: Sequence[Motion], camera: Camera, size: Size) -> np.ndarray:
        """See residual_mpc.models.drawing.Rendering."""
        return shade(self, motions, camera, size)

    @property
    def outline(self) -> np.ndarray | None:
        """See residual_mpc.models.drawing.Outlined; None of a robot that does not drive."""
        return None if self.base is None else outline(self, self.base)

    def simulator(self, settings: Settings, rows: int, period: float) -> CorrectedMujoco:
        return CorrectedMujoco(self, settings, rows, period)


@dataclass(frozen=True, eq=False)
class SteppingMujoco(MujocoRobot):
    """A robot from a user's own model file, which adds the protocol `Stepping`.

    task: whether controllers track the position of the tool (the payload site) or those of the joints.
    """

    task: bool = False

    @property
    def period(self) -> float:
        """s between commands."""
        return PERIOD if self.base is None else USUAL_PERIOD

    @property
    def disturbed(self) -> tuple[str, ...]:
        if self.base is not None:
            return BODY
        rigid = rigid_joints(self)
        return tuple(f"torque.{j}" for j in self.joints if j not in rigid)

    def one_step(self, settings: Settings, options: StepOptions) -> Stepped:
        """See residual_mpc.models.stepping.Stepping."""
        return arm_step(self, settings, options, self.task)
