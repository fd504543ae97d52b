"""A diagnosis written into the robot's own URDF."""

import json
from pathlib import Path
from typing import Any

from residual_mpc.errors import BadInput
from residual_mpc.export.agreement import position_unit
from residual_mpc.export.augmented import settings_from
from residual_mpc.files import write_atomically
from residual_mpc.learning.network.written import residual_in
from residual_mpc.models.model_file import Written
from residual_mpc.models.protocol import Robot
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.simulating import WritesUrdf


def write_urdf(written: Written, robot: Robot, file: RobotFile, folder: Path) -> dict[str, Any]:
    """Write the effects of a diagnosis.json or model.json into the robot's URDF, and describe it.

    Raises BadInput for a robot whose model is no URDF, a model of another robot, or one with a network.
    """
    settings = settings_from(written, robot)
    if not isinstance(robot, WritesUrdf) or file.model is None:
        raise BadInput(f"{robot.name!r} has no URDF", "`to=urdf`", "export to casadi, c or jax")
    if residual_in(written) is not None:
        raise BadInput("a URDF cannot contain a network", written.where, "export the diagnosis that it was learned on")
    made = robot.to_urdf(settings, file, folder)
    path = folder / file.model.name
    write_atomically(path, made.text)
    apart, whole, points = robot.compare_urdf(made, settings, file, path)
    document = {
        "to": "urdf",
        "robot": robot.name,
        "files": {path.name: "the model with the effects that URDF can express"},
        "approximated": list(made.approximated),
        "left_out": list(made.left_out),
        "largest_difference": {
            "joints": apart, "largest": apart, "points": points, "from_all_effects": whole,
            "unit": position_unit(robot),
        },
    }  # fmt: skip
    write_atomically(folder / "export.json", json.dumps(document, indent=2) + "\n")
    return document
