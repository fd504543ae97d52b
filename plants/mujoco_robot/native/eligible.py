"""Which models have native programs: arms whose every feature the programs know, and that agree with MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from plants.mujoco_robot.native.arm import READ, active_equalities, field_of, integrators, numbers_of
from plants.mujoco_robot.native.compiled import Compiled, Rollout
from plants.mujoco_robot.native.program import LANES

if TYPE_CHECKING:
    import mujoco

CHECKED = 24  # steps of LANES rows in which a program is compared with MuJoCo
SCALES = (1.0, 0.1, 0.01)  # rad and rad/s, of the motions that are tried
BOUNDED = 1e3  # rad/s
REASON = 1e5  # N m or rad: a range beyond it stands for none
SAME = 1e-9  # largest difference there, rad or m and per s, relative to 1 and the value
DERIVED = frozenset((  # constants that MuJoCo computes for other purposes, and marks of its shortcuts
    "dof_M0", "dof_length", "dof_simplenum", "body_subtreemass", "body_invweight0", "body_sameframe", "body_simple",
    "actuator_acc0", "actuator_length0", "actuator_lengthrange", "tendon_length0",
))  # fmt: skip
UNUSED = ("geom_", "site_", "cam_", "light_", "mat_", "key_", "bvh_", "name", "numeric_", "text_", "tuple_")
NONE = ("na", "nflex", "nplugin", "nmocap")  # of which such a model has none
ZERO = (  # and of whose fields no number differs from 0
    "body_gravcomp", "jnt_actgravcomp", "dof_dampingpoly", "jnt_stiffnesspoly", "jnt_springyield",
    "tendon_dampingpoly", "tendon_frictionloss", "tendon_armature", "tendon_stiffnesspoly", "tendon_springyield",
    "tendon_actfrclimited", "actuator_damping", "actuator_dampingpoly", "actuator_armature", "actuator_delay",
    "actuator_dyntype", "actuator_gaintype",
)  # fmt: skip


def alike(models: Sequence[mujoco.MjModel], differing: Sequence[str]) -> bool:
    """Whether models that differ in these fields do so only in what programs read from each row, or do not use."""
    known = all(f in READ or f in DERIVED or f.startswith(UNUSED) for f in differing)
    return known and all(eligible(m) for m in models) and len({int(m.opt.integrator) for m in models}) == 1


def eligible(model: mujoco.MjModel) -> bool:
    """Whether a model is a chain of hinges and slides on a fixed base, without contacts, whose motors act on joints."""
    import mujoco

    kinds = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}
    joint = int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    option = model.opt
    return bool(
        model.nv == model.njnt == model.nq > 0
        and set(model.jnt_type.tolist()) <= kinds
        and not any(getattr(model, name, 0) for name in NONE)
        and not any(np.any(getattr(model, name, 0)) for name in ZERO)
        and np.isin(model.actuator_trntype, joint).all()
        and bool((model.actuator_biastype <= 1).all())
        and int(option.integrator) in integrators()
        and option.density == option.viscosity == 0.0
        and not int(option.enableflags)
        and not int(option.disableactuator)
        and not int(option.disableflags) & ~_harmless()
        and not _touching(model)
        and bool(np.isin(model.jnt_solimp[:, 4], (1.0, 2.0)).all())
        and all(_known(model, t) for t in range(model.ntendon))
        and all(_followed(model, i) for i in active_equalities(model).tolist())
        and not any(_mixed(x) for x in (model.jnt_solref, model.dof_solref, model.tendon_solref_lim))
    )


def _mixed(solref: np.ndarray) -> bool:
    """Whether a pair of numbers has different signs: MuJoCo takes its default in their place."""
    return bool(((solref[:, 0] > 0.0) != (solref[:, 1] > 0.0)).any())


def _known(model: mujoco.MjModel, t: int) -> bool:
    """Whether a tendon is a sum of positions of joints."""
    import mujoco

    wraps = slice(int(model.tendon_adr[t]), int(model.tendon_adr[t] + model.tendon_num[t]))
    joints = bool((model.wrap_type[wraps] == int(mujoco.mjtWrap.mjWRAP_JOINT)).all())
    if not joints or model.tendon_solimp_lim[t, 4] not in (1.0, 2.0):
        return False
    dofs = model.jnt_dofadr[model.wrap_objid[wraps]].tolist()
    return len(set(dofs)) == len(dofs)


def _followed(model: mujoco.MjModel, i: int) -> bool:
    """Whether an equality makes a joint follow another one in proportion, or stay where it is."""
    import mujoco

    return (
        int(model.eq_type[i]) == int(mujoco.mjtEq.mjEQ_JOINT)
        and not model.eq_data[i, 2:5].any()
        and model.eq_solimp[i, 4] in (1.0, 2.0)
        and not _mixed(model.eq_solref[i][None])
    )


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


def agrees(
    model: mujoco.MjModel, program: Compiled, rubs: bool, stops: bool, rubbing: tuple[int, ...] = ()
) -> bool:
    """Whether a program takes the same steps as MuJoCo with its solver's tolerance at 0, in the largest random motions
    that stay bounded, under small commands and under such as reach every range. rubs: with friction at every joint;
    stops: with some joints beyond their limits; rubbing: with friction at these tendons."""
    tried = _tried(model, rubs, stops, rubbing)
    found = [_compared_bounded(tried, program, saturating) for saturating in (False, True)]
    return found[0] is not None and all(close in (None, True) for close in found)


def _compared_bounded(model: mujoco.MjModel, program: Compiled, saturating: bool) -> bool | None:
    """Whether the two agree in the largest motions that stay bounded; None if none do."""
    outcomes = (_compared(model, program, scale, saturating) for scale in SCALES)
    return next((close for close in outcomes if close is not None), None)


def _tried(model: mujoco.MjModel, rubs: bool, stops: bool, rubbing: tuple[int, ...]) -> mujoco.MjModel:
    """The model with exactly the frictions and stops that the program implements: rows may have fewer than the model,
    for example if friction has moved behind the gears."""
    rng, tried = np.random.default_rng(0), copy(model)
    tried.opt.tolerance, tried.opt.ls_tolerance = 0.0, 1e-6
    most = np.maximum(model.dof_M0, 1e-6) * rng.uniform(0.0, 5.0, model.nv)
    tried.dof_frictionloss[:] = np.maximum(model.dof_frictionloss, most) if rubs else 0.0
    if model.ntendon:
        carried = _carried(model)
        damping = carried * rng.uniform(0.0, 5.0, model.ntendon)
        tried.tendon_damping[:] = np.maximum(model.tendon_damping, damping)
        for t in rubbing:
            tried.tendon_frictionloss[t] = carried[t] * rng.uniform(1.0, 5.0)
    if stops:
        free = model.jnt_limited == 0
        tried.jnt_range[free] = model.qpos0[free, None] + np.array([-0.5, 0.5])
        tried.jnt_limited[:] = 1
    else:
        tried.jnt_limited[:] = 0
    return tried


def _carried(model: mujoco.MjModel) -> np.ndarray:
    """(ntendon,) kg m^2 (kg), the effective inertia of each tendon, a sum of joint positions, at qpos0: 1 / (J M^-1
    J^T), 0 of one that pulls at no joint. That of a light link behind a gear is far below its joint's dof_M0."""
    import mujoco

    data, mass = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    pulls = np.zeros((model.ntendon, model.nv))
    for t, (begin, count) in enumerate(zip(model.tendon_adr, model.tendon_num, strict=True)):
        wraps = slice(begin, begin + count)
        pulls[t, model.jnt_dofadr[model.wrap_objid[wraps]]] = model.wrap_prm[wraps]
    ease = np.einsum("ti,it->t", pulls, np.linalg.solve(mass, pulls.T))
    return np.divide(1.0, ease, out=np.zeros_like(ease), where=ease > 0.0)


def _compared(model: mujoco.MjModel, program: Compiled, scale: float, saturating: bool) -> bool | None:
    """Whether the two agree in motions of about so many rad and rad/s; None if MuJoCo's do not stay bounded."""
    import mujoco
    from mujoco.batch import Batch

    rng, n, nu = np.random.default_rng(1), model.nv, model.nu
    q, v = model.qpos0 + scale * rng.uniform(-1.0, 1.0, (LANES, n)), scale * rng.normal(size=(LANES, n))
    ends = model.jnt_range[np.arange(n), rng.integers(0, 2, (LANES, n))]
    near = (rng.random((LANES, n)) < 0.4) & model.jnt_limited.astype(bool) & (np.abs(ends) < REASON)
    q = np.where(near, ends + 0.05 * scale * rng.uniform(-1.0, 1.0, (LANES, n)), q)
    u = _reach(model, saturating)[:, None] * rng.uniform(-1.0, 1.0, (nu, LANES, CHECKED)) + _middle(model)[:, None]
    u = np.ascontiguousarray(u.transpose(1, 2, 0))
    batch = Batch(model, LANES, nthread=1)
    batch.reset()
    batch.bind("qpos")[:], batch.bind("qvel")[:] = q, v
    there = batch.rollout(CHECKED, u, int(mujoco.mjtState.mjSTATE_CTRL), ("qpos", "qvel"))
    if not (np.abs(there["qvel"]) < BOUNDED).all():
        return None
    numbers = numbers_of(model, partial(field_of, model), np.zeros((LANES, n)))
    nodes = np.empty((2, LANES, CHECKED + 1, n))
    state = np.concatenate([q, v, np.zeros((LANES, n))], axis=1).T[None].copy()
    outputs, forces, failed = np.empty((0, 0, nu)), np.zeros((1, nu, LANES)), np.zeros((1, 1, LANES))
    program(Rollout(numbers.T[None].copy(), state, u, nodes[0], nodes[1], outputs, forces, failed), 0, CHECKED, 1)
    pairs = ((nodes[0, :, 1:], there["qpos"]), (nodes[1, :, 1:], there["qvel"]))
    return all((np.abs(a - b) <= SAME * (1.0 + np.abs(b))).all() for a, b in pairs) and not failed.any()


def _reach(model: mujoco.MjModel, saturating: bool) -> np.ndarray:
    """(nu, 1) how far commands go from their middle; saturating: beyond what the ranges of forces and torques let
    through, where that is within reason."""
    clamped = model.actuator_ctrllimited.astype(bool)
    half = np.where(clamped, 0.6 * (model.actuator_ctrlrange[:, 1] - model.actuator_ctrlrange[:, 0]), 1.0)
    if saturating:
        gain = np.maximum(np.abs(model.actuator_gainprm[:, 0]), 1e-9)
        joint = model.actuator_trnid[:, 0]
        gear = np.maximum(np.abs(model.actuator_gear[:, 0]), 1e-9)
        own = np.where(model.actuator_forcelimited, np.abs(model.actuator_forcerange).max(axis=1), 0.0)
        joints = np.where(model.jnt_actfrclimited[joint], np.abs(model.jnt_actfrcrange[joint]).max(axis=1), 0.0) / gear
        force = np.maximum(np.where(own < REASON, own, 0.0), np.where(joints < REASON, joints, 0.0))
        half = np.maximum(half, 1.5 * force / gain)
    return np.asarray(half[:, None])


def _middle(model: mujoco.MjModel) -> np.ndarray:
    """(nu, 1) of the commands' ranges."""
    clamped = model.actuator_ctrllimited.astype(bool)
    return np.asarray(np.where(clamped, model.actuator_ctrlrange.mean(axis=1), 0.0)[:, None])
