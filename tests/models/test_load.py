"""What the model of a user's own module must have."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import pytest

import residual_mpc as rm
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


@pytest.mark.parametrize("package", [False, True])
def test_a_module_beside_the_robot_file_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: bool
) -> None:
    """From any other folder; one of the same name beside another robot file is not taken for it."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.chdir(tmp_path)
    name = f"a_plant_of_{'packages' if package else 'ones'}_own"
    for folder, robot in (("one", "first"), ("two", "second")):
        module = tmp_path / folder / (f"{name}/__init__.py" if package else f"{name}.py")
        module.parent.mkdir(parents=True)
        module.write_text(
            "from plants.diff_drive import DiffDrive\ndef make(robot): return DiffDrive(robot.name, 0.03, 0.2)\n"
        )
        text = f'name = "{robot}"\nplant = "{name}:make"\n'
        (tmp_path / folder / "robot.toml").write_text(text)
    assert rm.load_robot(tmp_path / "one" / "robot.toml").name == "first"
    assert rm.load_robot(Path("one/robot.toml")).name == "first"
    with pytest.raises(BadInput, match=r"already loaded from .*one, and .*two has another of that name"):
        rm.load_robot(tmp_path / "two" / "robot.toml")
    (tmp_path / "one" / "absent.toml").write_text('name = "x"\nplant = "nowhere_to_be_found:make"\n')
    with pytest.raises(BadInput, match="module 'nowhere_to_be_found' cannot be imported"):
        rm.load_robot(tmp_path / "one" / "absent.toml")


def test_states_must_be_channels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("a_users_rover")
    monkeypatch.setattr(module, "make", lambda file: Rolling("rover", 0.03, 0.2), raising=False)
    monkeypatch.setitem(sys.modules, "a_users_rover", module)
    (tmp_path / "robot.toml").write_text('name = "rover"\nplant = "a_users_rover:make"\n')
    with pytest.raises(BadInput, match="states in velocity.x, which are not among its channels"):
        load_robot(read_robot_file(tmp_path / "robot.toml"))


@pytest.mark.parametrize(
    ("pattern", "said"),
    [
        ("wheel_radus", "did you mean 'wheel_radius'?"),
        ("whel_*", "known here: wheel_radius, track_width"),
        ("wheel_*", ""),
    ],
)
def test_a_tunable_pattern_has_to_match_something(tmp_path: Path, pattern: str, said: str) -> None:
    (tmp_path / "robot.toml").write_text(f'name = "rover"\nplant = "diff_drive"\ntunable = ["{pattern}"]\n')
    if not said:
        assert rm.load_robot(tmp_path / "robot.toml").name == "rover"
        return
    with pytest.raises(BadInput) as refused:
        rm.load_robot(tmp_path / "robot.toml")
    message = str(refused.value).lower()
    assert "which matches no parameter of the model. " + said in message
