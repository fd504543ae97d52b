"""Rows whose actuators, frictions or torques change from step to step, replayed by a program of their own: what the
program rewrites, and the numbers of the rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from plants.mujoco_robot.native.arms import native_arm
from plants.mujoco_robot.native.changing import COMPILED, Acting, Changing
from plants.mujoco_robot.simulation.fitted_laws import joint_laws
from plants.mujoco_robot.simulation.gear_feedback import Feedback
from plants.mujoco_robot.simulation.servo_integral import ServoIntegrals
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.effects.chain import limits_of, on_errors
from residual_mpc.effects.effect import Effect, Values
from residual_mpc.effects.laws import LEVELS, kind_of
from residual_mpc.effects.library import present
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings

Forces = dict[str, np.ndarray]  # fields of the actuators' forces in a batch
FORCES = ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange")
REACH = 1e30  # in place of an infinite force


def forces_of(batch: Any) -> Forces:
    """The actuators' gains, biases and ranges in the rows, before any effect on their strength."""
    return {name: np.array(batch.expand(name)) for name in FORCES}


@dataclass(eq=False)
class _Columns:
    """Numbers of the rows, one column after another."""

    columns: list[np.ndarray] = field(default_factory=list)

    def add(self, *columns: np.ndarray) -> int:
        """Where they begin."""
        at = len(self.columns)
        self.columns += columns
        return at

    def of(self, effect: Effect, p: Values, places: Sequence[int], **more: Any) -> Acting:
        """An effect with parameters (B, places)."""
        names = [q.name for q in effect.parameters]
        first = self.add(*(np.asarray(p[name])[:, slot] for slot in range(len(places)) for name in names))
        return Acting(effect.name, tuple(int(x) for x in places), first, **more)


def replay_natively(
    batch: Any,
    robot: CompiledRobot,
    settings: Settings,
    drive: Drive,
    u: np.ndarray,
    base: Forces,
    integrals: ServoIntegrals | None,
    servos: Feedback | None,
    records: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Positions, velocities and actuators' forces at the nodes, from the batch's present state on, under commands u
    (B, K, nu); base: see `forces_of`. None where it has to be done step by step."""
    native = native_arm(robot.model)
    if native is None or not set(settings.effects) <= COMPILED:
        return None
    columns = _Columns()
    changing = _changing(batch, robot, settings, drive, base, integrals, servos, records, columns)
    numbers = np.stack([np.broadcast_to(x, len(u)) for x in columns.columns], axis=1)
    sent = u if not changing.switched else np.concatenate([u, np.asarray(drive.enabled, dtype=float)], axis=2)
    return native.changing_rollout(batch, sent, robot.substeps, changing, numbers)


def _changing(
    batch: Any,
    robot: CompiledRobot,
    settings: Settings,
    drive: Drive,
    base: Forces,
    integrals: ServoIntegrals | None,
    servos: Feedback | None,
    records: bool,
    columns: _Columns,
) -> Changing:
    effects, nu, dofs = settings.effects, robot.model.nu, robot.dofs
    made: dict[str, Any] = {"records": records}
    made["clock"] = columns.add(drive.clock + 0.5 * drive.dt, np.full(1, drive.dt))
    strengths, lines = list(present(effects, "strength")), list(present(effects, "speed limit"))
    made["switched"] = drive.enabled is not None
    if drive.enabled is not None or lines or not all(e.steady for e, _ in strengths):
        made["strengths"] = tuple((columns.of(e, p, range(nu)), bool(e.supply)) for e, p in strengths)
        made["lines"] = tuple(columns.of(e, p, range(nu)) for e, p in lines)
        gain, bias, reach = (base[name] for name in FORCES)
        parts = (gain[:, :, :1], bias[:, :, :3], np.clip(reach, -REACH, REACH))
        made["base"] = columns.add(*np.concatenate(parts, axis=2).reshape(len(gain), -1).T)
        limits = limits_of(effects)
        if limits is not None:
            made["reach"] = columns.add(*np.clip(np.stack(limits, axis=2), -REACH, REACH).reshape(len(gain), -1).T)
    varying = list(present(effects, "friction"))
    ruled = dofs[[robot.joints.index(j) for j in robot.sites["law friction"]]]
    rubbing = joint_laws(effects, "law friction")
    if varying or rubbing:
        made["frictions"] = tuple(columns.of(e, p, dofs.tolist()) for e, p in varying)
        made["friction_laws"] = tuple(_law(columns, law, ruled) for law in rubbing)
        made["level"] = columns.add(*batch.expand("dof_frictionloss").T.copy())
    laws = joint_laws(effects, "law")
    if laws:
        places = dofs[[robot.joints.index(j) for j in robot.sites["law"]]]
        made["laws"] = tuple(_law(columns, law, places) for law in laws)
        made["damping"] = columns.add(*batch.expand("dof_damping").T.copy())
    made["errors"] = tuple(columns.of(e, p, range(nu)) for e, p in on_errors(effects, robot.servo))
    if integrals is not None:
        made["integral"] = columns.of(integrals.effect, integrals.p, range(nu))
        ends = (np.clip(x, -REACH, REACH) for x in (integrals.low, integrals.high))
        made["added"] = columns.add(*np.stack([integrals.value, *ends], axis=2).reshape(len(drive.clock), -1).T)
    if servos is not None and robot.gears is not None:
        behind = robot.gears.dofs[servos.gears]
        made["links"] = tuple(zip(servos.actuators.tolist(), behind.tolist(), strict=True))
        made["ratios"] = columns.add(*servos.ratio.T)
    return Changing(len(columns.columns), **made)


def _law(columns: _Columns, law: Any, places: np.ndarray) -> Acting:
    kind = kind_of(law.effect.name)
    last = 0
    if kind is not None and kind.shape == "curve":
        last = max((k for k, name in enumerate(LEVELS) if np.any(law.p[name] != 0.0)), default=0)
    return columns.of(law.effect, law.p, places[law.joints], on=law.on, stretches=last)
