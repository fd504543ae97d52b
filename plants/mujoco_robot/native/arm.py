"""A compiled MuJoCo model as a chain of links, and the numbers of its rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from plants.mujoco_robot.edits.masses import quat_to_matrix
from plants.mujoco_robot.native.chain import (
    ACTUATOR,
    ARM,
    EQUALITY,
    JOINT,
    LINK,
    TENDON,
    Actuator,
    Chain,
    Equality,
    Integrator,
    Stop,
    Tendon,
)
from plants.mujoco_robot.native.dynamics import Joint
from plants.mujoco_robot.native.soft_constraints import MINIMUM, clipped, dry_friction, reference

if TYPE_CHECKING:
    import mujoco

FAR = 1e30  # rad or m: a limit that is never reached

Field = Callable[[str], np.ndarray]  # a field of the model -> its values, (rows, ...)

READ = frozenset((  # the fields that may differ from row to row
    "body_pos", "body_mass", "body_ipos", "body_iquat", "body_inertia", "opt.gravity", "dof_invweight0", "dof_solimp",
    "dof_solref", "dof_armature", "dof_damping", "dof_frictionloss", "jnt_stiffness", "qpos_spring", "jnt_limited",
    "jnt_range", "actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "tendon_stiffness",
    "tendon_damping", "tendon_lengthspring", "tendon_range", "tendon_invweight0", "tendon_frictionloss",
))  # fmt: skip


def field_of(model: mujoco.MjModel, name: str) -> np.ndarray:
    """(1, ...) a field of the model, or "opt.", then one of its options."""
    return np.asarray(getattr(model.opt, name[4:]) if name.startswith("opt.") else getattr(model, name))[None]


def integrators() -> dict[int, Integrator]:
    """MuJoCo's numbers of the integrators that programs have."""
    import mujoco

    known = mujoco.mjtIntegrator
    return {int(known.mjINT_EULER): "Euler", int(known.mjINT_IMPLICITFAST): "implicitfast", int(known.mjINT_RK4): "RK4"}


def chain_of(model: mujoco.MjModel, rubs: bool, stops: bool, rubbing: tuple[int, ...] = ()) -> Chain:
    """rubs, stops: whether any row has dry friction or limits at its joints; rubbing: tendons that have dry friction in
    any row."""
    import mujoco

    joints, _ = _links(model, partial(field_of, model))
    flags = int(model.opt.disableflags)
    clamps = not flags & int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
    actuators = tuple(
        Actuator(
            int(model.jnt_dofadr[model.actuator_trnid[i, 0]]),
            float(model.actuator_gear[i, 0]),
            (float(model.actuator_ctrlrange[i, 0]), float(model.actuator_ctrlrange[i, 1]))
            if clamps and model.actuator_ctrllimited[i]
            else None,
            bool(model.actuator_forcelimited[i]),
        )
        for i in range(model.nu)
    )
    reach = tuple(
        (float(model.jnt_actfrcrange[j, 0]), float(model.jnt_actfrcrange[j, 1])) if model.jnt_actfrclimited[j] else None
        for j in range(model.njnt)
    )
    return Chain(
        integrators()[int(model.opt.integrator)],
        tuple(model.qpos0.tolist()),
        joints,
        actuators,
        reach,
        rubs,
        tuple(_stop(model.jnt_margin[j], model.jnt_solimp[j]) if stops else None for j in range(model.njnt)),
        tuple(_tendon(model, t, t in rubbing) for t in range(model.ntendon)),
        tuple(_equality(model, i) for i in active_equalities(model).tolist()),
    )


def active_equalities(model: mujoco.MjModel) -> np.ndarray:
    """Numbers of the equalities that act."""
    import mujoco

    disabled = int(model.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    return np.flatnonzero(model.eq_active0) if model.neq and not disabled else np.zeros(0, dtype=int)


def _equality(model: mujoco.MjModel, i: int) -> Equality:
    joint, other = int(model.eq_obj1id[i]), int(model.eq_obj2id[i])
    low, high, width, middle, power = clipped(model.eq_solimp[i]).tolist()
    return Equality(
        int(model.jnt_dofadr[joint]),
        None if other < 0 else int(model.jnt_dofadr[other]),
        float(model.eq_data[i, 0]),
        float(model.eq_data[i, 1]),
        (low, high, width, middle, power),
    )


def _stop(margin: float, solimp: np.ndarray) -> Stop:
    low, high, width, middle, power = clipped(solimp).tolist()
    return Stop(float(margin), (low, high, width, middle, power))


def _tendon(model: mujoco.MjModel, t: int, rubs: bool) -> Tendon:
    wraps = slice(int(model.tendon_adr[t]), int(model.tendon_adr[t] + model.tendon_num[t]))
    dofs = model.jnt_dofadr[model.wrap_objid[wraps]].tolist()
    stop = _stop(model.tendon_margin[t], model.tendon_solimp_lim[t]) if model.tendon_limited[t] else None
    return Tendon(tuple(zip(dofs, model.wrap_prm[wraps].tolist(), strict=True)), stop, rubs)


def numbers_of(model: mujoco.MjModel, field: Field, applied: np.ndarray) -> np.ndarray:
    """(B, numbers) in the order of native.step; field: values of the rows, (B, ...) or (1, ...), of the fields in READ;
    applied (B, n) N m: torques beside the actuators'."""
    joints, links = _links(model, field)
    n, nu = len(joints), model.nu
    tied = active_equalities(model)
    size = ARM + (LINK + JOINT) * n + ACTUATOR * nu + TENDON * model.ntendon + EQUALITY * len(tied)
    out = np.zeros((len(applied), size))
    out[:, 0], out[:, 1:ARM] = model.opt.timestep, field("opt.gravity")
    for i, (place, mass, centre, inertia) in enumerate(links):
        at = ARM + LINK * i
        out[:, at : at + 3], out[:, at + 3], out[:, at + 4 : at + 7] = place, mass, centre
        for k, (a, b) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
            out[:, at + 7 + k] = inertia[:, a, b]
    weight = field("dof_invweight0")
    stiff, damp = dry_friction(model, field("dof_solimp"), field("dof_solref"), weight)
    stops = reference(model, model.jnt_solref, clipped(model.jnt_solimp)[:, 1])
    limited, ends = field("jnt_limited").astype(bool), field("jnt_range")
    columns: tuple[np.ndarray, ...] = (
        field("dof_armature"),
        field("dof_damping"),
        field("jnt_stiffness"),
        field("qpos_spring"),
        field("dof_frictionloss"),
        stiff,
        damp,
        np.where(limited, ends[..., 0], -FAR),
        np.where(limited, ends[..., 1], FAR),
        *stops,
        weight,
        applied,
    )
    at = ARM + LINK * n
    for k, column in enumerate(columns):
        out[:, at + k : at + JOINT * n : JOINT] = column
    at += JOINT * n
    gain, bias, reach = (field(f"actuator_{x}") for x in ("gainprm", "biasprm", "forcerange"))
    affine = model.actuator_biastype == 1
    for k, column in enumerate(
        (gain[..., 0], *(bias[..., j] * affine for j in range(3)), reach[..., 0], reach[..., 1])
    ):
        out[:, at + k : at + ACTUATOR * nu : ACTUATOR] = column
    at += ACTUATOR * nu
    if model.ntendon:
        spring, ends = field("tendon_lengthspring"), field("tendon_range")
        pulled = reference(model, model.tendon_solref_lim, clipped(model.tendon_solimp_lim)[:, 1])
        columns = (field("tendon_stiffness"), spring[..., 0], spring[..., 1], ends[..., 0], ends[..., 1], *pulled)
        pulls = field("tendon_invweight0")
        rubs = dry_friction(model, model.tendon_solimp_fri, model.tendon_solref_fri, pulls)
        columns = (*columns, pulls, field("tendon_damping"), field("tendon_frictionloss"), *rubs)
        for k, column in enumerate(columns):
            out[:, at + k : at + TENDON * model.ntendon : TENDON] = column
    at += TENDON * model.ntendon
    for k, i in enumerate(tied.tolist()):
        both = [int(model.jnt_dofadr[j]) for j in (model.eq_obj1id[i], model.eq_obj2id[i]) if j >= 0]
        begin = at + EQUALITY * k
        out[:, begin : begin + 2] = reference(model, model.eq_solref[i], clipped(model.eq_solimp[i])[1])
        out[:, begin + 2] = weight[:, both].sum(axis=1)
    return out


Link = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class _Frames:
    """The part of the links that all rows share. places: of each joint, the body whose origin it is counted
    from, the body's axes in those of the link before, and the offset there; bodies: of each but the world, its link,
    -1 where it does not move, its parent, the parent's axes, its own, and its origin in the link if it has joints."""

    joints: tuple[Joint, ...]
    places: tuple[tuple[int, np.ndarray], ...]
    bodies: tuple[tuple[int, int, np.ndarray, np.ndarray, np.ndarray | None], ...]


_FRAMES: WeakKeyDictionary[Any, _Frames] = WeakKeyDictionary()


def _frames_of(model: mujoco.MjModel) -> _Frames:
    if model not in _FRAMES:
        _FRAMES[model] = _frames(model)
    return _FRAMES[model]


def _frames(model: mujoco.MjModel) -> _Frames:
    import mujoco

    joints: list[Joint] = []
    places: list[tuple[int, np.ndarray]] = []
    bodies: list[tuple[int, int, np.ndarray, np.ndarray, np.ndarray | None]] = []
    frames: list[tuple[int, np.ndarray]] = [(-1, np.eye(3))]  # of each body: its link, and its axes there
    for body in range(1, model.nbody):
        parent = int(model.body_parentid[body])
        link, outer = frames[parent]
        axes, origin = outer @ quat_to_matrix(model.body_quat[body]), None
        for j in range(int(model.body_jntadr[body]), int(model.body_jntadr[body]) + int(model.body_jntnum[body])):
            along = _axes_along(model.jnt_axis[j])
            offset = axes @ model.jnt_pos[j]
            places.append((body, offset) if origin is None else (-1, origin + offset))
            slides = int(model.jnt_type[j]) == int(mujoco.mjtJoint.mjJNT_SLIDE)
            turn = tuple((float(x), float(y), float(z)) for x, y, z in _clean(axes @ along).T)
            joints.append(Joint(link, slides, turn))
            link, axes = len(joints) - 1, along.T
            origin = -model.jnt_pos[j] @ along
        frames.append((link, axes))
        bodies.append((link, parent, outer, axes, origin))
    return _Frames(tuple(joints), tuple(places), tuple(bodies))


def _links(model: mujoco.MjModel, field: Field) -> tuple[tuple[Joint, ...], list[Link]]:
    """The moving links, one for each joint, with what is welded to them; of each: the joint's place, the mass, the
    centre of mass and the inertia about it, (rows, ...)."""
    frames = _frames_of(model)
    position, mass, centre = field("body_pos"), field("body_mass"), field("body_ipos")
    turned, moments = quat_to_matrix(field("body_iquat")), field("body_inertia")
    outside: list[np.ndarray] = [np.zeros((1, 3))]  # of each body, its origin in the link of its parent
    inside: list[np.ndarray] = [np.zeros((1, 3))]  # and in its own
    for body, (_, parent, outer, _, origin) in enumerate(frames.bodies, 1):
        outside.append(inside[parent] + position[:, body] @ outer.T)
        inside.append(outside[body] if origin is None else origin[None])
    places = [offset[None] if body < 0 else outside[body] + offset for body, offset in frames.places]
    origin = places[0].copy()  # the first joint: far from it, sums of large numbers would lose digits
    places = [x - origin if joint.parent < 0 else x for joint, x in zip(frames.joints, places, strict=True)]
    links: list[Link] = [(place, np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3, 3))) for place in places]
    for body, (link, _, _, axes, _) in enumerate(frames.bodies, 1):
        if link < 0:
            continue
        turn = axes @ turned[:, body]
        own = turn @ (moments[:, body, :, None] * turn.transpose(0, 2, 1))
        place, m, c, inertia = links[link]
        at = inside[body] + centre[:, body] @ axes.T
        whole = (mass[:, body], at, own) if not m.any() else _joined(m, c, inertia, mass[:, body], at, own)
        links[link] = (place, *whole)
    return frames.joints, links


def _axes_along(axis: np.ndarray) -> np.ndarray:
    """(3, 3) right-handed axes, in columns, whose last is this one."""
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(other, axis)
    first /= np.linalg.norm(first)
    return _clean(np.stack([first, np.cross(axis, first), axis], axis=1))


def _clean(turn: np.ndarray) -> np.ndarray:
    """Without the last digits that a rotation by right angles leaves."""
    near = np.round(turn)
    return np.where(np.abs(turn - near) < 1e-15, near, turn)


def _joined(
    m: np.ndarray, c: np.ndarray, inertia: np.ndarray, other_m: np.ndarray, other_c: np.ndarray, other: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass, centre and inertia about it of two bodies in one."""
    whole = m + other_m
    centre = (m[:, None] * c + other_m[:, None] * other_c) / np.maximum(whole, MINIMUM)[:, None]
    return whole, centre, inertia + _moved(m, c - centre) + other + _moved(other_m, other_c - centre)


def _moved(m: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Of masses (rows,) at d (rows, 3)."""
    square = (d**2).sum(axis=1)[:, None, None] * np.eye(3)
    return np.asarray(m[:, None, None] * (square - d[:, :, None] * d[:, None, :]))
