"""Which models have native programs: arms whose every feature the programs know, and that agree with MuJoCo."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING

import numpy as np

from plants.mujoco_robot.native.arm import numbers_of
from plants.mujoco_robot.native.compiled import Compiled, Rollout
from plants.mujoco_robot.native.program import LANES

if TYPE_CHECKING:
    import mujoco

CHECKED = 24  # steps of LANES rows in which a program is compared with MuJoCo
SCALES = (1.0, 0.1, 0.01)  # rad and rad/s, of the motions that are tried
BOUNDED = 1e3  # rad/s
SAME = 1e-9  # largest difference there, rad or m and per s, relative to 1 and the value
# what a program takes from the model for all rows
FIXED = (
    "body_quat", "jnt_axis", "jnt_pos", "jnt_margin", "jnt_solref", "jnt_solimp", "qpos0", "body_gravcomp",
    "jnt_actfrclimited", "jnt_actfrcrange", "actuator_gear", "actuator_ctrllimited", "actuator_ctrlrange",
    "actuator_forcelimited", "dof_dampingpoly", "jnt_stiffnesspoly", "tendon_limited", "opt.timestep", "opt.integrator",
)  # fmt: skip
NONE = ("neq", "na", "nflex", "nplugin", "nmocap")  # of which such a model has none
ZERO = (  # and of whose fields no number differs from 0
    "body_gravcomp", "jnt_actgravcomp", "dof_dampingpoly", "jnt_stiffnesspoly", "jnt_springyield", "tendon_damping",
    "tendon_dampingpoly", "tendon_frictionloss", "tendon_armature", "tendon_stiffnesspoly", "tendon_springyield",
    "tendon_actfrclimited", "actuator_damping", "actuator_dampingpoly", "actuator_armature", "actuator_delay",
    "actuator_dyntype", "actuator_gaintype",
)  # fmt: skip


def eligible(model: mujoco.MjModel) -> bool:
    """Whether a model is a chain of hinges and slides on a fixed base, without contacts, whose motors act on joints."""
    import mujoco

    kinds = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}
    integrators = {int(mujoco.mjtIntegrator.mjINT_EULER), int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)}
    joint = int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    option = model.opt
    return bool(
        model.nv == model.njnt == model.nq > 0
        and set(model.jnt_type.tolist()) <= kinds
        and not any(getattr(model, name, 0) for name in NONE)
        and not any(np.any(getattr(model, name, 0)) for name in ZERO)
        and np.isin(model.actuator_trntype, joint).all()
        and bool((model.actuator_biastype <= 1).all())
        and int(option.integrator) in integrators
        and option.density == option.viscosity == 0.0
        and not int(option.enableflags)
        and not int(option.disableactuator)
        and not int(option.disableflags) & ~_harmless()
        and not _touching(model)
        and bool(np.isin(model.jnt_solimp[:, 4], (1.0, 2.0)).all())
        and all(_known(model, t) for t in range(model.ntendon))
    )


def _known(model: mujoco.MjModel, t: int) -> bool:
    """Whether a tendon is a sum of positions of joints that move one another."""
    import mujoco

    wraps = slice(int(model.tendon_adr[t]), int(model.tendon_adr[t] + model.tendon_num[t]))
    joints = bool((model.wrap_type[wraps] == int(mujoco.mjtWrap.mjWRAP_JOINT)).all())
    if not joints or model.tendon_solimp_lim[t, 4] not in (1.0, 2.0):
        return False
    dofs = sorted(model.jnt_dofadr[model.wrap_objid[wraps]].tolist())
    before = int(dofs[-1])
    reached = {before}
    while (before := int(model.dof_parentid[before])) >= 0:
        reached.add(before)
    return len(set(dofs)) == len(dofs) and set(dofs) <= reached


def _harmless() -> int:
    """The disabled features that make no difference here or that the programs heed."""
    import mujoco

    names = (
        "CONTACT SENSOR ISLAND MIDPHASE NATIVECCD MULTICCD WARMSTART AUTORESET FILTERPARENT CLAMPCTRL REFSAFE EQUALITY"
    )
    bits = 0
    for name in names.split():
        bits |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}"))
    return bits


def _touching(model: mujoco.MjModel) -> bool:
    """Whether two shapes of the model could touch."""
    import mujoco

    if int(model.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_CONTACT):
        return False
    if model.npair:
        return True
    fixed = model.body_weldid[model.geom_bodyid]
    one, other = np.triu_indices(model.ngeom, 1)
    kinds, partners = model.geom_contype, model.geom_conaffinity
    meet = (kinds[one] & partners[other]) | (kinds[other] & partners[one])
    return bool((meet.astype(bool) & (fixed[one] != fixed[other])).any())


def agrees(model: mujoco.MjModel, program: Compiled, rubs: bool, stops: bool) -> bool:
    """Whether a program does the same as MuJoCo, whose solver is not to stop early, in random motions with friction at
    every joint (rubs) and some of them beyond limits (stops): in the largest motions that stay bounded."""
    tried = _tried(model, rubs, stops)
    for scale in SCALES:
        close = _compared(tried, program, scale)
        if close is not None:
            return close
    return False


def _tried(model: mujoco.MjModel, rubs: bool, stops: bool) -> mujoco.MjModel:
    rng, tried = np.random.default_rng(0), copy(model)
    tried.opt.tolerance, tried.opt.ls_tolerance = 0.0, 1e-6
    if rubs:
        most = np.maximum(model.dof_M0, 1e-6) * rng.uniform(0.0, 5.0, model.nv)
        tried.dof_frictionloss[:] = np.maximum(model.dof_frictionloss, most)
    if stops:
        free = model.jnt_limited == 0
        tried.jnt_range[free] = model.qpos0[free, None] + np.array([-0.5, 0.5])
        tried.jnt_limited[:] = 1
    return tried


def _compared(model: mujoco.MjModel, program: Compiled, scale: float) -> bool | None:
    """Whether the two agree in motions of about so many rad and rad/s; None if MuJoCo's do not stay bounded."""
    import mujoco
    from mujoco.batch import Batch

    rng, n, nu = np.random.default_rng(1), model.nv, model.nu
    q, v = model.qpos0 + scale * rng.uniform(-1.0, 1.0, (LANES, n)), scale * rng.normal(size=(LANES, n))
    sent = model.actuator_ctrllimited[:, None].astype(bool)
    low, high = np.where(sent, 1.2 * model.actuator_ctrlrange, np.array([-1.0, 1.0])).T
    u = rng.uniform(low, high, (LANES, CHECKED, nu))
    batch = Batch(model, LANES, nthread=1)
    batch.reset()
    batch.bind("qpos")[:], batch.bind("qvel")[:] = q, v
    there = batch.rollout(CHECKED, u, int(mujoco.mjtState.mjSTATE_CTRL), ("qpos", "qvel"))
    if not (np.abs(there["qvel"]) < BOUNDED).all():
        return None
    numbers = numbers_of(model, lambda name: _field(model, name), LANES)
    nodes = np.empty((2, LANES, CHECKED + 1, n))
    state = np.concatenate([q, v, np.zeros((LANES, n))], axis=1).T[None].copy()
    outputs, forces, failed = np.empty((0, 0, nu)), np.zeros((1, nu, LANES)), np.zeros((1, 1, LANES))
    program(Rollout(numbers.T[None].copy(), state, u, nodes[0], nodes[1], outputs, forces, failed), 0, CHECKED, 1)
    pairs = ((nodes[0, :, 1:], there["qpos"]), (nodes[1, :, 1:], there["qvel"]))
    return all((np.abs(a - b) <= SAME * (1.0 + np.abs(b))).all() for a, b in pairs) and not failed.any()


def _field(model: mujoco.MjModel, name: str) -> np.ndarray:
    return np.asarray(getattr(model.opt, name[4:]) if name.startswith("opt.") else getattr(model, name))[None]
