"""From a robot file to a compiled model whose joints and actuators have names."""

from typing import TYPE_CHECKING

import numpy as np

from plants.mujoco_robot.base import find_base, hinges_and_slides
from plants.mujoco_robot.loops import find_loops
from residual_mpc.errors import BadInput
from residual_mpc.models.robot_file import RobotFile

if TYPE_CHECKING:
    import mujoco

    from plants.mujoco_robot.robot import MujocoRobot

NO_LIMIT = 1e10  # N m: a force range that never bites, so that `saturation` can be set on any actuator


def build(robot: RobotFile) -> "MujocoRobot":
    """The robot of a file whose plant is `mujoco`.

    Raises BadInput where the model does not compile, has no actuator, or needs what is not supported yet
    (ball joints, loops that leave a joint undetermined, a free joint that `pose_body` does not name).
    """
    from plants.mujoco_robot.robot import MujocoRobot

    if robot.model is None:
        raise BadInput("no model is named", robot.name, 'add model = "my_robot.xml" (MJCF or URDF) to the robot file')
    model = compile_model(str(robot.model))
    base = find_base(model, robot.pose_body, str(robot.model))
    _refuse_unsupported(model, str(robot.model))
    site = _payload_site(model, robot)
    loops = find_loops(model, str(robot.model))
    return MujocoRobot(robot.name, model, site, robot.servo_feedback, robot.position_sensor, base, loops)


def compile_model(path: str) -> "mujoco.MjModel":
    """The compiled model with a finite, never active force range on every actuator that had none."""
    import mujoco

    try:
        model = mujoco.MjModel.from_xml_path(path)
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise BadInput(f"MuJoCo does not compile this model: {reason}", path, "mend the model file") from error
    return limited(model)


def limited(model: "mujoco.MjModel") -> "mujoco.MjModel":
    """The model itself, with a force range on every actuator."""
    free = model.actuator_forcelimited == 0
    model.actuator_forcerange[free] = (-NO_LIMIT, NO_LIMIT)
    model.actuator_forcelimited[:] = 1
    return model


def _refuse_unsupported(model: "mujoco.MjModel", path: str) -> None:
    import mujoco

    if model.nu == 0:
        raise BadInput(
            "the model has no actuator",
            path,
            "add one <position>, <velocity> or <motor> per driven joint (a URDF has none)",
        )
    for j in range(model.njnt):
        if int(model.jnt_type[j]) == int(mujoco.mjtJoint.mjJNT_BALL):
            raise BadInput(
                f"joint {model.joint(j).name!r} is a ball joint",
                path,
                "hinge and slide joints are supported, and a driving robot's free joint",
            )
    for i in range(model.nu):
        if int(model.actuator_trntype[i]) != int(mujoco.mjtTrn.mjTRN_JOINT):
            raise BadInput(
                f"actuator {model.actuator(i).name!r} does not act on a joint",
                path,
                "give it joint=... as its transmission",
            )
    for kind, numbers in (("joint", hinges_and_slides(model)), ("actuator", np.arange(model.nu))):
        access = getattr(model, kind)
        for i in numbers.tolist():
            if not access(i).name:
                raise BadInput(f"{kind} number {i} has no name", path, f'add name="..." to every {kind}')


def _payload_site(model: "mujoco.MjModel", robot: RobotFile) -> tuple[int, np.ndarray]:
    """(body, position in its frame (3,) m) of the payload: the named site, else the last body's last site, else its
    centre of mass."""
    import mujoco

    if robot.payload_site is not None:
        site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, robot.payload_site)
        if site < 0:
            known = ", ".join(model.site(i).name for i in range(model.nsite)) or "none"
            raise BadInput(
                f"payload_site {robot.payload_site!r} is no site of the model", robot.name, f"its sites are: {known}"
            )
        return int(model.site_bodyid[site]), model.site_pos[site].copy()
    body = model.nbody - 1
    sites = [i for i in range(model.nsite) if int(model.site_bodyid[i]) == body]
    return body, (model.site_pos[sites[-1]] if sites else model.body_ipos[body]).copy()
