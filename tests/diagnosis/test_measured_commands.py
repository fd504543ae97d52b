"""Where measured speeds drive the model nothing is commanded: no effect of commands and actuators is a candidate."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest
from oracles.arms import SERVOS, arm_xml, robot_of
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS
from oracles.rover_log import ROBOT, SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.cli.main import main
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.search.measured_commands import not_commanded
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Term

ROVER = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)
MEASURED = '[log]\n"command.left" = "velocity.left"\n"command.right" = "velocity.right"\n'
TRACK = {"track_width": {"scale": 1.25}}


def test_effects_of_commands_and_actuators_are_ruled_out() -> None:
    why = not_commanded(ROVER, ("left", "right"))
    assert set(why.values()) == {"the measured speeds drive the model: these runs have no commands"}
    assert {Term("command_delay", t) for t in (None, "left", "right")} <= set(why)
    assert {BY_NAME[t.effect].stage for t in why} == {"command", "actuator"}
    space = build_space(build_dataset([rover_run("one", TRACK)], [ROVER], SIGMA, 1.0), (), because=why)
    assert not {t.effect for t in space.candidates} & {t.effect for t in why}
    assert {"track_width", "wheel_radius", "sensor_delay"} <= {t.effect for t in space.candidates}
    assert space.ruled_out[Term("actuator_gain", "left")] == why[Term("actuator_gain", "left")]


def test_an_actuator_that_is_commanded_keeps_its_effects() -> None:
    why = not_commanded(ROVER, ("left",))
    assert Term("saturation", "left") in why and Term("saturation", None) in why  # alike is not possible any more
    assert Term("saturation", "right") not in why
    assert not not_commanded(ROVER, ())


def test_play_is_named_by_the_joint_that_the_actuator_drives(tmp_path: Path) -> None:
    arm = robot_of(tmp_path, arm_xml(SERVOS.replace('name="j1" joint', 'name="motor" joint')))
    why = not_commanded(arm, ("motor",))
    assert why[Term("backlash", "j1")] == "the measured positions drive the model: these runs have no commands"
    assert Term("backlash", "j2") not in why and Term("joint_compliance", "j1") not in why


@pytest.mark.slow
def test_a_diagnosis_says_why_they_are_not_testable(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "rover.toml").write_text(ROBOT + MEASURED)
    paths = []
    for number in (1, 2):
        run = rover_run(f"run{number}", TRACK, 12.0, seed=number)
        table = pd.DataFrame({"t": run.t} | {c: run.columns[c] for c in SIGMA})
        table["velocity.left"], table["velocity.right"] = run.columns["command.left"], run.columns["command.right"]
        paths.append(str(tmp_path / f"run{number}.csv"))
        table.to_csv(paths[-1], index=False)
    only = ["--only", "command_delay,actuator_gain,track_width"]
    with pytest.raises(SystemExit) as end:
        main(["diagnose", "--robot", str(tmp_path / "rover.toml"), *paths, "--out", str(tmp_path / "out"), *only])
    assert end.value.code == 0, capsys.readouterr().err
    made = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert {c["effect"] for c in made["explanation"]} == {"track_width"}
    not_testable = {(e["effect"], e["target"]): e["why"] for e in made["not_testable"]}
    assert "measured speeds drive the model" in not_testable["actuator_gain", "left"]
    assert "command_delay" not in {c["effect"] for c in made["candidates"]}
