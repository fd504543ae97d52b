"""Rows whose actuators, frictions or torques change from step to step, replayed by a program of their own: what the
program rewrites, and the numbers of the rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from plants.mujoco_robot.edits.force_ranges import raised
from plants.mujoco_robot.native.arm import field_of, numbers_of
from plants.mujoco_robot.native.arms import Rolled, native_arm
from plants.mujoco_robot.native.chain import ARM, LINK
from plants.mujoco_robot.native.changing import COMPILED, NOMINAL, Acting, Changing, Weight
from plants.mujoco_robot.native.running import Running
from plants.mujoco_robot.simulation.fitted_laws import JointLaw, joint_laws
from plants.mujoco_robot.simulation.gear_feedback import Feedback
from plants.mujoco_robot.simulation.servo_integral import ServoIntegrals
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.effects.chain import limits_of, on_errors
from residual_mpc.effects.effect import Effect, Values
from residual_mpc.effects.laws import kind_of, stretches_of
from residual_mpc.effects.library import changes, present
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings

Fields = dict[str, np.ndarray]  # of a batch
FORCES = ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange")  # as they are before any effect weakens them
RESISTANCES = ("dof_frictionloss", "dof_damping")  # with what is constant, before anything changes
REACH = 1e30  # in place of an infinite force


def copied(batch: Any, fields: Sequence[str]) -> Fields:
    """The fields in the rows, as they are now."""
    return {name: np.array(batch.expand(name)) for name in fields}


@dataclass(eq=False)
class _Columns:
    """Numbers of the rows, one column after another."""

    columns: list[np.ndarray] = field(default_factory=list)

    def add(self, *columns: np.ndarray) -> int:
        """Where they begin."""
        at = len(self.columns)
        self.columns += columns
        return at

    def stacked(self, rows: int) -> np.ndarray:
        """(rows, columns)"""
        return np.stack([np.broadcast_to(x, rows) for x in self.columns], axis=1)

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
    base: Fields,
    integrals: ServoIntegrals | None,
    servos: Feedback | None,
    records: bool,
) -> Rolled | None:
    """The batch from its present state on, under commands u (B, K, nu); base: FORCES and RESISTANCES. None where it has
    to be done step by step."""
    native = native_arm(robot)
    if native is None or not set(settings.effects) <= COMPILED:
        return None
    columns = _Columns()
    changing = _changing(batch, robot, settings, drive, base, integrals, servos, records, columns)
    sent = u if not changing.switched else np.concatenate([u, np.asarray(drive.enabled, dtype=float)], axis=2)
    return native.changing_rollout(batch, sent, robot.substeps, changing, columns.stacked(len(u)))


def run_natively(
    batch: Any,
    robot: CompiledRobot,
    settings: Settings,
    drive: Drive,
    base: Fields | None,
    integrals: ServoIntegrals | None,
    servos: Feedback | None,
    steps: int,
) -> Running | None:
    """The batch's rows, to go on by so many steps of the robot at a time; base: see `replay_natively`, None where
    nothing changes between steps. None where MuJoCo has to do it."""
    native = native_arm(robot)
    if native is None or not set(settings.effects) <= COMPILED:
        return None
    if base is None:
        return native.running(batch, steps, robot.substeps, None, None)
    columns = _Columns()
    changing = _changing(batch, robot, settings, drive, base, integrals, servos, False, columns)
    return native.running(batch, steps, robot.substeps, changing, columns.stacked(settings.rows))


def lead_natively(
    batch: Any, robot: CompiledRobot, u: np.ndarray, rows: np.ndarray, servos: Feedback | None
) -> np.ndarray:
    """Move some rows (m,) of a batch to where commands u (B, K, nu) lead; returns those that MuJoCo has to move."""
    native, q, v = native_arm(robot), batch.bind("qpos"), batch.bind("qvel")
    if native is None:
        return rows
    if servos is None:
        rolled = native.rollout(batch, u, (0,), robot.substeps, lambda k: None)
    else:
        columns = _Columns()
        clock = columns.add(np.zeros(1), np.zeros(1))
        changing = _with_links(Changing(0, clock), robot, servos, columns)
        rolled = native.changing_rollout(batch, u, robot.substeps, changing, columns.stacked(len(u)))
    if rolled is None:
        return rows
    done = rows[rolled.exact[rows]]
    q[done], v[done] = rolled.positions[done, -1], rolled.velocities[done, -1]
    return rows[~rolled.exact[rows]]


def _with_links(changing: Changing, robot: CompiledRobot, servos: Feedback, columns: _Columns) -> Changing:
    """With servos that see the link, the last of what is rewritten."""
    assert robot.gears is not None
    behind = robot.gears.dofs[servos.gears]
    links = tuple(zip(servos.actuators.tolist(), behind.tolist(), strict=True))
    ratios = columns.add(*servos.ratio.T)
    return replace(changing, links=links, ratios=ratios, count=len(columns.columns))


def _changing(
    batch: Any,
    robot: CompiledRobot,
    settings: Settings,
    drive: Drive,
    base: Fields,
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
        parts = (gain[:, :, :1], bias[:, :, :3], np.clip(raised(reach, effects), -REACH, REACH))
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
        made["level"] = columns.add(*base["dof_frictionloss"].T)
    laws = joint_laws(effects, "law")
    if laws:
        places = dofs[[robot.joints.index(j) for j in robot.sites["law"]]]
        made["laws"] = tuple(_law(columns, law, places) for law in laws)
        made["damping"] = columns.add(*base["dof_damping"].T)
    share = changes(effects, "compensated gravity")
    if share is not None and np.any(share):
        made["weight"] = _weight(columns, robot, share, drive.setting)
    made["errors"] = tuple(columns.of(e, p, range(nu)) for e, p in on_errors(effects, robot.servo))
    if integrals is not None:
        made["integral"] = columns.of(integrals.effect, integrals.p, range(nu))
        ends = (np.clip(x, -REACH, REACH) for x in (integrals.low, integrals.high))
        numbers = np.stack([integrals.value, *ends, integrals.derivative_time], axis=2)
        made["added"] = columns.add(*numbers.reshape(len(drive.clock), -1).T)
    changing = Changing(len(columns.columns), **made)
    return changing if servos is None else _with_links(changing, robot, servos, columns)


def _weight(columns: _Columns, robot: CompiledRobot, share: np.ndarray, setting: np.ndarray | None) -> Weight:
    """What share (B, 1) of the nominal model's weight is compensated; setting: see Drive."""
    models = [part.model for part in robot.settings] or [robot.model]
    numbers = np.stack([_nominal(model) for model in models])
    first = columns.add(share[:, 0], *(numbers[0] if setting is None else numbers[setting]).T)
    seen = robot.gears is None or robot.servo_feedback == "link"
    return Weight(first, () if seen or robot.gears is None else tuple(robot.gears.dofs.tolist()))


def _nominal(model: Any) -> np.ndarray:
    """Gravity, then of each link of a model as its file has it the joint's place, the mass and its centre."""
    row = numbers_of(model, partial(field_of, model), np.zeros((1, model.nv)))[0]
    links = row[ARM : ARM + LINK * model.nv].reshape(model.nv, LINK)[:, :NOMINAL]
    return np.concatenate([row[1:ARM], links.ravel()])


def _law(columns: _Columns, law: JointLaw, places: np.ndarray) -> Acting:
    kind = kind_of(law.effect.name)
    rising = stretches_of(law.p) if kind is not None and kind.shape == "curve" else 0
    return columns.of(law.effect, law.p, places[law.joints].tolist(), on=law.on, stretches=rising)
