"""Describe a MuJoCo model as links and joints for adam-robotics, with masses and lengths as CasADi expressions.

adam reads MuJoCo models itself, but drops joints attached to the world and treats every number as a constant. Here each
moving body, with all bodies welded to it, is one link, whose frame is at the anchor of its joint.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from plants.mujoco_robot.edits.batch import link_direction
from plants.mujoco_robot.edits.masses import quat_to_matrix
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.extras import extra

if TYPE_CHECKING:
    import mujoco

WORLD = "world"
ROUNDING = 1e-14  # entries of a direction closer than this to an integer are rounded, so that CasADi drops products


@dataclass(frozen=True)
class Changes:
    """Differences from the compiled model, as numbers or CasADi scalars, by body number.

    masses: kg, in place of the body's own; its inertia scales with it. added: kg at the body's own centre of mass.
    shifts: m, of the centre of mass towards the next joint. offsets: m, by which the link is longer up to the next
    joint. tool: kg at the payload site, or tool_offset m from it along the site's axes.
    """

    masses: Mapping[int, Any] = field(default_factory=dict)
    added: Mapping[int, Any] = field(default_factory=dict)
    shifts: Mapping[int, Any] = field(default_factory=dict)
    offsets: Mapping[int, Any] = field(default_factory=dict)
    tool: Any = 0.0
    tool_offset: Sequence[Any] | None = None


@dataclass(frozen=True, eq=False)
class Frame:
    """A body's pose in the frame of its link. link: a joint's name, or WORLD; place: (3,) position, m, a CasADi column;
    turn: (3, 3) rotation matrix.
    """

    link: str
    place: Any
    turn: np.ndarray


@dataclass(frozen=True, eq=False)
class JointPlace:
    """A joint. parent: its parent link; place (3,) m and turn (3, 3): its position and rotation in that link's frame;
    axis (3,): in its own frame; slides: whether it is prismatic; zero: its position in the model's initial
    configuration (qpos0), rad or m.
    """

    name: str
    parent: str
    place: Any
    turn: np.ndarray
    axis: np.ndarray
    slides: bool
    zero: float


@dataclass(frozen=True, eq=False)
class Description:
    """joints: in the order of `CompiledRobot.joints`. inertias: link -> (6, 6) spatial inertia in its frame. frames: by
    body. tool: (3,) position of the payload site in the frame of tool_link, m.
    """

    joints: tuple[JointPlace, ...]
    inertias: Mapping[str, Any]
    frames: Mapping[int, Frame]
    tool_link: str
    tool: Any


def describe(robot: CompiledRobot, changes: Changes) -> Description:
    """The description of a robot on a fixed base, with changes to its model."""
    with extra("arm"):
        import casadi as ca

    model = robot.model
    frames = {0: Frame(WORLD, ca.DM.zeros(3), np.eye(3))}
    joints: dict[str, JointPlace] = {}
    for b in range(1, model.nbody):
        at = _in_parent(robot, b, frames[int(model.body_parentid[b])], changes)
        first, count = int(model.body_jntadr[b]), int(model.body_jntnum[b])
        for j in range(first, first + count):
            anchor = ca.DM(model.jnt_pos[j])
            made = _joint(model, j, at, at.place + ca.mtimes(ca.DM(at.turn), anchor))
            joints[made.name] = made
            at = Frame(made.name, -anchor, np.eye(3))
        frames[b] = at
    inertias: dict[str, Any] = {name: ca.DM.zeros(6, 6) for name in (WORLD, *joints)}
    for b in range(1, model.nbody):
        inertias[frames[b].link] = inertias[frames[b].link] + _inertia(robot, b, frames[b], changes)
    body, place = robot.payload
    held = frames[body]
    tool = held.place + ca.mtimes(ca.DM(held.turn), ca.DM(place))
    mass_at = tool if changes.tool_offset is None else tool + _turned(robot, held, changes.tool_offset)
    inertias[held.link] = inertias[held.link] + _spatial(ca.DM.zeros(3, 3), changes.tool, mass_at)
    return Description(tuple(joints[j] for j in robot.joints), inertias, frames, held.link, tool)


def _turned(robot: CompiledRobot, held: Frame, offset: Sequence[Any]) -> Any:
    """A vector along the payload site's axes, in the frame of the link that holds it, m."""
    import casadi as ca

    return ca.mtimes(ca.DM(_rounded(held.turn @ robot.payload_axes)), ca.vertcat(*offset))


def _in_parent(robot: CompiledRobot, b: int, parent: Frame, changes: Changes) -> Frame:
    """The pose of body b before its own joints, in the frame of its parent's link."""
    import casadi as ca

    model, place = robot.model, ca.DM(robot.model.body_pos[b])
    if robot.lengths is not None:
        for link, offset in changes.offsets.items():
            if robot.lengths.next[link] == b:
                place = place + offset * ca.DM(_rounded(robot.lengths.lines[link][0]))
    turn = ca.DM(parent.turn)
    own = _rounded(quat_to_matrix(model.body_quat[b]))
    return Frame(parent.link, parent.place + ca.mtimes(turn, place), _rounded(parent.turn @ own))


def _joint(model: "mujoco.MjModel", j: int, at: Frame, place: Any) -> JointPlace:
    import mujoco

    slides = int(model.jnt_type[j]) == int(mujoco.mjtJoint.mjJNT_SLIDE)
    zero = float(model.qpos0[model.jnt_qposadr[j]])
    return JointPlace(model.joint(j).name, at.link, place, at.turn, _rounded(model.jnt_axis[j]), slides, zero)


def _inertia(robot: CompiledRobot, b: int, at: Frame, changes: Changes) -> Any:
    """(6, 6) spatial inertia of body b in its link's frame. Mass added at the centre of mass does not change the
    rotational inertia about it."""
    import casadi as ca

    model = robot.model
    turn = quat_to_matrix(model.body_iquat[b])
    about = (turn * model.body_inertia[b]) @ turn.T
    own = float(model.body_mass[b])
    mass = changes.masses.get(b, own)
    about = ca.DM(about) * (mass / own) if b in changes.masses else ca.DM(about)
    centre = ca.DM(model.body_ipos[b])
    if b in changes.shifts:
        centre = centre + changes.shifts[b] * ca.DM(link_direction(model, b))
    if b in changes.added:
        mass = mass + changes.added[b]
    frame = ca.DM(at.turn)
    return _spatial(ca.mtimes(ca.mtimes(frame, about), frame.T), mass, at.place + ca.mtimes(frame, centre))


def _spatial(about: Any, mass: Any, centre: Any) -> Any:
    """Featherstone, Rigid Body Dynamics Algorithms, 2008, eq. 2.63, with the linear part first, as in adam."""
    import casadi as ca

    c = ca.skew(centre)
    corner = mass * c
    return ca.vertcat(ca.horzcat(mass * ca.DM.eye(3), corner.T), ca.horzcat(corner, about + mass * ca.mtimes(c, c.T)))


def _rounded(x: np.ndarray) -> np.ndarray:
    """Directions with entries near 0 and 1 made exact."""
    whole = np.round(x)
    return np.where(np.abs(x - whole) < ROUNDING, whole, x)
