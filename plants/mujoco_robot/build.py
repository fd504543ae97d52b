"""From a robot file to a MuJoCo robot."""

from typing import TYPE_CHECKING

import numpy as np

from plants.mujoco_log import collected_warnings
from plants.mujoco_robot.edits.masses import quat_to_matrix
from plants.mujoco_robot.loading.compile import compile_model, refuse_unsupported, say
from plants.mujoco_robot.loading.speed_limits import speed_limits
from plants.mujoco_robot.robot import SteppingMujoco
from plants.mujoco_robot.structure.base import Base, find_base, free_bodies
from plants.mujoco_robot.structure.loops import find_loops
from residual_mpc.errors import BadInput
from residual_mpc.models.robot_file import RobotFile

if TYPE_CHECKING:
    import mujoco


def build(robot: RobotFile) -> SteppingMujoco:
    """The robot of a file whose plant is `mujoco`.

    Raises BadInput where numbers are given beside the model's own, and where the model does not compile, has no
    actuator, or needs what is not supported yet (ball joints, loops that leave a joint undetermined, a free joint that
    `pose_body` does not name).
    """
    if robot.model is None:
        raise BadInput(
            "key 'model' is missing", robot.name, 'add model = "my_robot.xml" (MJCF or URDF) to the robot file'
        )
    if robot.parameters and robot.plant == "mujoco":
        raise BadInput(
            f"a MuJoCo model does not read [parameters], got {', '.join(robot.parameters)}",
            robot.name,
            "change the values in the model file, or list them under tunable to have them fitted",
        )
    path = str(robot.model)
    with collected_warnings() as warnings:
        spec, model, held = compile_model(path, robot.actuators, robot.held, robot.payload_site)
        base = find_base(model, robot.pose_body, path)
        _say_unmeasured(model, base, path)
        _refuse_undriven(model, path)
        refuse_unsupported(model, path)
        site, axes = _payload_site(spec, model, robot)
        loops = find_loops(model, path)
    for warning in warnings:
        say(path, f"MuJoCo warns: {warning}")
    sides = robot.servo_feedback, robot.position_sensor
    fastest = speed_limits(path)
    return SteppingMujoco(
        robot.name, model, site, *sides, base, loops, spec, held=held, payload_axes=axes, speed_limits=fastest
    )


def _say_unmeasured(model: "mujoco.MjModel", base: Base | None, path: str) -> None:
    """Free bodies but the base have no channel: objects, or robots that another robot file is for."""
    others = [model.body(b).name or f"number {b}" for b in free_bodies(model) if base is None or b != base.body]
    if others:
        say(path, f"free without a measured pose: {', '.join(others)}; each window starts with them as in the model")


def _refuse_undriven(model: "mujoco.MjModel", path: str) -> None:
    if model.nu == 0:
        raise BadInput(
            "the model has no actuator on a joint",
            path,
            "add one <position>, <velocity> or <motor> per driven joint, or a table such as "
            '[actuator.elbow] with kind = "position" and kp = 20.0 to the robot file (a URDF has none)',
        )


def _payload_site(
    spec: "mujoco.MjSpec", model: "mujoco.MjModel", robot: RobotFile
) -> tuple[tuple[int, np.ndarray], np.ndarray]:
    """(body, position in its frame (3,) m) and axes there (3, 3) of the payload: the named site, else the last body's
    last site, else its centre of mass with the body's own axes."""
    import mujoco

    if robot.payload_site is not None:
        site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, robot.payload_site)
        if site < 0:
            places = [*(s.name for s in spec.sites), *(b.name for b in spec.bodies if b.name != "world")]
            known = ", ".join(name for name in dict.fromkeys(places) if name)
            raise BadInput(
                f"payload_site {robot.payload_site!r} is neither a site nor a body of the model", robot.name,
                f"the model has: {known}",
            )  # fmt: skip
        return _at_site(model, site)
    body = model.nbody - 1
    sites = [i for i in range(model.nsite) if int(model.site_bodyid[i]) == body]
    return _at_site(model, sites[-1]) if sites else ((body, model.body_ipos[body].copy()), np.eye(3))


def _at_site(model: "mujoco.MjModel", site: int) -> tuple[tuple[int, np.ndarray], np.ndarray]:
    place = int(model.site_bodyid[site]), model.site_pos[site].copy()
    return place, quat_to_matrix(model.site_quat[site])
