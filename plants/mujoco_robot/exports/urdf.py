"""The diagnosed model as a URDF: the user's own text with the masses, frictions, limits and origins corrected."""

import os
from pathlib import Path
from xml.parsers import expat

import numpy as np

from plants.mujoco_robot.edits.masses import parallel_axis, quat_to_matrix
from plants.mujoco_robot.exports.urdf_text import Element, UrdfText, read_urdf_text
from plants.mujoco_robot.loading.compile import compile_model
from plants.mujoco_robot.mjcf import apart, not_held, settled
from plants.mujoco_robot.simulation.constants import corrected_constants
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.effects.effect import Effect
from residual_mpc.effects.library import BY_NAME
from residual_mpc.errors import BadInput
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Settings
from residual_mpc.models.simulating import Exported

SAYS = {  # quantities of effects that a URDF has a place for
    "viscous damping", "dry friction", "tool mass", "tool x", "tool y", "tool z", "link mass", "link centre",
    "link length",
}  # fmt: skip
TUNED = {"damping", "frictionloss", "mass"}  # ends of the names of nominal parameters that it has a place for
LACKS = {  # site of an effect -> why a URDF does not say it
    "rotor": "URDF has no rotor inertia",
    "strength": "URDF has no actuators",
    "position gain": "URDF has no actuators",
    "elastic": "URDF has no springs or constant torques",
    "stop": "its limits are those of the controller",
    "gravity": "URDF does not say where the base stands",
    "compensation": "URDF has no controller",
    "command": "URDF has no actuators, and so no delay or lag",
}


def to_urdf(robot: CompiledRobot, settings: Settings, source: Path, folder: Path) -> Exported:
    """See WritesUrdf. source: the robot's own model file. Raises BadInput where that is no URDF, or the robot has
    several settings."""
    if source.suffix.lower() != ".urdf" or robot.settings:
        why = "its variants use several models" if robot.settings else f"its model {source.name} is an MJCF"
        raise BadInput(
            f"{robot.name!r} cannot be exported as URDF: {why}", "`to=urdf`",
            "export to mjcf" if not robot.settings else "export each model file separately",
        )  # fmt: skip
    reasons = {e: _not_said(BY_NAME[e]) for e in settings.effects}
    left_out = [f"{e}: {why}" for e, why in reasons.items() if why]
    left_out += [f"{name}: URDF has no place for it" for name in settings.tuned if name.rpartition(".")[2] not in TUNED]
    tuned = {k: v for k, v in settings.tuned.items() if k.rpartition(".")[2] in TUNED}
    said = settled(Settings(1, {e: p for e, p in settings.effects.items() if not reasons[e]}, tuned))
    try:
        text = read_urdf_text(source.read_bytes())
    except expat.ExpatError as error:
        raise BadInput(f"not valid XML: {error}", str(source), "fix the model file") from error
    new = corrected_constants(robot, said)
    _write(text, robot, new, said)
    _move_meshes(text, source.resolve().parent, folder.resolve())
    notes = tuple(f"{e}: {BY_NAME[e].in_mjcf}" for e in settings.effects if BY_NAME[e].in_mjcf and not reasons[e])
    if "actuator_biasprm" in new:  # the strengths, which scale it too, are left out
        notes = (*notes, "viscous friction: the joints' own is gone; lower the servos' damping where they are set")
    if "dof_solimp" in new:
        notes = (
            *notes,
            "dry friction: the torque alone; how firmly an engine lets it hold is the engine's own setting",
        )
    if notes or left_out:
        listed = "".join(f"\n  {kind}: {what}" for kind, all_ in _kinds(notes, left_out) for what in all_)
        text.insert(text.root, f"\n<!-- residual-mpc{listed.replace('--', '- -')}\n-->")
    return Exported(text.result(), notes, tuple(left_out), said)


def compare_urdf(
    robot: CompiledRobot, made: Exported, settings: Settings, path: Path, file: RobotFile
) -> tuple[float, float, int]:
    """Largest difference of a joint (rad or m) between the written file, with the robot's own actuators, and the replay
    of what it says, and of all effects; and at how many samples."""
    spec, _, _ = compile_model(str(path), file.actuators, file.held)
    (some, whole), points = apart(robot, (made.said, settings), spec)
    return some, whole, points


def _not_said(effect: Effect) -> str:
    """Why a URDF does not say the effect; empty where it does."""
    if effect.place in LACKS:
        return LACKS[effect.place]
    if effect.own or effect.not_in_mjcf:
        return "a user-defined effect cannot be expressed in URDF" if effect.own else not_held(effect)
    return (
        "" if all(p.quantity in SAYS or p.quantity is None for p in effect.parameters) else "URDF has no place for it"
    )


def _kinds(notes: tuple[str, ...], left_out: list[str]) -> tuple[tuple[str, list[str]], ...]:
    return ("approximated", [*notes]), ("left out", left_out)


def _write(text: UrdfText, robot: CompiledRobot, new: dict[str, np.ndarray], said: Settings) -> None:
    """Put the constants that differ into the text."""
    model = robot.model
    links = {str(link.attributes.get("name")): link for link in text.root.all("link")}
    joints = {str(joint.attributes.get("name")): joint for joint in text.root.all("joint")}
    for b in range(1, model.nbody):
        name = model.body(b).name
        if any(
            f"body_{f}" in new and _differs(new, model, f"body_{f}", b) for f in ("mass", "ipos", "inertia", "iquat")
        ):
            _write_inertial(text, links[name], _moments(model, b, new) - _moments(model, b, {}))
        if "body_pos" in new and _differs(new, model, "body_pos", b):
            holder = next(j for j in joints.values() if j.find("child").attributes["link"] == name)  # type: ignore[union-attr]
            shift = _fixed_turn(joints, model, holder).T @ (new["body_pos"][b] - model.body_pos[b])
            origin = holder.find("origin")
            xyz = _numbers("0 0 0" if origin is None else origin.attributes.get("xyz", "0 0 0"))
            text.write(holder, "origin", {"xyz": _row(xyz + shift)})
    for j, name in enumerate(robot.joints):
        dof, values = int(robot.dofs[j]), {}
        for field, key in (("dof_damping", "damping"), ("dof_frictionloss", "friction")):
            if field in new and _differs(new, model, field, dof):
                values[key] = _row(new[field][dof : dof + 1])
        if values:
            text.write(joints[name], "dynamics", values)
    if "actuator_forcerange" in new:
        for i, actuator in enumerate(robot.actuators):
            limit = float(np.abs(new["actuator_forcerange"][i]).max() * abs(model.actuator_gear[i, 0]))
            if _differs(new, model, "actuator_forcerange", i):
                text.write(
                    joints[robot.actuator_joints[robot.actuators.index(actuator)]], "limit", {"effort": f"{limit:.9g}"}
                )


def _differs(new: dict[str, np.ndarray], model: object, field: str, at: int) -> bool:
    return not np.array_equal(new[field][at], getattr(model, field)[at])


def _moments(model: object, b: int, new: dict[str, np.ndarray]) -> np.ndarray:
    """(10,) mass, first moments and inertia (xx, yy, zz, xy, xz, yz) of a body about its frame: these add."""
    mass, centre, turn, inertia = (
        new.get(f"body_{f}", getattr(model, f"body_{f}"))[b] for f in ("mass", "ipos", "iquat", "inertia")
    )
    r = quat_to_matrix(turn)
    about = r @ np.diag(inertia) @ r.T + parallel_axis(np.array([mass]), centre[None])[0]
    return np.array([mass, *(mass * centre), *np.diag(about), about[0, 1], about[0, 2], about[1, 2]])


def _write_inertial(text: UrdfText, link: Element, added: np.ndarray) -> None:
    """Add mass, first moments and inertia (10,) to a link, all about its frame."""
    at = link.find("inertial")
    mass, centre, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    if at is not None:
        origin, m, i = (at.find(tag) for tag in ("origin", "mass", "inertia"))
        mass = float(m.attributes["value"]) if m is not None else 0.0
        r = np.eye(3)
        if origin is not None:
            centre, r = _numbers(origin.attributes.get("xyz", "0 0 0")), _turn(origin)
        if i is not None:
            a = {k: float(i.attributes.get(k, 0.0)) for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")}
            own = np.array(
                [[a["ixx"], a["ixy"], a["ixz"]], [a["ixy"], a["iyy"], a["iyz"]], [a["ixz"], a["iyz"], a["izz"]]]
            )
            inertia = r @ own @ r.T
    total = mass + added[0]
    middle = (mass * centre + added[1:4]) / total if total > 0 else centre
    xx, yy, zz, xy, xz, yz = added[4:]
    about = inertia + parallel_axis(np.array([mass]), centre[None])[0]
    about = about + np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    about = about - parallel_axis(np.array([total]), middle[None])[0]
    keys = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
    tensor = {k: f"{about[ij]:.9g}" for k, ij in keys.items()}
    if at is None:
        inner = "".join(f' {k}="{v}"' for k, v in tensor.items())
        inertial = f'<inertial><origin xyz="{_row(middle)}"/><mass value="{total:.9g}"/><inertia{inner}/></inertial>'
        text.insert(link, inertial)
        return
    text.write(at, "origin", {"xyz": _row(middle), "rpy": "0 0 0"})
    text.write(at, "mass", {"value": f"{total:.9g}"})
    text.write(at, "inertia", tensor)


def _fixed_turn(joints: dict[str, Element], model: object, joint: Element) -> np.ndarray:
    """(3, 3) from the frame that a joint's origin is written in to that of the body that MuJoCo made of it and the
    links that are fixed to it."""
    turn, link = np.eye(3), joint.find("parent").attributes["link"]  # type: ignore[union-attr]
    while True:
        above = next((j for j in joints.values() if j.find("child").attributes["link"] == link), None)  # type: ignore[union-attr]
        if above is None or above.attributes.get("type") != "fixed":
            return turn
        origin = above.find("origin")
        turn = (np.eye(3) if origin is None else _turn(origin)) @ turn
        link = above.find("parent").attributes["link"]  # type: ignore[union-attr]


def _turn(origin: Element) -> np.ndarray:
    """(3, 3) of an origin's rpy: about the fixed x, then y, then z."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler("xyz", _numbers(origin.attributes.get("rpy", "0 0 0"))).as_matrix())


def _move_meshes(text: UrdfText, home: Path, folder: Path) -> None:
    """Relative names of files are seen from where the new text will lie; a package's stay."""

    def visit(element: Element) -> None:
        name = element.attributes.get("filename", "")
        if element.tag in ("mesh", "texture") and name and "://" not in name and not name.startswith("/"):
            moved = os.path.relpath(home / name, folder)
            old = text.text[element.begin : element.end].decode()
            text.changes.append((element.begin, element.end, old.replace(name, Path(moved).as_posix()).encode()))
        for child in element.children:
            visit(child)

    visit(text.root)


def _numbers(text: str) -> np.ndarray:
    return np.array([float(x) for x in text.split()])


def _row(values: np.ndarray) -> str:
    return " ".join(f"{v:.9g}" for v in values)
