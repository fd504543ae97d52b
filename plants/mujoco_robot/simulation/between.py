"""What is rewritten in a batch between its steps: actuators that weaken or are switched off, frictions and torques that
change."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from plants.mujoco_robot.edits.force_ranges import raised
from plants.mujoco_robot.edits.split_gears import STIFF_SOLIMP, shares_behind
from plants.mujoco_robot.simulation.fitted_laws import any_law, joint_laws, law_torques, levels, loads, signals_of
from plants.mujoco_robot.simulation.gear_feedback import link_servos
from plants.mujoco_robot.simulation.gravity_compensation import compensating, unknown_weight
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.effects.chain import limits_of, on_errors, scaled
from residual_mpc.effects.effect import Effect, Values
from residual_mpc.effects.library import present
from residual_mpc.effects.ops import NUMPY
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings, is_null


def changing(robot: CompiledRobot, settings: Settings, wanted: tuple[str, ...]) -> np.ndarray:
    """(B,) bool: rows that need a word between the steps."""
    if any(c.startswith("output.") for c in wanted) or len(link_servos(robot)):
        return np.ones(settings.rows, dtype=bool)
    slow = unknown_weight(robot, settings)
    effects = settings.effects
    unsteady = [e for e, _ in present(effects, "strength", "limit", "speed limit", "friction") if not e.steady]
    for effect in (*unsteady, *(e for e, _ in on_errors(effects, robot.servo))):
        slow |= ~is_null(effect.name, effects[effect.name]).all(axis=1)
    for effect, p in present(effects, "servo", "compensation"):
        slow |= ~is_null(effect.name, p).all(axis=1)
    for law in any_law(effects):
        slow |= ~is_null(law, effects[law]).all(axis=1)
    return slow


def between_steps(batch: Any, robot: CompiledRobot, settings: Settings, drive: Drive) -> list[Any]:
    """Functions (step, joint speeds (B, njnt), last actuator force (B, nu)) that rewrite the batch before a step."""
    updates = []
    actuators = _actuator_scale(batch, robot, settings, drive)
    if actuators is not None:
        updates.append(actuators)
    frictions = _friction(batch, robot, settings, drive)
    if frictions is not None:
        updates.append(frictions)
    laws = law_torques(batch, robot, settings, drive)
    if laws is not None:
        updates.append(laws)
    compensation = compensating(batch, robot, settings, drive)
    if compensation is not None:
        updates.append(compensation)
    return updates


def _actuator_scale(batch: Any, robot: CompiledRobot, settings: Settings, drive: Drive) -> Any:
    """The effects at the strength site and `enabled` scale an actuator's force, those at the limit site limit it: their
    equations written into gainprm, biasprm and forcerange, so that MuJoCo's implicit integrator still sees the servo's
    damping.

    A range that the model gives the force is the driver's own: a softer servo reaches it later, a weak supply and a
    switched-off one lower it, and a limit beyond it takes its place.
    """
    model, enabled = robot.model, drive.enabled
    strengths = list(present(settings.effects, "strength"))
    supply, servo = ([(e, p) for e, p in strengths if e.supply == own] for own in (True, False))
    limits, lines = limits_of(settings.effects), list(present(settings.effects, "speed limit"))
    if not strengths and limits is None and not lines and enabled is None:
        return None
    steady = all(e.steady for e, _ in strengths) and not lines
    gainprm, biasprm = batch.expand("actuator_gainprm"), batch.expand("actuator_biasprm")
    forcerange = batch.expand("actuator_forcerange")
    # after retuning: the batch's own values are the nominal ones of each row
    base = gainprm[:, :, :3].copy(), biasprm[:, :, :3].copy(), raised(forcerange, settings.effects).copy()
    whole = np.ones((settings.rows, model.nu))

    gear = model.actuator_gear[:, 0]

    def write(strength: np.ndarray, clock: np.ndarray, speed: np.ndarray) -> None:
        law = scaled(NUMPY, servo, strength, clock, drive.dt)
        gainprm[:, :, :3] = base[0] * law[:, :, None]
        biasprm[:, :, :3] = base[1] * law[:, :, None]
        reach = base[2] * strength[:, :, None]
        forcerange[:] = reach if limits is None else np.clip(reach, limits[0][:, :, None], limits[1][:, :, None])
        for effect, p in lines:
            assert effect.step is not None
            low, high = effect.step(NUMPY, p, gear * speed[:, robot.driven])
            np.clip(forcerange, low[:, :, None], high[:, :, None], out=forcerange)

    write(whole, drive.clock[:, None], np.zeros((settings.rows, len(robot.joints))))
    if steady and enabled is None:
        return None

    same = None  # (K,) bool: steps in which nothing is written that was not there before
    if steady and enabled is not None:
        same = np.concatenate([[False], (enabled[:, 1:] == enabled[:, :-1]).all(axis=(0, 2))])

    def update(k: int, speed: np.ndarray, force: np.ndarray) -> None:
        if same is not None and same[k]:
            return
        clock = (drive.clock + (k + 0.5) * drive.dt)[:, None]
        strength = scaled(NUMPY, supply, whole, clock, drive.dt)
        if enabled is not None:
            strength = strength * enabled[:, k]
        write(strength, clock, speed)

    return update


def _friction(batch: Any, robot: CompiledRobot, settings: Settings, drive: Drive) -> Any:
    """The dry frictions' levels as dof_frictionloss: MuJoCo's solver supplies the sign, sticking included. Of what is
    constant a share may act behind the gear, as the damping does."""
    effects = settings.effects
    constants, varying = (list(present(effects, site)) for site in ("dry friction", "friction"))
    laws = joint_laws(effects, "law friction")
    if not constants and not varying and not laws:
        return None
    dof, gears = robot.dofs, robot.gears
    loss = batch.expand("dof_frictionloss")
    base = loss[:, dof].copy()
    behind = np.zeros_like(base)
    share = shares_behind(robot, settings)
    if gears is not None and share is not None:
        behind[:, gears.joints] = share
        base[:, gears.joints] += batch.expand("tendon_frictionloss")[:, gears.links]
    touched = np.zeros(base.shape, dtype=bool)
    for e, p in (*constants, *varying):
        touched |= ~is_null(e.name, p)
    ruled = [robot.joints.index(j) for j in robot.sites["law friction"]]
    for e, p in present(effects, "law friction"):
        touched[:, ruled] |= ~is_null(e.name, p)
    solimp = batch.expand("dof_solimp")
    index = np.argwhere(touched)
    solimp[index[:, 0], dof[index[:, 1]]] = STIFF_SOLIMP
    whole = np.maximum(_braked(base, constants, base, base), 0.0)
    if gears is not None and share is not None:
        batch.expand("tendon_frictionloss")[:, gears.links] = (behind * whole)[:, gears.joints]
    loss[:, dof] = constant = (1.0 - behind) * whole
    if not varying and not laws:
        return None
    signals = signals_of(batch, robot, drive) if laws else None

    def update(k: int, speed: np.ndarray, force: np.ndarray) -> None:
        level = _braked(constant, varying, speed, loads(robot, force))
        if signals is not None:
            level = level + _spread(levels(laws, signals(k, speed, force)), ruled, level)
        loss[:, dof] = np.maximum(level, 0.0)

    return update


def _spread(values: np.ndarray, columns: list[int], like: np.ndarray) -> np.ndarray:
    """(B, joints) zeros with values (B, n) in some columns."""
    out = np.zeros_like(like)
    out[:, columns] = values
    return out


def _braked(
    level: np.ndarray, frictions: Sequence[tuple[Effect, Values]], speed: np.ndarray, torque: np.ndarray
) -> np.ndarray:
    """(B, joints) N m: a level of dry friction and what these effects add to it."""
    for effect, p in frictions:
        assert effect.step is not None
        level = level + effect.step(NUMPY, p, speed, torque)
    return level
