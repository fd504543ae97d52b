"""Sealed cases out of runs of a robot: make, run with a stub in place of the comparison, score."""

import json
import shlex
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from recorded_robots import ARM, GEOMETRY, arm_log, rover_log

from residual_mpc.api.robot import load_robot
from residual_mpc.api.runs import read_runs
from residual_mpc.blind.recorded import sizing, visibility
from residual_mpc.blind.recorded.case_files import aliases_of
from residual_mpc.blind.recorded.half import Half
from residual_mpc.blind.recorded.halves import halves
from residual_mpc.blind.recorded.kinds.library import carried_by
from residual_mpc.blind.recorded.log import log_of, table_of
from residual_mpc.blind.recorded.make import RecordedSettings, changed_halves, make_recorded_suite
from residual_mpc.blind.recorded.recipe import draw, plan
from residual_mpc.blind.recorded.robot_text import settings_of
from residual_mpc.blind.recorded.sizing import Sized
from residual_mpc.blind.run import RunSettings, run_suite
from residual_mpc.blind.seal import read_sealed
from residual_mpc.blind.suite import FIRST_TEST_SEED
from residual_mpc.cli.blind import blind
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run

STUB = Path(__file__).with_name("stub_comparison.py")


def stub(verdict="same", *changes) -> str:
    document = {"verdict": verdict, "changes": list(changes), "confounded": []}
    return shlex.join([sys.executable, str(STUB), json.dumps(document), "--"])


@pytest.fixture(scope="module", autouse=True)
def coarser_sizes():
    """Sizes are drawn in the same way, from fewer windows and trials."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(visibility, "STEPS", 1_500)
        patch.setattr(sizing, "FACTORS", 4.0 ** np.arange(0, 2))
        patch.setattr(sizing, "FINE", 2.0)
        patch.setattr(sizing, "TRIES", 1)
        yield


@pytest.fixture(scope="module")
def arm_folder(tmp_path_factory):
    """An arm with two settings and eight runs, two motions of either in either."""
    folder = tmp_path_factory.mktemp("arm")
    coarse = ARM.replace('timestep="0.0005"', 'timestep="0.0025"')  # nothing here is compared with a simulation
    (folder / "soft.xml").write_text(coarse.replace('kp="30"', 'kp="15"'))
    (folder / "arm.xml").write_text(coarse)
    (folder / "robot.toml").write_text(
        'name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\npayload_site = "tip"\n[noise]\n"position.elbow" = 0.001\n'
        '[log]\n"position.shoulder" = "angle"\n[[variant]]\nruns = "soft_*"\nmodel = "soft.xml"\n'
    )
    for k, name in enumerate(f"{s}_{m}_{i}" for s in ("soft", "stiff") for m in ("slow", "fast") for i in (1, 2)):
        table = pd.DataFrame(table_of(arm_log()))[:400].rename(columns={"position.shoulder": "angle"})
        table["t"] += 100.0 * k
        table["command.m2"] += 0.01 * k
        table.to_parquet(folder / f"{name}.parquet", index=False)
    return folder


@pytest.fixture(scope="module")
def arm_robot(arm_folder):
    robot = load_robot(arm_folder / "robot.toml")
    return robot.file, read_runs(robot, str(arm_folder)).runs


@pytest.fixture(scope="module")
def made(arm_robot, tmp_path_factory):
    place = tmp_path_factory.mktemp("suite")
    suite = make_recorded_suite(*arm_robot, RecordedSettings(5, 40), place / "suite", place / "answers")
    assert len(suite.suite.cases) == 5 and not suite.failed
    return place


def answers(place):
    return {p.stem: read_sealed(p).answer for p in sorted((place / "answers").glob("case-*.json"))}


def test_a_case_reads_as_a_user_would_read_it_and_its_first_half_is_untouched(made, arm_robot):
    old = {run.name: run for run in arm_robot[1]}
    for name, answer in answers(made).items():
        case = made / "suite" / "cases" / name
        robot = load_robot(case / "robot.toml")
        assert robot.file.noise == {"position.elbow": 0.001}
        before, after = (read_runs(robot, str(case / half)) for half in ("before", "after"))
        assert len(before) == len(after) == 4
        seen = {run.name.split("_", 1)[1] for run in (*before, *after)}
        assert seen == set(old)
        for run in before:
            origin = old[run.name.split("_", 1)[1]]
            np.testing.assert_array_equal(run.t, origin.t)
            for column, values in origin.columns.items():
                np.testing.assert_array_equal(run.columns[column], values)
        stiffness = {run.name: m.nominal()["actuator.m1.kp"] for run, m in zip(before, before.models, strict=True)}
        assert all(kp == (15.0 if "soft" in name else 30.0) for name, kp in stiffness.items())
        if not answer.effects:
            for run in after:
                for column, values in old[run.name.split("_", 1)[1]].columns.items():
                    np.testing.assert_array_equal(run.columns[column], values)


def test_settings_and_motions_are_shared_out_evenly(made):
    for case in (made / "suite" / "cases").iterdir():
        names = [p.stem for p in (case / "after").iterdir()]
        for word in ("soft", "stiff", "slow", "fast"):
            assert sum(word in name for name in names) == 2


def test_cases_have_none_to_three_changes_of_different_families_with_their_doses(made):
    found = answers(made).values()
    assert sorted(len(a.effects) for a in found) == [0, 1, 1, 2, 3]
    for a in found:
        assert len({p.effect for p in a.effects}) == len(a.effects)
        assert len(a.notes["dose"]) == len(a.effects) and all(1 <= d <= 5 for d in a.notes["dose"])
        assert a.family == "arm" and all(np.isfinite(v) for p in a.effects for v in p.parameters.values())


def test_nothing_of_an_answer_travels_with_the_cases(made):
    for answer in answers(made).values():
        for path in (made / "suite").rglob("*"):
            if path.suffix in (".json", ".toml"):
                text = path.read_text()
                named = {p.effect for p in answer.effects} - {"payload"}  # payload_site is the robot's own key
                assert '"dose"' not in text and not any(name in text for name in named)


def test_all_cases_have_the_same_files_whatever_was_changed(made):
    cases = sorted((made / "suite" / "cases").iterdir())
    kinds = {tuple(sorted(p.name for p in case.iterdir())) for case in cases}
    assert len(kinds) == 1
    assert len({(case / "robot.toml").read_text() for case in cases}) == 1


@pytest.mark.slow
def test_making_resumes_and_refuses_another_suite_in_its_place(made, arm_robot, tmp_path):
    case = made / "suite" / "cases" / "case-0003"
    stamp = (made / "suite" / "cases" / "case-0002" / "robot.toml").stat().st_mtime_ns
    (case / "robot.toml").write_text("broken")
    again = make_recorded_suite(*arm_robot, RecordedSettings(5, 40), made / "suite", made / "answers")
    assert len(again.suite.cases) == 5
    assert "mujoco" in (case / "robot.toml").read_text()
    assert (made / "suite" / "cases" / "case-0002" / "robot.toml").stat().st_mtime_ns == stamp
    with pytest.raises(BadInput, match="contains a suite"):
        make_recorded_suite(*arm_robot, RecordedSettings(5, 41), made / "suite", made / "answers")


@pytest.mark.slow
def test_the_same_seed_makes_the_same_cases(made, arm_robot):
    for recipe in plan("arm", 5, 40, test=False)[:2]:
        *_, changes = changed_halves(*arm_robot, RecordedSettings(5, 40), recipe)
        sealed = [(p.effect, p.target, p.parameters) for p in answers(made)[recipe.name].effects]
        assert [(c.kind.effect, c.target, c.sizes) for c in changes] == sealed


def test_test_seeds_draw_other_combinations_and_other_strengths(arm_robot):
    robot, runs = arm_robot
    aliases = aliases_of(robot)
    half = Half("arm", robot.plant, tuple(log_of(r, r.name, aliases) for r in runs), settings_of(robot), "tip")
    carried = carried_by(half)
    strengths: dict[bool, list[float]] = {False: [], True: []}
    sets: dict[bool, set[frozenset[str]]] = {False: set(), True: set()}
    for test, first in ((False, 0), (True, FIRST_TEST_SEED)):

        def size(kind, target, strength, rng, test=test):
            strengths[test].append(strength)
            return Sized(kind.size(half, target, strength, rng), 5.0)

        for recipe in plan("arm", 60, first, test):
            changes = draw(carried, recipe, np.random.default_rng(recipe.seed), size)
            if len(changes) > 1:
                sets[test].add(frozenset(c.kind.effect for c in changes))
    assert sets[False] and sets[True] and not sets[False] & sets[True]
    for dose in range(5):
        low, high = ([s * 5 - dose for s in strengths[test] if dose <= s * 5 < dose + 1] for test in (False, True))
        assert low and high and max(low) < min(high)


def test_each_case_is_compared_and_scored(made):
    bias = {"effect": "sensor_bias", "target": "position.elbow", "probability": 0.95, "parameters": {}}
    summary = run_suite(made / "suite", made / "results", RunSettings(stub("changed", bias), jobs=2))
    assert (summary.diagnosed, summary.failed) == (5, 0)
    seen = json.loads((made / "results" / "case-0001" / "comparison.json").read_text())["seen"]
    assert [len(half) for half in seen] == [4, 4] and all(name.startswith("before_") for name in seen[0])
    run_suite(made / "suite", made / "same", RunSettings(stub("same"), jobs=2))
    done = CliRunner().invoke(blind, [
        "score", str(made / "suite"), "--answers", str(made / "answers"), "--results", f"bias={made / 'results'}",
        "--results", f"same={made / 'same'}", "--out", str(made / "page"), "--json",
    ])  # fmt: skip
    assert done.exit_code == 0, done.output
    score = json.loads(done.stdout)["score"]
    assert score["same_on_none"]["hits"] == 0 and score["highest_wrong_probability"] == 0.95
    (same,) = score["methods"]
    assert same["same_on_none"] == {**same["same_on_none"], "hits": 1, "count": 1}
    assert same["right"]["hits"] == 1 and same["wrong_stated_at_0.9"]["hits"] == 0
    page = (made / "page" / "blind.html").read_text()
    assert "Known changes in recorded runs" in page and "case-0001" in page


def test_a_comparison_that_fails_is_wrong(made):
    crash = shlex.join([sys.executable, str(STUB), "crash", "--"])
    summary = run_suite(made / "suite", made / "crashed", RunSettings(crash, jobs=2))
    assert summary.failed == 5
    done = CliRunner().invoke(blind, ["score", str(made / "suite"), "--answers", str(made / "answers"),
                                      "--results", str(made / "crashed")])  # fmt: skip
    assert done.exit_code == 0 and "0 of 5" in done.stdout


def test_one_long_run_is_cut_into_blocks_of_time():
    t = 0.05 * np.arange(2000)
    run = Run("drive", t, {"command.left": np.sin(t), "pose.x": t})
    before, after = halves([run], np.random.default_rng(0))
    assert len(before) == len(after) == 8
    together = sorted((*before, *after), key=lambda r: r.name)
    np.testing.assert_array_equal(np.concatenate([r.columns["pose.x"] for r in together]), t)
    assert all(r.t[0] == 0.0 for r in together)


def test_measured_wheel_speeds_still_drive_the_model(tmp_path):
    log = rover_log(1)
    table = pd.DataFrame(table_of(log)).drop(columns=["command.left", "command.right"])
    for i in range(4):
        table.to_parquet(tmp_path / f"run{i}.parquet", index=False)
    (tmp_path / "robot.toml").write_text(
        'name = "rover"\nplant = "diff_drive"\n'
        f"[parameters]\nwheel_radius = {GEOMETRY['wheel_radius']}\ntrack_width = {GEOMETRY['track_width']}\n"
        '[log]\n"command.left" = "velocity.left"\n"command.right" = "velocity.right"\n'
    )
    robot = load_robot(tmp_path / "robot.toml")
    runs = read_runs(robot, str(tmp_path)).runs
    made = make_recorded_suite(robot.file, runs, RecordedSettings(5), tmp_path / "suite", tmp_path / "answers")
    assert len(made.suite.cases) == 5
    for entry in made.suite.cases:
        again = read_runs(load_robot(made.suite.case(entry) / "robot.toml"), str(made.suite.case(entry) / "after"))
        assert again[0].served_as_command == {"velocity.left", "velocity.right"}


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--kind", "wheel_radius"], "states no wheel_radius"),
        (["--kind", "rust"], "unknown kind"),
        (["--family", "arm"], "without --family"),
        (["--cases", "0"], "must be >= 1"),
        (["--seed", "99999", "--cases", "3"], "all development or all test"),
    ],
)
def test_bad_input_is_said_before_anything_is_written(arm_folder, tmp_path, options, why):
    done = CliRunner().invoke(blind, [
        "make", "--from", str(arm_folder), "--robot", str(arm_folder / "robot.toml"), "--out", str(tmp_path / "s"),
        *options,
    ])  # fmt: skip
    assert isinstance(done.exception, BadInput) and why in str(done.exception)
    assert not (tmp_path / "s").exists()


def test_too_few_runs_to_split_and_runs_of_another_robot(arm_folder, tmp_path):
    def make(*runs):
        options = [x for run in runs for x in ("--from", str(run))]
        return CliRunner().invoke(blind, ["make", *options, "--robot", str(arm_folder / "robot.toml"),
                                          "--out", str(tmp_path / "s")])  # fmt: skip

    runs = sorted(arm_folder.glob("*.parquet"))
    assert "at least 4 runs" in str(make(*runs[:3]).exception)
    pd.DataFrame(table_of(rover_log(1))).to_parquet(tmp_path / "rover.parquet")
    assert isinstance(make(tmp_path / "rover.parquet").exception, BadInput)
    done = CliRunner().invoke(blind, ["make", "--robot", "diff_drive", "--out", str(tmp_path / "s")])
    assert "--from and --robot go together" in str(done.exception)
