"""What a compiled step costs, beside MuJoCo's."""

from __future__ import annotations

from pathlib import Path

from click.testing import CliRunner
from oracles.arms import SERVOS, arm_xml

from benchmarks.compiled import compiled


def test_a_line_for_each_robot(tmp_path: Path) -> None:
    files = []
    for name, integrator in (("arm", "implicitfast"), ("other", "implicit")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "robot.xml").write_text(arm_xml(SERVOS, integrator))
        files.append(tmp_path / name / "robot.toml")
        files[-1].write_text(f'name = "{name}"\nplant = "mujoco"\nmodel = "robot.xml"\n')
    result = CliRunner().invoke(compiled, [*map(str, files), "--rows", "16", "--steps", "50", "--turns", "3"])
    assert result.exit_code == 0, result.output
    arm, other = result.output.splitlines()[-2:]
    _, name, joints, by_mujoco, natively, *_ = (cell.strip() for cell in arm.split("|"))
    assert (name, joints) == ("arm", "2")
    assert 0.0 < float(natively) < float(by_mujoco)
    assert other.startswith("| other | no program")
