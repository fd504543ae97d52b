"""What the Python interface refuses, and that it says what is wrong, where, and what to do."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracles.rover_log import ROBOT, rover_run, write_run

import residual_mpc as rm
from residual_mpc.api.given import check_apart
from residual_mpc.diagnosis.results.document import MODEL_SCHEMA

WIDE: Mapping[str, float] = {"track_width": 1.2}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """rover.toml and other.toml (a robot of another name), runs/ and degrees/ (headings in degrees)."""
    place = tmp_path_factory.mktemp("rover")
    (place / "rover.toml").write_text(ROBOT)
    (place / "other.toml").write_text(ROBOT.replace('"rover"', '"other"'))
    run = rover_run("r0", {"track_width": {"scale": 1.2}}, seconds=12.0)
    (place / "runs").mkdir()
    write_run(run, place / "runs")
    (place / "degrees").mkdir()
    turned = {**run.columns, "pose.theta": np.degrees(run.columns["pose.theta"])}
    write_run(replace(run, columns=turned), place / "degrees")
    return place


@pytest.fixture(scope="module")
def robot(folder: Path) -> rm.NominalRobot:
    return rm.load_robot(folder / "rover.toml")


@pytest.fixture(scope="module")
def other(folder: Path) -> rm.NominalRobot:
    return rm.load_robot(folder / "other.toml")


@pytest.fixture(scope="module")
def runs(folder: Path, robot: rm.NominalRobot) -> rm.Runs:
    return rm.read_runs(robot, folder / "runs")


@pytest.fixture(scope="module")
def network(robot: rm.NominalRobot, runs: rm.Runs) -> rm.LearnedModel:
    made = rm.learn(robot, runs, hidden=(10,), passes=3)
    assert made.document["kept"]
    return made


def model_file(folder: Path, robot: str, values: Mapping[str, float]) -> Path:
    """A model.json of a robot with effects of one parameter, `scale`."""
    rows = [{"effect": e, "target": None, "parameter": "scale", "value": v} for e, v in values.items()]
    path = folder / f"{robot}.json"
    path.write_text(json.dumps({"schema": MODEL_SCHEMA, "robot": robot, "values": rows}))
    return path


def test_runs_that_the_audit_forbids_are_read_and_refused_by_what_would_use_them(
    folder: Path, robot: rm.NominalRobot
) -> None:
    spoilt = rm.read_runs(robot, folder / "degrees")
    check = rm.check(robot, spoilt)
    assert not check.usable and [f.kind for f in check.errors] == ["degrees"]
    uses: list[Callable[[], object]] = [
        lambda: rm.measure_gap(robot, spoilt),
        lambda: rm.diagnose(robot, spoilt),
        lambda: rm.learn(robot, spoilt),
    ]
    for use in uses:
        with pytest.raises(rm.BadInput) as fault:
            use()
        assert fault.value.what == check.errors[0].message and fault.value.remedy == check.errors[0].remedy
        assert str(fault.value).count("pose.theta") == 2  # what it is, and how to mend it


def test_a_table_that_cannot_be_read_is_a_finding_beside_those_that_can(
    folder: Path, robot: rm.NominalRobot, tmp_path: Path
) -> None:
    """One fault does not hide the next: of two broken tables both are named, and the sound one is described."""
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "text.csv").write_text("t,command.left,command.right,pose.x\n0,1,1,0\n0.1,one,1,0\n0.2,1,1,0\n")
    check = rm.check(robot, [folder / "runs", tmp_path])
    assert not check.usable and [r["run"] for r in check.runs] == ["r0"]
    assert sorted(Path(str(f.run).split(":")[0]).name for f in check.errors) == ["empty.csv", "text.csv"]
    assert all(f.kind == "table" and f.message for f in check.errors)
    with pytest.raises(rm.BadInput, match=r"(empty|text)\.csv"):
        rm.read_runs(robot, [folder / "runs", tmp_path])


def test_a_position_without_a_heading_is_refused_in_the_run_that_lacks_it(
    folder: Path, robot: rm.NominalRobot, tmp_path: Path
) -> None:
    run = rover_run("gps", {}, 4.0)
    write_run(replace(run, columns={k: v for k, v in run.columns.items() if k != "pose.theta"}), tmp_path)
    both = [folder / "runs", tmp_path]
    with pytest.raises(
        rm.BadInput, match=r"run gps: pose\.x and pose\.y cannot .* without the heading .*Log the heading"
    ):
        rm.read_runs(robot, both)
    check = rm.check(robot, both)
    assert [f.run for f in check.errors] == ["gps"] and "pose.theta" in check.errors[0].message


@pytest.mark.parametrize("kept", ["velocity.left", "twist.theta"])
def test_speeds_need_no_heading(robot: rm.NominalRobot, tmp_path: Path, kept: str) -> None:
    run = rover_run("speeds", {}, 4.0)
    commands = {k: v for k, v in run.columns.items() if k.startswith("command")}
    write_run(replace(run, columns={**commands, kept: run.columns["command.left"]}), tmp_path)
    assert rm.read_runs(robot, tmp_path).names == ("speeds",) and rm.check(robot, tmp_path).usable


def test_paths_that_name_nothing_are_a_finding(robot: rm.NominalRobot, tmp_path: Path) -> None:
    check = rm.check(robot, tmp_path / "nothing")
    assert not check.usable and check.runs == () and "nothing" in str(check)


def test_a_case_that_there_is_not_is_refused_with_those_that_there_are(robot: rm.NominalRobot, runs: rm.Runs) -> None:
    with pytest.raises(rm.BadInput, match=r"unknown case 'x'.*sim-to-dyn, real-to-dyn, real-to-sim"):
        rm.learn(robot, runs, case="x")


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda robot, runs: rm.learn(robot, "runs"), "runs must be Runs, got str 'runs'"),
        (lambda robot, runs: rm.measure_gap(robot, None), "runs must be Runs, got NoneType"),
        (lambda robot, runs: rm.diagnose("robot.toml", runs), "robot must be a NominalRobot, got str 'robot.toml'"),
        (lambda robot, runs: rm.augment("robot.toml"), "robot must be a NominalRobot"),
        (lambda robot, runs: rm.excite("robot.toml"), "robot must be a NominalRobot"),
        (lambda robot, runs: rm.compare(robot, runs, [runs]), "runs must be Runs, got list"),
        (lambda robot, runs: rm.diagnose(robot, runs, only="nope"), "unknown effect 'nope'"),
        (
            lambda robot, runs: rm.diagnose(robot, runs, only=("armature", "payload")),
            "`only`: rover cannot have the effects 'armature', 'payload'. The effects that it can have are",
        ),
        (lambda robot, runs: rm.diagnose(robot, runs, horizon=-1.0), "positive number of seconds, got -1.0"),
        (lambda robot, runs: rm.measure_gap(robot, runs, horizon=float("nan")), "positive number of seconds, got nan"),
        (lambda robot, runs: rm.learn(robot, runs, step=-1.0), "positive number of seconds, got -1.0"),
        (lambda robot, runs: rm.learn(robot, runs, passes=0), "must be 1 or more, got 0"),
        (lambda robot, runs: rm.learn(robot, runs, hidden=(0,)), "must be 1 or more"),
        (lambda robot, runs: rm.excite(robot, seconds=-3.0), "positive number of seconds, got -3.0"),
        (lambda robot, runs: rm.excite(robot, seconds="20"), "positive number of seconds, got '20'"),
        (lambda robot, runs: rm.learn(robot, runs, step="x"), "positive number of seconds, got 'x'"),
        (lambda robot, runs: rm.excite(robot, limits={"left": (1, -1), "right": (-1, 1)}), "the lower one first"),
    ],
)
def test_what_is_no_robot_no_run_or_no_time_is_refused(
    robot: rm.NominalRobot, runs: rm.Runs, call: Callable[[object, object], object], said: str
) -> None:
    with pytest.raises(rm.BadInput) as fault:
        call(robot, runs)
    assert said in str(fault.value)


def test_a_step_takes_lists_and_refuses_batches_that_do_not_fit(robot: rm.NominalRobot) -> None:
    model = rm.augment(robot)
    x, u = model.x0.tolist(), [1.0, 2.0]
    np.testing.assert_array_equal(model.step(x, u), model.step(np.array(x), np.array(u)))
    assert model.step(np.zeros((3, len(x))), u).shape == (3, len(x))
    with pytest.raises(rm.BadInput, match="same leading axes"):
        model.step(np.zeros((3, len(x))), np.zeros((2, 2)))


def test_what_is_learned_does_not_overwrite_its_diagnosis(
    robot: rm.NominalRobot, runs: rm.Runs, tmp_path: Path
) -> None:
    made = model_file(tmp_path, "rover", {})
    for name, said in (("model.json", "would overwrite model.json"), ("diagnosis.json", "beside diagnosis.json")):
        file = made.rename(tmp_path / name)
        before = file.read_bytes()
        with pytest.raises(rm.BadInput, match=said):
            rm.learn(robot, runs, on=file, passes=1, hidden=(2,), out=tmp_path)
        assert file.read_bytes() == before and [p.name for p in tmp_path.iterdir()] == [name]
        made = file


def test_diagnoses_that_are_pooled_share_no_run() -> None:
    of = [{"name": "r0", "digest": "aa"}, {"name": "r1", "digest": "bb"}]
    check_apart([("a.json", {"runs": of}), ("b.json", {"runs": [{"name": "r2", "digest": "cc"}]}), ("c.json", {})])
    with pytest.raises(rm.BadInput, match=r"b\.json: run r9 was used in a\.json too"):
        check_apart([("a.json", {"runs": of}), ("b.json", {"runs": [{"name": "r9", "digest": "bb"}]})])


def test_a_target_that_there_is_not_is_refused_with_those_that_there_are(
    robot: rm.NominalRobot, tmp_path: Path
) -> None:
    with pytest.raises(rm.BadInput, match=r"unknown export format 'x'.*casadi, c, jax, onnx, mjcf"):
        rm.augment(robot).export("x", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_network_to_export_has_to_be_there(robot: rm.NominalRobot, tmp_path: Path) -> None:
    with pytest.raises(rm.BadInput, match="contains no network"):
        rm.augment(robot).export("onnx", tmp_path / "out")


@pytest.mark.parametrize("values", [{}, WIDE])
def test_effects_of_another_robot_are_refused(
    robot: rm.NominalRobot, tmp_path: Path, values: Mapping[str, float]
) -> None:
    with pytest.raises(rm.BadInput, match="must be of 'rover', got one of 'other'"):
        rm.augment(robot, model_file(tmp_path, "other", values))


def test_a_network_of_another_robot_is_refused(
    robot: rm.NominalRobot, other: rm.NominalRobot, network: rm.LearnedModel, tmp_path: Path
) -> None:
    """Alone, and beside a diagnosis of the right robot that names no effect."""
    none = model_file(tmp_path, "other", {})
    for diagnosis in (None, none):
        with pytest.raises(rm.BadInput, match="must be of 'other', got one of 'rover'"):
            rm.augment(other, diagnosis, network)
    own = model_file(tmp_path, "rover", {})
    assert rm.augment(robot, own, network).augmented.residual is not None


def test_a_network_is_not_dropped_without_a_word(
    robot: rm.NominalRobot, network: rm.LearnedModel, tmp_path: Path
) -> None:
    """Neither where a learned model is given as the diagnosis, nor where a diagnosis is given as the network."""
    assert rm.augment(robot, network).parameters == rm.augment(robot, None, network).parameters
    with pytest.raises(rm.BadInput, match="contains no network"):
        rm.augment(robot, None, model_file(tmp_path, "rover", WIDE))


def test_a_document_of_something_else_is_no_model(robot: rm.NominalRobot, tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    for text, said in (("{", "model.json"), ('{"schema": "mine/1"}', "mine/1")):
        path.write_text(text)
        with pytest.raises(rm.BadInput, match=said):
            rm.augment(robot, path)
    with pytest.raises(rm.BadInput, match=r"none\.json"):
        rm.augment(robot, tmp_path / "none.json")


def test_a_network_is_not_learned_in_place_of_another(
    robot: rm.NominalRobot, runs: rm.Runs, network: rm.LearnedModel
) -> None:
    with pytest.raises(rm.BadInput, match="already contains a learned network.*`warm_start`"):
        rm.learn(robot, runs, on=network, hidden=(2,), passes=1)


def test_a_form_that_the_robot_cannot_have_is_refused(robot: rm.NominalRobot, runs: rm.Runs, tmp_path: Path) -> None:
    with pytest.raises(rm.BadInput, match="'joint' corrects joint velocities, which 'rover' does not have.*body"):
        rm.learn(robot, runs, form="joint", hidden=(2,), passes=1, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("dt", [0.0, -1.0, float("nan"), "a"])
def test_a_time_step_is_a_positive_number(robot: rm.NominalRobot, dt: float) -> None:
    with pytest.raises(rm.BadInput, match="the time step must be a positive number of seconds"):
        rm.augment(robot, dt=dt)


def test_a_time_step_is_no_longer_than_those_of_controllers(robot: rm.NominalRobot) -> None:
    with pytest.raises(rm.BadInput, match="the time step must be at most 0.5 s, got 3 s"):
        rm.augment(robot, dt=3.0)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda m: m.augmented.start({"pose.xx": 1.0}), "unknown pose 'pose.xx'. Did you mean 'pose.x'\\?"),
        (lambda m: m.augmented.start({"pose.x": float("nan")}), "pose.x must be finite, got nan"),
        (lambda m: m.step(np.zeros(2), np.zeros(2)), "x must have 3 values in its last axis, got shape \\(2,\\)"),
        (lambda m: m.step(np.zeros((5, 3)), np.zeros((5, 3))), "u must have 2 values"),
        (lambda m: m.linearize(np.zeros(4), np.zeros(2)), "x must have 3 values"),
        (lambda m: m.mpc(horizon=1), "at least two steps, got 1"),
        (lambda m: m.mpc(horizon=20.5), "at least two steps, got 20.5"),
        (lambda m: m.lqr(np.full((5, 3), np.nan)), "finite values, got \\(5, 3\\) with 15 that are not"),
        (lambda m: m.lqr(np.zeros((5, 2))), "path must have 3 values"),
    ],
)
def test_arrays_and_horizons_that_make_no_sense_are_refused(
    robot: rm.NominalRobot, call: Callable[[rm.AugmentedModel], object], said: str
) -> None:
    with pytest.raises(rm.BadInput, match=said):
        call(rm.augment(robot, dt=0.05))
