"""The column that a remedy suggests for a missing one is not one that serves something else."""

from __future__ import annotations

import numpy as np
import pytest

from plants.diff_drive import DiffDrive
from residual_mpc.errors import BadInput
from residual_mpc.logs.readers.layout import check_log
from residual_mpc.logs.run import Run
from residual_mpc.models.facts import check_columns
from residual_mpc.models.robot_file import RobotFile

ROVER = DiffDrive("rover", 0.03, 0.2)
T = 0.1 * np.arange(5)


@pytest.mark.parametrize(
    ("extra", "said"),
    [
        ((), "no other column is unassigned"),
        (("current",), "known here: current"),
        (("command_left",), "did you mean 'command_left'"),
    ],
)
def test_the_other_wheels_command_is_no_substitute(extra: tuple[str, ...], said: str) -> None:
    columns = {"command.right": T, "pose.x": T, "pose.y": T, "pose.theta": T}
    with pytest.raises(BadInput, match=r"command\.left is missing") as refused:
        check_columns([Run("r", T, columns, extra=extra)], [ROVER])
    assert said in refused.value.remedy and "command.right" not in refused.value.remedy


def test_a_column_that_the_log_maps_already_is_no_substitute() -> None:
    robot = RobotFile("rover", "diff_drive", log={"pose.y": "mocap_y", "pose.theta": "mocap_yaw"})
    with pytest.raises(BadInput, match="mocap_yaw") as refused:
        check_log(robot, [["t", "mocap_x", "mocap_y"]])
    assert "mocap_y'" not in refused.value.remedy
