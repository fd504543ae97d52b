"""What a user chooses: the effects, the runs kept back, what may be retuned, the seed; and figures anyone can check."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS
from oracles.rover_log import ROBOT, rover_run, write_run

from plants.diff_drive import DiffDrive
from residual_mpc.cli.main import main
from residual_mpc.diagnosis.data.hold_out import KeptBack
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.results.document import to_document
from residual_mpc.logs.run import Run

ROVER = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)
TRACK = {"track_width": {"scale": 1.25}}
LATE = {"command_delay": {"delay": 0.09}}


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    return [rover_run("one", TRACK, 16.0, seed=1), rover_run("two", TRACK, 12.0, seed=2)]


def document(runs: list[Run], tunable: tuple[str, ...] = (), seed: int = 0, **options: Any) -> dict[str, Any]:
    robots = [ROVER] * len(runs)
    made = diagnose(runs, robots, {}, tunable, Options(**options), np.random.default_rng(seed))
    return to_document(made.diagnosis)


def named(d: dict[str, Any]) -> set[str]:
    return {c["effect"] for c in d["explanation"]}


def test_the_same_seed_gives_the_same_bytes(runs: list[Run]) -> None:
    few = ("command_delay", "actuator_lag", "actuator_gain", "lateral_slip", "track_width")
    first, second = (json.dumps(document(runs, seed=7, only=few)) for _ in range(2))
    assert first == second


@pytest.mark.slow
def test_another_seed_gives_the_same_answer(runs: list[Run]) -> None:
    first, second = document(runs, seed=1), document(runs, seed=2)
    assert (first["verdict"], named(first)) == (second["verdict"], named(second))
    assert first["gap"]["before"] == second["gap"]["before"]


def test_only_what_is_asked_for_is_looked_at(runs: list[Run]) -> None:
    d = document(runs, only=("command_delay", "track_width"))
    assert named(d) == {"track_width"}
    assert {c["effect"] for c in d["candidates"] + d["not_testable"]} <= {"command_delay", "track_width"}


def test_what_is_left_out_is_not_named(runs: list[Run]) -> None:
    few = ("command_delay", "actuator_lag", "turn_gain", "lateral_slip", "track_width")
    d = document(runs, without=("track_width",), only=few)
    everywhere = json.dumps([d["explanation"], d["candidates"], d["confounded"], d["not_testable"], d["model"]])
    assert "track_width" not in everywhere
    assert d["gap"]["after"] > document(runs, only=few)["gap"]["after"]


def test_the_runs_kept_back_are_the_ones_named(runs: list[Run]) -> None:
    d = document(runs, held_out=(KeptBack("two"),))
    assert d["held_out"] == ["two"] and d["gap"]["windows"] == 12 and named(d) == {"track_width"}


@pytest.mark.slow
def test_what_may_be_retuned_is_no_diagnosis(runs: list[Run]) -> None:
    d = document(runs, tunable=("track_*",))
    assert d["verdict"] == "no_gap" and d["explanation"] == []
    assert d["gap"]["nominal"] > 5 * d["gap"]["before"]  # retuned alone, the model is right


@pytest.mark.slow
def test_retuning_beside_an_effect_is_told() -> None:
    faults = {**TRACK, **LATE}
    late = [rover_run("one", faults, 20.0, seed=1), rover_run("two", faults, 16.0, seed=2)]
    d = document(late, tunable=("track_width",), only=("command_delay", "actuator_lag", "actuator_gain"))
    assert "command_delay" in named(d)
    (moved,) = d["moved"]
    assert moved["parameter"] == "track_width" and moved["to"] == pytest.approx(1.25 * TRACK_WIDTH, rel=0.02)
    assert d["gap"]["nominal"] > d["gap"]["before"] > d["gap"]["after"]


def call(capsys: pytest.CaptureFixture[str], *arguments: str) -> Any:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    out = capsys.readouterr()
    assert end.value.code == 0, out.err
    return json.loads(out.out)


@pytest.mark.parametrize("kept", [pytest.param("blocks", marks=pytest.mark.slow), "runs"])
def test_anyone_can_check_the_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], runs: list[Run], kept: str
) -> None:
    """`gap --model --held-out-of` on the files that a diagnosis wrote, by either of its files."""
    (tmp_path / "rover.toml").write_text(ROBOT)
    paths = [str(write_run(r, tmp_path)) for r in runs]
    robot, out = ["--robot", str(tmp_path / "rover.toml")], tmp_path / "out"
    chosen = ["--only", "track_width", "--only", "command_delay"] + (["--held-out", "two"] if kept == "runs" else [])
    made = call(capsys, "diagnose", *robot, *paths, "--out", str(out), *chosen, "--json")
    assert made["verdict"] == "effects"
    assert json.loads((out / "diagnosis.json").read_text()) == made
    assert json.loads((out / "model.json").read_text()) == made["model"]
    assert (out / "report.html").stat().st_size > 10_000
    for model in ("diagnosis.json", "model.json"):
        held = ["--held-out-of", str(out / "diagnosis.json"), "--model", str(out / model)]
        gap = call(capsys, "gap", *robot, *paths, *held, "--json")
        assert gap["nominal"] == pytest.approx(made["gap"]["nominal"], rel=1e-9)
        assert gap["model"] == pytest.approx(made["gap"]["after"], rel=1e-9)
        assert gap["windows"] == made["gap"]["windows"]
        assert gap["noise_floor"] == pytest.approx(made["gap"]["noise_floor"], rel=0.15)  # other draws
