"""An MJCF or URDF file in place of a robot file, and the models of robots that have no symbolic step."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracles.arms import arm_xml
from oracles.urdfs import arm_urdf

import residual_mpc as rm
from residual_mpc.cli.main import main
from residual_mpc.export.simulator import corrected_simulator

GAIN = {"effect": "actuator_gain", "target": "j1", "parameter": "gain", "value": 0.8}


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    (tmp_path / "arm.xml").write_text(arm_xml())
    return tmp_path / "arm.xml"


@pytest.fixture
def gain(tmp_path: Path) -> Path:
    """A model.json of the arm with a weaker servo, beside its MJCF."""
    file = tmp_path / "given" / "model.json"
    file.parent.mkdir()
    document = {"schema": "residual-mpc/model/1", "robot": "arm", "values": [GAIN], "robot_file": "../arm.xml"}
    file.write_text(json.dumps(document))
    return file


def command(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    """Exit status, stdout and stderr."""
    capsys.readouterr()
    with pytest.raises(SystemExit) as end:
        main([*map(str, words)])
    said = capsys.readouterr()
    return int(end.value.code or 0), said.out, said.err


def driven(model: Path, robot: Path | None = None) -> np.ndarray:
    """(10, 2) rad: the joints of a model's simulator under constant commands."""
    simulator = corrected_simulator(model, None if robot is None else str(robot), period=0.02)
    simulator.reset({"position.j1": 0.0, "position.j2": 0.0})
    readings = [simulator.step([0.3, -0.2]) for _ in range(10)]
    return np.array([[float(r[f"position.{j}"][0]) for j in ("j1", "j2")] for r in readings])


def test_an_mjcf_is_a_robot_whose_file_it_is(arm: Path) -> None:
    robot = rm.load_robot(arm)
    assert (robot.name, robot.file.plant, robot.file.source) == ("arm", "mujoco", str(arm))
    assert robot.model.actuators == ("j1", "j2")


def test_commands_take_an_mjcf(arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "run.csv"
    rows = [f"{0.02 * k:.2f},0.3,-0.2,0.1,0.1" for k in range(50)]
    log.write_text("\n".join(["t,command.j1,command.j2,position.j1,position.j2", *rows]) + "\n")
    status, out, _ = command(capsys, "check", "--robot", arm, log, "--json")
    assert status == 0 and json.loads(out)["runs"][0]["commands"] == ["command.j1", "command.j2"]
    log.write_text(log.read_text().replace("command.j2", "command.elbow"))
    status, _, err = command(capsys, "check", "--robot", arm, log)
    assert status == 2 and "command.j2 is missing" in err
    assert "MJCF" in command(capsys, "gap", "--help")[1]


def test_a_urdf_alone_has_no_actuators(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(arm_urdf(("j1", "j2"), -3, 3))
    with pytest.raises(rm.BadInput) as fault:
        rm.load_robot(urdf)
    assert fault.value.where == str(urdf)
    assert "no actuator" in fault.value.what and "[actuator.elbow]" in fault.value.remedy
    assert command(capsys, "check", "--robot", urdf, tmp_path / "run.csv")[0] == 2
    for suffix in (".xml", ".urdf"):
        with pytest.raises(rm.BadInput, match="robot file not found"):
            rm.load_robot(tmp_path / f"nowhere{suffix}")


def test_a_model_that_does_not_compile_is_named(arm: Path) -> None:
    arm.write_text(arm.read_text().replace("</worldbody>", ""))
    with pytest.raises(rm.BadInput, match="does not compile") as fault:
        rm.load_robot(arm)
    assert fault.value.where == str(arm)


def test_a_saved_model_names_its_mjcf(arm: Path, gain: Path, tmp_path: Path) -> None:
    folder = rm.augment(rm.load_robot(arm), gain).save(tmp_path / "deep" / "out")
    saved = json.loads((folder / "model.json").read_text())
    assert saved["robot_file"] == "../../arm.xml" and saved["values"] == [{**GAIN, "unit": "1"}]
    weak = driven(folder / "model.json")
    np.testing.assert_array_equal(weak, driven(gain, arm))
    nominal = rm.augment(rm.load_robot(arm)).save(tmp_path / "nominal")
    assert np.abs(weak - driven(nominal / "model.json")).max() > 1e-3


def test_a_robot_without_a_step_is_exported_as_mjcf(
    arm: Path, gain: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, _ = command(capsys, "export", gain, "--to", "mjcf", "--out", tmp_path / "theirs", "--json")
    assert status == 0
    model = rm.augment(rm.load_robot(arm), gain)
    mine = model.export("mjcf", tmp_path / "mine")
    assert {**mine, "folder": ""} == {**json.loads(out), "folder": ""}
    text = (tmp_path / "mine" / "model.xml").read_text()
    assert text == (tmp_path / "theirs" / "model.xml").read_text()
    rm.augment(rm.load_robot(arm)).export("mjcf", tmp_path / "nominal")
    assert text != (tmp_path / "nominal" / "model.xml").read_text()


@pytest.mark.parametrize(
    "use",
    [
        lambda model: model.casadi(),
        lambda model: model.states,
        lambda model: model.step(np.zeros(4), np.zeros(2)),
        lambda model: model.mpc(),
        lambda model: model.export("c", "nowhere"),
    ],
)
def test_what_needs_a_step_says_that_there_is_none(arm: Path, gain: Path, use: Any) -> None:
    """Gravity compensation without an actuator has no place in the step."""
    arm.write_text(arm.read_text().replace("<body ", '<body gravcomp="1" ', 1))
    model = rm.augment(rm.load_robot(arm), gain)
    with pytest.raises(rm.BadInput, match="gravcomp"):
        use(model)
    assert model.commands == ("command.j1", "command.j2") and model.dt == 0.02
    assert "gravcomp" in str(model) and "actuator_gain" in model._repr_html_()
    assert model.to_frame().to_dict("records") == [{**GAIN, "unit": "1"}]


def test_a_model_of_another_robot_is_refused_at_once(arm: Path, gain: Path) -> None:
    with pytest.raises(rm.BadInput, match="must be of 'diff_drive', got one of 'arm'"):
        rm.augment(rm.load_robot("diff_drive"), gain)
    gain.write_text(gain.read_text().replace('"j1"', '"j9"'))
    with pytest.raises(rm.BadInput, match="arm lacks actuator_gain on j9"):
        rm.augment(rm.load_robot(arm), gain)
