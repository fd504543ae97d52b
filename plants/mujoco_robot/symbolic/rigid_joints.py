"""Joints that are rigid in the CasADi step, which has no couplings: those of a gripper that no command moves, on a
tendon or coupled to each other, and those that are held. They are fixed at the model's reference configuration.
Controllers would track a held joint that stayed in the step, and cannot move it."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from plants.mujoco_robot.edits.masses import quat_to_matrix
from plants.mujoco_robot.loading.compile import prepared
from plants.mujoco_robot.loading.held import held_joints
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.effects.phrase import called
from residual_mpc.models.settings import Settings

if TYPE_CHECKING:
    import mujoco

PAYLOAD_SITE = "residual_mpc.payload"  # name of the site that marks its place


def rigid_joints(robot: CompiledRobot) -> tuple[str, ...]:
    """The joints that are held, and those that are coupled to others or on a tendon; none of the latter where one of
    them has a motor, or where something else than joints is coupled. A held joint of a URDF stays: without it, its body
    would be fused with another."""
    model = robot.model
    coupled = _gripper(model)
    loose = set() if coupled else _coupled(model)  # they stay, with what couples them
    held = {model.joint(name).id for name in held_joints(robot)}
    if robot.spec is not None and robot.spec.compiler.fusestatic:
        held = set()
    return tuple(model.joint(j).name for j in sorted(coupled | (held - loose)))


def _gripper(model: "mujoco.MjModel") -> set[int]:
    """Numbers of the coupled joints, where no motor moves them."""
    coupled = _coupled(model)
    return set() if coupled & set(model.actuator_trnid[:, 0].tolist()) else coupled


def with_rigid_joints(robot: CompiledRobot, settings: Settings) -> tuple[CompiledRobot, Settings, tuple[str, ...]]:
    """The robot without these joints, its settings, and what that leaves out, in sentences."""
    names = rigid_joints(robot)
    if not names or robot.spec is None:
        return robot, settings, ()
    spec = robot.spec.copy()
    coupling = (*spec.equalities, *spec.tendons) if _gripper(robot.model) else ()
    for element in (*coupling, *spec.keys, *_sensors_on(spec, names)):
        spec.delete(element)
    for name in names:
        spec.delete(spec.joint(name))
    _mark_payload(robot, spec)
    model = prepared(spec.compile())
    site = model.site(PAYLOAD_SITE)
    payload, axes = (int(site.bodyid[0]), site.pos.copy()), quat_to_matrix(site.quat)
    rigid = replace(robot, model=model, spec=spec, loops=None, payload=payload, payload_axes=axes)
    left_out = f"{_listed(names)}: fixed in the step, at the model's reference configuration (qpos0)"
    return rigid, _on(robot, rigid, settings), (left_out,)


def _mark_payload(robot: CompiledRobot, spec: "mujoco.MjSpec") -> None:
    """A site where the payload is: without its joint, the body that holds it may be fused with another one."""
    import mujoco

    body, place = robot.payload
    name, quat = robot.model.body(body).name, np.empty(4)
    mujoco.mju_mat2Quat(quat, robot.payload_axes.ravel())
    holds = spec.body(name) if name else spec.bodies[body]
    holds.add_site(name=PAYLOAD_SITE, pos=place, quat=quat)


def _coupled(model: "mujoco.MjModel") -> set[int]:
    """Numbers of the joints in equality constraints and tendons; empty where one of these holds something else."""
    import mujoco

    found: set[int] = set()
    for i in range(model.neq):
        if int(model.eq_type[i]) != int(mujoco.mjtEq.mjEQ_JOINT):
            return set()
        found |= {int(j) for j in (model.eq_obj1id[i], model.eq_obj2id[i]) if j >= 0}
    if (model.wrap_type != int(mujoco.mjtWrap.mjWRAP_JOINT)).any():
        return set()
    return found | set(model.wrap_objid.tolist())


def _sensors_on(spec: "mujoco.MjSpec", names: tuple[str, ...]) -> "list[mujoco.MjsSensor]":
    """Sensors of these joints and of tendons."""
    import mujoco

    joint, tendon = mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_TENDON
    return [s for s in spec.sensors if s.objtype == tendon or (s.objtype == joint and s.objname in names)]


def _on(robot: CompiledRobot, rigid: CompiledRobot, settings: Settings) -> Settings:
    """The settings on the slots that are left."""
    effects = {}
    for effect, parameters in settings.effects.items():
        places = [i for i, slot in enumerate(robot.slots(effect)) if slot in rigid.slots(effect)]
        if places:
            effects[effect] = {name: np.asarray(values)[:, places] for name, values in parameters.items()}
    gone = tuple(f"joint.{j}." for j in robot.joints if j not in rigid.joints)
    tuned = {name: values for name, values in settings.tuned.items() if not name.startswith(gone)}
    return replace(settings, effects=effects, tuned=tuned)


def _listed(names: tuple[str, ...]) -> str:
    return called("joint", names[0]) if len(names) == 1 else f"joints {', '.join(names)}"
