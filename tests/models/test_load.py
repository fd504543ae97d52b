"""What the model of a user's own module must have."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import pytest

from plants.diff_drive import DiffDrive
from residual_mpc.errors import BadInput
from residual_mpc.models.load import load_robot
from residual_mpc.models.protocol import State
from residual_mpc.models.robot_file import read_robot_file


@dataclass(frozen=True)
class Rolling(DiffDrive):
    """A rover with a state whose velocity it does not predict."""

    @property
    def states(self) -> tuple[State, ...]:
        return (State("pose.x", "velocity.x"),)


def test_states_must_be_channels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("a_users_rover")
    monkeypatch.setattr(module, "make", lambda file: Rolling("rover", 0.03, 0.2), raising=False)
    monkeypatch.setitem(sys.modules, "a_users_rover", module)
    (tmp_path / "robot.toml").write_text('name = "rover"\nplant = "a_users_rover:make"\n')
    with pytest.raises(BadInput, match="states in velocity.x, which are not among its channels"):
        load_robot(read_robot_file(tmp_path / "robot.toml"))
