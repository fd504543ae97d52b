"""Learning from logs: a planted fault is learned, a killed call resumes to the same weights, bad input ends with one
message."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from oracles.rover_log import ROBOT, rover_run, write_run

import residual_mpc as rm
from plants.diff_drive import DiffDrive
from residual_mpc.cli.main import main
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.predict import replay
from residual_mpc.learning.batch import checkpoint
from residual_mpc.learning.batch.training import Task, TrainingResult, train
from residual_mpc.learning.batch.window_linearisation import linearise_window
from residual_mpc.learning.batch.window_updates import LearnSettings, build_training_problem
from residual_mpc.learning.forms.registry import form_named
from residual_mpc.learning.network.residual import to_json
from residual_mpc.models.settings import Settings

FAULTS = {"actuator_lag": {"time_constant": 0.15}, "track_width": {"scale": 1.15}}
ROVER = DiffDrive("rover", 0.033, 0.16)
QUICK, QUICKER = LearnSettings(passes=5), LearnSettings(passes=2)
CHANNELS = ("pose.x", "pose.y", "pose.theta")


def task(runs, **more) -> Task:
    return Task(tuple(runs), (ROVER,) * len(runs), {}, "real-to-dyn", **more)


@pytest.fixture(scope="module")
def runs():
    return [rover_run(f"r{k}", FAULTS, 14.0, seed=k) for k in range(6)]


@pytest.fixture(scope="module")
def learned(runs) -> TrainingResult:
    return train(task(runs), QUICK, np.random.default_rng(0))


def test_a_planted_lag_and_track_are_learned(learned):
    assert learned.learned.net.size == 203
    assert learned.after.total < 0.5 * learned.before.total
    assert learned.held_out_h2[1] < 0.5 * learned.held_out_h2[0]
    assert not learned.left_alone and not learned.worse_held_out


def test_a_call_that_was_stopped_goes_on_to_the_same_weights(runs, tmp_path):
    class Stopped(Exception):
        pass

    def stop_at(number):
        def report(update, of, seconds, h2):
            if update == number:
                raise Stopped

        return report

    for number in (7, 35, 70):  # before the first checkpoint, in the first pass, in the second
        with pytest.raises(Stopped):
            train(task(runs), QUICKER, np.random.default_rng(0), stop_at(number), tmp_path)
    begun = []
    made = train(task(runs), QUICKER, np.random.default_rng(0), lambda u, of, s, h: begun.append(u), tmp_path)
    assert begun[0] > 45
    whole = train(task(runs), QUICKER, np.random.default_rng(0))
    assert np.array_equal(made.learned.theta, whole.learned.theta) and made.h2 == whole.h2


def test_a_checkpoint_of_another_call_or_none_is_not_taken_up(runs, tmp_path):
    path = tmp_path / "checkpoint.npz"
    assert checkpoint.resume(path, "call") is None
    path.write_bytes(b"PK\x03\x04 no checkpoint")
    assert checkpoint.resume(path, "call") is None


def test_spikes_holes_and_a_still_channel_are_borne(runs):
    rng = np.random.default_rng(0)
    spoilt = []
    for run in runs:
        columns = {c: v.copy() for c, v in run.columns.items()}
        for c in ("pose.x", "pose.y", "pose.theta"):
            columns[c][rng.random(len(run.t)) < 0.02] += 0.5
            columns[c][rng.random(len(run.t)) < 0.1] = np.nan
        columns["pose.x"][100:130] = np.nan
        columns["twist.x"] = np.zeros(len(run.t))
        spoilt.append(type(run)(run.name, run.t, columns))
    made = train(task(spoilt, leaves_out_outliers=True), QUICKER, np.random.default_rng(0))
    assert np.isfinite(made.learned.theta).all() and made.after.total < made.before.total


def test_a_perfect_model_is_left_alone_or_hardly_touched():
    runs = [rover_run(f"r{k}", {}, 12.0, seed=k) for k in range(4)]
    made = train(task(runs), QUICKER, np.random.default_rng(0))
    assert made.after.total <= made.before.total


def test_a_cost_stands_on_both_sides_of_its_channel(runs):
    """Reference and prediction are multiplied by it, C_v is not: so an error counts for more."""
    data = build_dataset(runs[:1], [ROVER], {}, 1.0)
    seen, everything = np.ones(data.count, dtype=bool), np.ones(len(data.channels), dtype=bool)
    made = []
    for costs in ((), (("pose.theta", 3.0),)):
        settings, rng = LearnSettings(costs=costs), np.random.default_rng(0)
        problem, blank = build_training_problem(
            data, form_named("body"), 0.05, settings, Settings(1), (), seen, everything, rng
        )
        made.append(linearise_window(problem, blank, 2, 0.1 * blank.output_scale, np.zeros(len(data.channels))))
    plain, costly = made
    cost = np.where(plain.samples[1] == data.channels.index("pose.theta"), 3.0, 1.0)
    theta = np.random.default_rng(1).standard_normal(plain.window.net.size)
    np.testing.assert_allclose(costly.measured.reference, cost * plain.measured.reference)
    np.testing.assert_allclose(costly.window.predict(theta), cost * plain.window.predict(theta))
    np.testing.assert_allclose(costly.measured.noise, plain.measured.noise)


def test_a_window_of_many_outputs_is_replayed_in_parts(runs, monkeypatch):
    """An arm of seven joints has more pushes in a window than fit into memory at once."""
    data = build_dataset(runs[:1], [ROVER], {}, 1.0)
    seen, everything = np.ones(data.count, dtype=bool), np.ones(len(data.channels), dtype=bool)
    made = []
    for room in (replay.ROOM, 12_000):
        monkeypatch.setattr(replay, "ROOM", room)
        problem, blank = build_training_problem(
            data, form_named("body"), 0.05, LearnSettings(), Settings(1), (), seen, everything, np.random.default_rng(0)
        )
        made.append(linearise_window(problem, blank, 2, 0.1 * blank.output_scale, np.zeros(len(data.channels))))
    theta = np.random.default_rng(1).standard_normal(made[0].window.net.size)
    np.testing.assert_allclose(made[1].window.predict(theta), made[0].window.predict(theta))


def test_jumps_of_the_localisation_are_not_learned_from(runs):
    """The gap has them, what is learned does not."""
    rng = np.random.default_rng(0)
    spoilt = []
    for run in runs:
        columns = {c: v.copy() for c, v in run.columns.items()}
        hit = rng.choice(len(run.t) - 8, 4, replace=False) + 4
        for c in CHANNELS:
            columns[c][hit] += 0.5
        spoilt.append(type(run)(run.name, run.t, columns))
    made = train(task(spoilt), LearnSettings(passes=2), np.random.default_rng(0))
    before, after = made.without_spikes
    assert after < 0.6 * before < made.before.total
    assert made.after.total > after


def test_the_papers_condition_sets_a_harmful_residual_to_zero(runs, learned):
    helpful = train(task(runs, earlier=learned.learned), LearnSettings(passes=1), np.random.default_rng(1))
    assert helpful.condition.holds and helpful.whole.net.hidden == (20, 20)
    assert helpful.after.total < 1.2 * learned.after.total
    wrong = learned.learned.with_theta(-3.0 * learned.learned.theta)
    harmful = train(task(runs, earlier=wrong), LearnSettings(passes=1), np.random.default_rng(1))
    assert not harmful.condition.holds and harmful.whole.net.hidden == (10, 10)


def call(*arguments: object) -> int:
    with pytest.raises(SystemExit) as end:
        main([str(a) for a in arguments])
    return int(end.value.code or 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, runs) -> Path:
    there = tmp_path_factory.mktemp("rover")
    (there / "rover.toml").write_text(ROBOT)
    for run in runs:
        write_run(run, there)
    return there


def test_learn_writes_a_model_that_gap_accepts(folder, capsys):
    files, out = sorted(folder.glob("r?.csv")), folder / "out"
    robot = folder / "rover.toml"
    assert call("learn", "--robot", robot, *files, "--out", out, "--passes", 1, "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert {"case", "updates", "parameters", "h2_norm", "converged_after", "update_ms"} <= set(printed)
    assert printed == json.loads((out / "learn.json").read_text()) and not (out / "checkpoint.npz").exists()
    model = out / "model.json"
    assert call("gap", "--robot", robot, *files, "--model", model, "--held-out-of", model, "--json") == 0
    gap = json.loads(capsys.readouterr().out)
    assert gap["model"] == pytest.approx(printed["gap"]["after"], rel=1e-9)
    assert gap["nominal"] == pytest.approx(printed["gap"]["before"], rel=1e-9)


def test_bad_input_is_one_message(folder, learned, capsys):
    robot, files = folder / "rover.toml", sorted(folder.glob("r?.csv"))
    other = folder / "other.toml"
    other.write_text(ROBOT.replace('"rover"', '"else"'))
    model = folder / "model.json"
    content = {"schema": "residual-mpc/model/1", "robot": "rover", "values": [], "residual": to_json(learned.learned)}
    model.write_text(json.dumps(content))
    bare = folder / "bare.json"
    bare.write_text(json.dumps({**content, "residual": None}))
    joint = folder / "joint.json"
    joint.write_text(json.dumps({**content, "residual": {**content["residual"], "inputs": list("abcde")}}))
    short = write_run(rover_run("short", FAULTS, 1.6, seed=1), folder)
    out = folder / "never"
    for arguments, said in (
        (("gap", "--robot", other, *files, "--model", model), "got one of rover"),
        (("learn", "--robot", robot, short, "--out", out), "are needed for training, got 1"),
        (("learn", "--robot", robot, *files, "--out", out, "--warm-start", bare), "no learned residual"),
        (("learn", "--robot", robot, *files, "--out", out, "--warm-start", joint), "a, b, c"),
        (("learn", "--robot", robot, *files, "--out", out, "--on", folder / "none.json"), "none.json"),
        (("learn", "--robot", robot, *files, "--out", out, "--warm-start", model, "--case", "sim-to-dyn"), "without"),
        (("learn", "--robot", robot, *files, "--out", out, "--hidden", "ten"), "ten"),
        (("learn", "--robot", robot, *files, "--out", out, "--weights", "pose.theta"), "pose.theta"),
        (("learn", "--robot", robot, *files, "--out", out, "--weights", "pose.z=2"), "pose.x"),
        (("learn", "--robot", robot, *files, "--out", out, "--weights", "pose.x=-1"), "> 0"),
    ):
        assert call(*arguments) == 2
        streams = capsys.readouterr()
        assert said in streams.err and "Traceback" not in streams.err and not streams.out
        assert not (out / "model.json").exists()


@pytest.mark.slow
def test_killed_at_any_moment_it_resumes_to_the_same_weights(folder):
    """kill -9, five times, at moments that fall where they may."""
    files = [str(f) for f in sorted(folder.glob("r?.csv"))]

    def command(out: Path) -> list[str]:
        program = "from residual_mpc.cli.main import main; main()"
        return [sys.executable, "-c", program, "learn", "--robot", str(folder / "rover.toml"), *files, "--out",
                str(out), "--passes", "2"]  # fmt: skip

    whole, cut = folder / "whole", folder / "cut"
    subprocess.run(command(whole), check=True, capture_output=True)
    rng = np.random.default_rng(int(time.time()))
    for _ in range(5):
        running = subprocess.Popen(command(cut), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(float(rng.uniform(2.0, 6.0)))
        os.kill(running.pid, signal.SIGKILL)
        running.wait()
    subprocess.run(command(cut), check=True, capture_output=True)
    a, b = (json.loads((d / "model.json").read_text())["residual"]["theta"] for d in (whole, cut))
    assert a == b and sorted(p.name for p in cut.iterdir()) == ["learn.json", "model.json", "report.html"]


def test_a_model_at_the_noise_floor_has_nothing_to_learn(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(ROBOT)
    for seed in range(3):
        write_run(rover_run(f"r{seed}", {}, 10.0, seed=seed), tmp_path)
    robot = rm.load_robot(tmp_path / "robot.toml")
    runs = rm.read_runs(robot, [tmp_path / f"r{seed}.csv" for seed in range(3)])
    empty = {"schema": "residual-mpc/model/1", "robot": "rover", "values": []}
    (tmp_path / "model.json").write_text(json.dumps(empty))
    found = rm.learn(robot, runs, passes=1, on=tmp_path / "model.json")
    floor = found.gap["noise_floor"]
    assert 0.5 * floor < found.gap["before"] < 2.0 * floor
    assert found.gap["at_noise_floor"]["before"] and found.gap["after"] <= found.gap["before"]
    found.document["kept"], found.document["chosen_pass"] = False, 0
    said = "\n".join(found.lines())
    assert "nothing that was learned was kept" in said and "nothing is left to learn" in said and "passes" not in said
    assert "learn on top of it" not in said  # it is learned on a diagnosis, which names nothing
    found.document["gap"] |= {"before": 10.0 * floor, "after": 10.0 * floor, "at_noise_floor": {"before": False}}
    assert "try more passes" in "\n".join(found.lines())
