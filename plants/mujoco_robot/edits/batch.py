"""Effects that change the model itself, as per-simulation values of the batch's model fields.

Rows in which an effect is null keep the compiled values, bit for bit.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from plants.mujoco_robot.edits.damping import edit_damping
from plants.mujoco_robot.edits.masses import add_point_mass, principal, quat_to_matrix
from plants.mujoco_robot.edits.surroundings import edit_surroundings
from plants.mujoco_robot.edits.wheel_sizes import edit_wheels
from plants.mujoco_robot.structure.base import hinges_and_slides
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.mujoco_robot.structure.lengths import Lengths
from residual_mpc.effects.body import TOOL_AXES
from residual_mpc.effects.library import Effects, changes
from residual_mpc.models.settings import Settings

if TYPE_CHECKING:
    import mujoco

TUNABLE_JOINT = {"damping": "dof_damping", "armature": "dof_armature", "frictionloss": "dof_frictionloss"}
DERIVED_FROM = {"dof_armature"}  # what MuJoCo computes constants of the model from


def edit_batch(batch: Any, robot: CompiledRobot, settings: Settings) -> None:
    """Write payload, link masses and lengths, armature, frictions, wheels, surroundings and retuned parameters into the
    batch (one row a simulation).
    """
    model, dofs = robot.model, robot.dofs
    changed = _tune(batch, model, settings)
    effects = settings.effects
    if robot.wheels is not None:
        changed |= edit_wheels(batch, model, robot.wheels, effects)
    offset, rotor, damping = (changes(effects, q) for q in ("link length", "rotor inertia", "viscous damping"))
    if robot.lengths is not None and offset is not None:
        _move_joints(batch, robot.lengths, offset)
        changed = True
    if rotor is not None:
        _add(batch.expand("dof_armature"), dofs, rotor)
        changed = True
    if damping is not None:
        edit_damping(batch, robot, effects, damping)
    stiffness = changes(effects, "servo stiffness")
    if stiffness is not None:
        _scale_position_gains(batch, robot, stiffness)
    changed |= _edit_masses(batch, robot, effects)
    if changed:
        batch.set_const()
    edit_surroundings(batch, robot, effects)  # after the constants, which MuJoCo derives from the rest positions too


def _add(field: np.ndarray, dofs: np.ndarray, value: np.ndarray) -> None:
    """Add to columns of a field (B, nv), in place; what is taken from a retuned value leaves none below 0."""
    field[:, dofs] = np.where(value < 0, np.maximum(field[:, dofs] + value, 0.0), field[:, dofs] + value)


def _scale_position_gains(batch: Any, robot: CompiledRobot, factor: np.ndarray) -> None:
    """Multiply the proportional gains of position servos by factors (B, slots); a factor of 1 leaves every bit."""
    servos = np.array([robot.actuators.index(a) for a in robot.sites["position gain"]])
    batch.expand("actuator_gainprm")[:, servos, 0] *= factor
    batch.expand("actuator_biasprm")[:, servos, 1] *= factor


def _move_joints(batch: Any, lengths: Lengths, offset: np.ndarray) -> None:
    """Move the joints at the links' ends by offsets (B, links) m."""
    place = batch.expand("body_pos")
    for slot, (link, (line, _)) in enumerate(lengths.lines.items()):
        rows = np.flatnonzero(offset[:, slot])
        place[rows, lengths.next[link]] += offset[rows, slot, None] * line


def _edit_masses(batch: Any, robot: CompiledRobot, effects: Effects) -> bool:
    """Write the masses of the links and of the tool; whether any effect changes them."""
    model = robot.model
    links, centres, tool = (changes(effects, q) for q in ("link mass", "link centre", "tool mass"))
    if links is None and centres is None and tool is None:
        return False
    mass, com = batch.expand("body_mass"), batch.expand("body_ipos")
    moments, axes = batch.expand("body_inertia"), batch.expand("body_iquat")

    def rewrite(rows: np.ndarray, body: int, added: np.ndarray, at: np.ndarray) -> None:
        turn = quat_to_matrix(axes[rows, body])
        inertia = turn @ (moments[rows, body][:, :, None] * turn.transpose(0, 2, 1))
        m, c, about = add_point_mass(mass[rows, body], com[rows, body], inertia, added, at)
        mass[rows, body], com[rows, body] = m, c
        moments[rows, body], axes[rows, body] = principal(about)

    none = np.zeros((mass.shape[0], model.nbody - 1))
    more, moved = (none if links is None else links), (none if centres is None else centres)
    for slot in range(model.nbody - 1):
        body = slot + 1
        rows = np.flatnonzero((more[:, slot] != 0) | (moved[:, slot] != 0))
        if not len(rows):
            continue
        # mass at the link's own centre leaves the centre; then the whole moves along the line to the next joint
        rewrite(rows, body, more[rows, slot], com[rows, body].copy())
        com[rows, body] += moved[rows, slot, None] * link_direction(model, body)
    if tool is not None:
        rows = np.flatnonzero(tool[:, 0])
        rewrite(rows, robot.payload[0], tool[rows, 0], tool_places(robot, effects, len(mass))[rows])
    return True


def tool_places(robot: CompiledRobot, effects: Effects, rows: int) -> np.ndarray:
    """(rows, 3) m: where the added mass of the tool is, in its body's frame."""
    offset = np.zeros((rows, 3))
    for axis, quantity in enumerate(TOOL_AXES.values()):
        moved = changes(effects, quantity)
        if moved is not None:
            offset[:, axis] = moved[:, 0]
    return np.asarray(robot.payload[1] + offset @ robot.payload_axes.T)


def link_direction(model: "mujoco.MjModel", body: int) -> np.ndarray:
    """Unit vector (3,) in the body's frame from its joint to the next joint; at the chain's end to the centre of
    mass.
    """
    children = [b for b in range(model.nbody) if int(model.body_parentid[b]) == body and model.body_jntnum[b]]
    line = model.body_pos[children[0]] if children else model.body_ipos[body]
    length = float(np.linalg.norm(line))
    return np.array([1.0, 0.0, 0.0]) if length < 1e-9 else np.asarray(line / length)


def tunable_values(model: "mujoco.MjModel") -> dict[str, float]:
    """Every nominal parameter that `tunable` may name, with its compiled value."""
    out: dict[str, float] = {}
    for j in hinges_and_slides(model).tolist():
        for short, field in TUNABLE_JOINT.items():
            out[f"joint.{model.joint(j).name}.{short}"] = float(np.ravel(getattr(model, field)[model.jnt_dofadr[j]])[0])
    for i in range(model.nu):
        out[f"actuator.{model.actuator(i).name}.kp"] = float(model.actuator_gainprm[i, 0])
        out[f"actuator.{model.actuator(i).name}.kv"] = float(-model.actuator_biasprm[i, 2])
    for b in range(1, model.nbody):
        out[f"body.{model.body(b).name or b}.mass"] = float(model.body_mass[b])
    return out


def _tune(batch: Any, model: "mujoco.MjModel", settings: Settings) -> bool:
    """Write the retuned parameters; whether derived constants have to follow."""
    derived = False
    for name, value in settings.tuned.items():
        kind, rest = name.split(".", 1)
        target, _, short = rest.rpartition(".")
        if kind == "joint":
            dof = int(model.jnt_dofadr[model.joint(target).id])
            batch.expand(TUNABLE_JOINT[short])[:, dof] = value
            derived |= TUNABLE_JOINT[short] in DERIVED_FROM
        elif kind == "actuator":
            i = model.actuator(target).id
            if short == "kp":
                batch.expand("actuator_gainprm")[:, i, 0] = value
                if model.actuator_biasprm[i, 1] != 0:
                    batch.expand("actuator_biasprm")[:, i, 1] = -value
            else:
                batch.expand("actuator_biasprm")[:, i, 2] = -value
        else:
            body = model.body(target).id
            ratio = value / model.body_mass[body]
            batch.expand("body_mass")[:, body] = value
            batch.expand("body_inertia")[:, body] *= ratio[:, None]
            derived = True
    return derived
