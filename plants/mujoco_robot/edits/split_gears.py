"""Joints whose motor and link are told apart: a spring or play between the two, as a joint more in the same body.

The user's joint becomes the motor's side of the gear, seen at the link's scale: it keeps the actuator, the armature and
the friction, a share of which may act on the link instead. A second joint about the same axis, behind it, is how far
the link is ahead of the motor; the link's angle is the sum of both. Since both sit in one body, the equations are
those of two inertias, whatever hangs on the link: M = [[rotor + link, link], [link, link]]. A joint's own range holds
the link.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from plants.mujoco_robot.loading.compile import prepared
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.mujoco_robot.structure.gears import Gears
from plants.mujoco_robot.structure.variants import merge
from residual_mpc.effects.library import changes, present
from residual_mpc.models.settings import Settings, is_null

if TYPE_CHECKING:
    import mujoco

SLOWED = 2.0  # 1/s: how fast grease slows a link that floats in its play
LEAST_ROTOR = 0.02  # of the link's inertia: a rotor without any inertia has no equation of motion
FAR = 1e6  # rad: a stop that is never reached
# MuJoCo's limits and dry friction are soft constraints that creep; these are stiff, as is added friction
STIFF_SOLIMP = (0.99, 0.999, 0.001, 0.5, 2.0)
STOP_STEPS = 2.0  # time constant of a stop, steps: the stiffest that MuJoCo takes
FINER = 4  # steps in one of RK4, which evaluates the model as often


def by_gears(robot: CompiledRobot, settings: Settings) -> Iterator[tuple[CompiledRobot, np.ndarray]]:
    """The robot with its gears split as rows of the settings need it, and those rows (n,)."""
    names = robot.geared if robot.gears is None else ()
    split = np.zeros((settings.rows, len(names)), dtype=bool)
    for effect, p in present(settings.effects, "play", "spring") if names else ():
        split |= ~is_null(effect.name, p)
    if not split.any():
        yield robot, np.arange(settings.rows)
        return
    for pattern in np.unique(split, axis=0):
        chosen = tuple(j for j, apart in zip(names, pattern, strict=True) if apart)
        yield split_gears(robot, chosen) if chosen else robot, np.flatnonzero((split == pattern).all(axis=1))


def split_gears(robot: CompiledRobot, joints: tuple[str, ...]) -> CompiledRobot:
    """The robot with motor and link of these joints apart; made once."""
    if joints not in robot.with_gears:
        parts = [_split(part, joints) for part in robot.settings or (robot,)]
        whole = merge(parts) if robot.settings else parts[0]
        assert whole is not None, "settings that were merged differ in numbers alone"
        robot.with_gears[joints] = whole
    return robot.with_gears[joints]


def _split(robot: CompiledRobot, joints: tuple[str, ...]) -> CompiledRobot:
    import mujoco

    assert robot.spec is not None
    plain, spec = robot.model, robot.spec.copy()
    for key in list(spec.keys):  # a posture of the robot as it was
        spec.delete(key)
    dof = np.array([int(plain.joint(j).dofadr[0]) for j in joints])
    link = np.maximum(plain.dof_M0[dof] - plain.dof_armature[dof], 1e-9)
    rotor = np.maximum(plain.dof_armature[dof], LEAST_ROTOR * link)
    coarse = int(plain.opt.integrator) == int(mujoco.mjtIntegrator.mjINT_RK4)
    if coarse:  # which has no implicit damping, and a stiff spring or stop needs it
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.timestep = plain.opt.timestep / FINER
    for name, inertia in zip(joints, rotor.tolist(), strict=True):
        motor = spec.joint(name)
        motor.armature = inertia
        free = {"limited": False, "actfrclimited": False}  # whatever the model's defaults give to every joint
        behind = motor.parent.add_joint(name=_behind(name), type=motor.type, axis=motor.axis, pos=motor.pos, **free)
        if motor.frame is not None:
            behind.set_frame(motor.frame)
        spring = spec.add_tendon(name=_behind(name), springlength=(0.0, 0.0), limited=False)
        spring.wrap_joint(_behind(name), 1.0)
        link_side = spec.add_tendon(name=_link(name), springlength=(0.0, 0.0), limited=False)
        link_side.wrap_joint(name, 1.0)
        link_side.wrap_joint(_behind(name), 1.0)
        number = plain.joint(name).id
        if plain.jnt_limited[number]:
            low, high = plain.jnt_range[number].tolist()
            stop = spec.add_tendon(name=f"{name} stop", limited=True, range=(low, high), springlength=(0.0, 0.0))
            stop.solref_limit, stop.solimp_limit = plain.jnt_solref[number], plain.jnt_solimp[number]
            stop.margin = float(plain.jnt_margin[number])
            stop.wrap_joint(name, 1.0)
            stop.wrap_joint(_behind(name), 1.0)
            motor.limited = False
    model = prepared(spec.compile())
    numbers = np.array([model.joint(_behind(j)).id for j in joints])
    gears = Gears(
        robot.geared,
        np.array([robot.joints.index(j) for j in joints]),
        numbers,
        model.jnt_qposadr[numbers],
        model.jnt_dofadr[numbers],
        np.array([model.tendon(_behind(j)).id for j in joints]),
        np.array([model.tendon(_link(j)).id for j in joints]),
        rotor,
        link,
        FINER if coarse else 1,
    )
    _bare(model, gears, plain.ntendon)
    return replace(robot, model=model, gears=gears, spec=None)


def _behind(joint: str) -> str:
    return f"{joint} behind its gear"


def _link(joint: str) -> str:
    return f"{joint} at its link"


def _bare(model: "mujoco.MjModel", gears: Gears, tendons: int) -> None:
    """Take from the added joints, and the tendons after the model's own, what the defaults give to every one."""
    for field in ("dof_damping", "dof_dampingpoly", "dof_armature", "dof_frictionloss"):
        getattr(model, field)[gears.dofs] = 0.0
    for field in ("jnt_stiffness", "jnt_stiffnesspoly", "jnt_margin"):
        getattr(model, field)[gears.numbers] = 0.0
    for field in ("tendon_stiffness", "tendon_damping", "tendon_frictionloss", "tendon_armature"):
        getattr(model, field)[tendons:] = 0.0
    model.tendon_solimp_fri[gears.links] = STIFF_SOLIMP
    model.jnt_actfrclimited[gears.numbers] = 0
    model.jnt_limited[gears.numbers] = 1
    model.jnt_range[gears.numbers] = (-FAR, FAR)
    model.jnt_solref[gears.numbers] = (STOP_STEPS * model.opt.timestep, 1.0)
    model.jnt_solimp[gears.numbers] = STIFF_SOLIMP


def edit_gears(batch: Any, robot: CompiledRobot, settings: Settings) -> None:
    """Write springs and stops into the batch of a split robot.

    A spring in a joint that also has play begins at the play's ends. Its damping is never less than makes the
    integrator's step implicit in the spring, so that any stiffness is stable.
    """
    gears, model = robot.gears, robot.model
    assert gears is not None
    stiffness, gap = of_gears(robot, settings)
    firm = np.isfinite(stiffness)
    k = np.where(firm, stiffness, 0.0)
    batch.expand("tendon_stiffness")[:, gears.springs] = k
    dead = np.where(firm, 0.5 * gap, 0.0)
    batch.expand("tendon_lengthspring")[:, gears.springs] = np.stack([-dead, dead], axis=-1)
    reduced = gears.rotor * gears.link / (gears.rotor + gears.link)
    ratio = changes(settings.effects, "gear damping")
    damped = 0.0 if ratio is None else ratio[:, _slots(robot)]
    spring = np.maximum(2.0 * damped * np.sqrt(k * reduced), k * model.opt.timestep)
    batch.expand("dof_damping")[:, gears.dofs] = np.where(firm, spring, SLOWED * reduced)
    reach = np.where(firm, FAR, 0.5 * gap)
    batch.expand("jnt_range")[:, gears.numbers] = np.stack([-reach, reach], axis=-1)
    behind = shares_behind(robot, settings)
    if behind is not None:
        _move_friction(batch, robot, behind)
    tuned = any(name.endswith(".armature") for name in settings.tuned)
    if tuned or changes(settings.effects, "rotor inertia") is not None:
        motor = robot.dofs[gears.joints]
        armature = batch.expand("dof_armature")
        armature[:, motor] = np.maximum(armature[:, motor], LEAST_ROTOR * gears.link)
        batch.set_const()


def _move_friction(batch: Any, robot: CompiledRobot, behind: np.ndarray) -> None:
    """Move this share of the joints' damping and dry friction, (B, g), to the links; the rest stays at the motors."""
    gears = robot.gears
    assert gears is not None
    motor = robot.dofs[gears.joints]
    for kind in ("damping", "frictionloss"):
        own, link = batch.expand(f"dof_{kind}"), batch.expand(f"tendon_{kind}")
        whole = own[:, motor].copy()
        own[:, motor] = whole * np.maximum(1.0 - behind, 0.0)
        link[:, gears.links] = whole * behind


def shares_behind(robot: CompiledRobot, settings: Settings) -> np.ndarray | None:
    """(B, g) the share of the friction at a joint that acts on the link behind its gear; None without any."""
    moved = None if robot.gears is None else changes(settings.effects, "damping behind the gear")
    return None if moved is None else moved[:, _slots(robot)]


def of_gears(robot: CompiledRobot, settings: Settings) -> tuple[np.ndarray, np.ndarray]:
    """(B, g) stiffness N m/rad, infinite where there is no spring, and play rad."""
    gears = robot.gears
    assert gears is not None
    at = _slots(robot)
    rigid = np.full((settings.rows, len(robot.geared)), np.inf)
    stiffness, gap = (changes(settings.effects, q) for q in ("gear stiffness", "gear play"))
    return (rigid if stiffness is None else stiffness)[:, at], (np.zeros_like(rigid) if gap is None else gap)[:, at]


def _slots(robot: CompiledRobot) -> list[int]:
    """Places of the gears of a split robot among all that could be."""
    assert robot.gears is not None
    return [robot.geared.index(robot.joints[j]) for j in robot.gears.joints.tolist()]
