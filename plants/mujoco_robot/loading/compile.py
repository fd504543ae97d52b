"""From a model file to a compiled model whose joints and actuators have names."""

import logging
import re
from collections.abc import Mapping, Sequence
from functools import cache
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from plants.mujoco_log import silence_mujoco
from plants.mujoco_robot.loading.absent import leave_out_absent
from plants.mujoco_robot.loading.held import hold_joints, hold_others
from plants.mujoco_robot.structure.base import hinges_and_slides
from plants.mujoco_robot.structure.force_limits import NO_LIMIT
from residual_mpc.errors import BadInput
from residual_mpc.logs.columns import did_you_mean
from residual_mpc.models.actuators import Actuator

if TYPE_CHECKING:
    import mujoco

LOG = logging.getLogger(__name__)


def compile_model(
    path: str,
    actuators: Mapping[str, Actuator] | None = None,
    held: Sequence[str] = (),
    payload_site: str | None = None,
) -> "tuple[mujoco.MjSpec, mujoco.MjModel, tuple[str, ...]]":
    """What the file says, the compiled model with a finite, never active force range on every actuator that had none,
    and the names of the actuators that it holds.

    `actuators` join by the name of the joint that they drive, `held` names joints or actuators to hold besides those
    that act on no joint. A `payload_site` that is a body and no site becomes a site at the body's origin: a URDF has
    links, and MuJoCo merges those on fixed joints, such as `tool0`, into what carries them. Shapes whose files are
    absent are left out, and a warning says so.
    """
    import mujoco

    silence_mujoco()
    _refuse_xacro(path)
    try:
        spec = mujoco.MjSpec.from_file(path)
        absent, others = leave_out_absent(spec, path), hold_others(spec)
        if actuators:
            _add(spec, actuators, path)
        place = None if payload_site in (None, "world") or spec.site(payload_site) else spec.body(payload_site)
        if place is not None:
            place.add_site(name=payload_site)
        fixed = hold_joints(spec, held, path)
        mark_simple(spec, False)
        model = spec.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise BadInput(f"MuJoCo does not compile this model: {reason}", path, "fix the model file") from error
    if absent:
        say(path, absent)
    if others:
        names = ", ".join(repr(name) for name in others)
        say(path, f"{names} act{'s' * (len(others) == 1)} on no joint: held at rest, not commanded")
    return spec, prepared(model), (*others, *fixed)


def mark_simple(spec: "mujoco.MjSpec", simple: bool) -> None:
    """Whether MuJoCo may take a body on slides or a free joint, with its centre of mass at its origin, for one whose
    inertia is constant. It may not in the models of hypotheses: a payload moves the centre of mass."""
    for body in spec.bodies:
        if body.name != "world":
            body.simple = int(simple)


def _refuse_xacro(path: str) -> None:
    """Raises BadInput for a xacro file, under whatever name: its macros are ROS's to expand."""
    file = Path(path)
    try:
        text = re.sub(rb"<!--.*?-->", b"", file.read_bytes(), flags=re.DOTALL)
    except OSError:
        return
    if file.suffix != ".xacro" and b"<xacro:" not in text:  # an expanded URDF may still declare the name space
        return
    plain = file.name.removesuffix(".xacro").removesuffix(".urdf") + ".urdf"
    plain = f"expanded_{plain}" if plain == file.name else plain
    raise BadInput(
        "this is a xacro file, not a URDF", path,
        f"expand it with `xacro {file.name} > {plain}` (part of ROS, or `pip install xacro`), with the arguments that "
        f"your launch file gives it as NAME:=VALUE, and give {plain}",
    )  # fmt: skip


def say(path: str, message: str) -> None:
    """One warning a process and file: a model is compiled anew for every variant, and `init` compiles it twice."""
    file = Path(path).resolve()
    _say_once(str(file.relative_to(Path.cwd()) if file.is_relative_to(Path.cwd()) else file), message)


@cache
def _say_once(file: str, message: str) -> None:
    LOG.warning(f"{file}: {message}")


def _add(spec: "mujoco.MjSpec", actuators: Mapping[str, Actuator], path: str) -> None:
    """Actuators named like their joints, in a model that had none; stepped so that their damping is implicit."""
    import mujoco

    joints = [joint.name for joint in spec.joints]
    taken = [actuator.name for actuator in spec.actuators]
    if taken:
        raise BadInput(
            f"the model has actuators of its own ({', '.join(taken)})", path, "remove the tables [actuator.*]"
        )
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for name, given in actuators.items():
        if name not in joints:
            raise BadInput(f"[actuator.{name}] does not match any joint of the model", path, did_you_mean(name, joints))
        added = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        added.gear[0] = given.gear
        if given.kind == "position":
            added.set_to_position(kp=given.kp, kv=given.kv)
        elif given.kind == "velocity":
            added.set_to_velocity(kv=given.kv)
        else:
            added.set_to_motor()
        if given.armature > 0.0:
            spec.joint(name).armature = given.armature
        if isfinite(given.limit):
            added.forcelimited, added.forcerange = True, (-given.limit, given.limit)


def prepared(model: "mujoco.MjModel") -> "mujoco.MjModel":
    """The model itself, with a force range on every actuator, and its constraints solved as one: in a robot they hang
    together, and to look for islands among them takes a fifth of a step.

    What runs away is not put back to its start, where it would pass for a robot that stands still.
    """
    import mujoco

    free = model.actuator_forcelimited == 0
    model.actuator_forcerange[free] = (-NO_LIMIT, NO_LIMIT)
    model.actuator_forcelimited[:] = 1
    for off in (mujoco.mjtDisableBit.mjDSBL_ISLAND, mujoco.mjtDisableBit.mjDSBL_AUTORESET):
        model.opt.disableflags |= int(off)
    return model


def refuse_unsupported(model: "mujoco.MjModel", path: str) -> None:
    """Raises BadInput for ball joints, actuators that act on no joint or on a free one, and what has no name."""
    import mujoco

    for j in range(model.njnt):
        if int(model.jnt_type[j]) == int(mujoco.mjtJoint.mjJNT_BALL):
            raise BadInput(
                f"joint {model.joint(j).name!r} is a ball joint",
                path,
                "only hinge and slide joints are supported, and the free joint of a mobile robot",
            )
    for i in range(model.nu):
        if int(model.actuator_trntype[i]) != int(mujoco.mjtTrn.mjTRN_JOINT):
            raise BadInput(
                f"actuator {model.actuator(i).name!r} does not act on a joint",
                path,
                "set joint=... as its transmission",
            )
        if int(model.jnt_type[model.actuator_trnid[i, 0]]) == int(mujoco.mjtJoint.mjJNT_FREE):
            raise BadInput(
                f"actuator {model.actuator(i).name!r} acts on a free joint", path, "drive only hinge and slide joints"
            )
    for kind, numbers in (("joint", hinges_and_slides(model)), ("actuator", np.arange(model.nu))):
        access = getattr(model, kind)
        for i in numbers.tolist():
            if not access(i).name:
                raise BadInput(f"{kind} number {i} has no name", path, f'add name="..." to every {kind}')
