"""What an MJCF or URDF file names, read without a robot file."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from plants.mujoco_robot.loading.compile import compile_model, refuse_unsupported
from plants.mujoco_robot.structure.base import driving_bodies, free_bodies, hinges_and_slides
from residual_mpc.errors import BadInput
from residual_mpc.logs.audit.facts import ActuatorFacts, CommandKind
from residual_mpc.models.model_structure import Joint, ModelStructure
from residual_mpc.models.parameter_units import is_share

if TYPE_CHECKING:
    import mujoco


def model_structure(path: Path) -> ModelStructure:
    """The joints, actuators and torques of a model file.

    Raises BadInput where it does not compile, or is of a kind that no robot file could drive.
    """
    _, model, _ = compile_model(str(path))
    refuse_unsupported(model, str(path))
    numbers = hinges_and_slides(model).tolist()
    if not numbers:
        raise BadInput("the model has no hinge or slide joint", str(path), "give a model with moving joints")
    free, driving = free_bodies(model), driving_bodies(model)
    base = driving[0] if driving else free[0] if free and not model.nu else None
    return ModelStructure(
        "mujoco",
        tuple(_joint(model, j) for j in numbers),
        tuple(_actuator(model, i) for i in range(model.nu)),
        None if base is None else model.body(base).name,
        tuple(model.site(i).name for i in range(model.nsite) if model.site(i).name),
        None if base is not None else lambda q, v, a: _torque(model, q, v, a),
    )


def _joint(model: "mujoco.MjModel", j: int) -> Joint:
    import mujoco

    low, high = model.jnt_range[j].tolist()
    effort = float(model.jnt_actfrcrange[j, 1]) if model.jnt_actfrclimited[j] else None
    slides = int(model.jnt_type[j]) == int(mujoco.mjtJoint.mjJNT_SLIDE)
    leads = {int(model.eq_obj1id[e]): int(model.eq_obj2id[e]) for e in _couplings(model)}
    follows = model.joint(leads[j]).name if leads.get(j, -1) >= 0 else None
    return Joint(model.joint(j).name, slides, (low, high) if model.jnt_limited[j] else None, effort, follows)


def _couplings(model: "mujoco.MjModel") -> list[int]:
    """Numbers of the equality constraints between two joints, which a URDF's <mimic> becomes as well."""
    import mujoco

    coupled = (model.eq_type == int(mujoco.mjtEq.mjEQ_JOINT)) & model.eq_active0.astype(bool)
    return [int(e) for e in np.flatnonzero(coupled)]


def _actuator(model: "mujoco.MjModel", i: int) -> ActuatorFacts:
    bias = model.actuator_biasprm[i]
    kind: CommandKind = "position" if bias[1] != 0 else "velocity" if bias[2] != 0 else "torque"
    gear = float(model.actuator_gear[i, 0]) if kind != "torque" else 1.0
    low, high = model.actuator_ctrlrange[i].tolist() if model.actuator_ctrllimited[i] else (0.0, 0.0)
    share = kind == "torque" and is_share(float(model.actuator_gear[i, 0]), (low, high))
    joint = model.joint(int(model.actuator_trnid[i, 0])).name
    return ActuatorFacts(model.actuator(i).name, joint, kind, gear or 1.0, share)


def _torque(model: "mujoco.MjModel", q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """(n, joints): inverse dynamics without contacts and limits; damping, springs and dry friction included."""
    import mujoco

    data = mujoco.MjData(model)
    numbers = hinges_and_slides(model)
    places, dofs = model.jnt_qposadr[numbers], model.jnt_dofadr[numbers]
    out, rigid = np.empty(q.shape), np.empty(model.nv)
    for k in range(len(q)):
        data.qpos[places], data.qvel[dofs], data.qacc[dofs] = q[k], v[k], a[k]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_rne(model, data, 1, rigid)
        own = model.dof_armature * data.qacc + model.dof_frictionloss * np.sign(data.qvel)
        out[k] = (rigid + own - data.qfrc_passive)[dofs]
    return out
