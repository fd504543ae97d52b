"""The paper's nine experiments by name: what they print, that they repeat, and that the arm's first one converges."""

import json
from dataclasses import replace

import numpy as np
import pytest

from residual_mpc.cli.main import main
from residual_mpc.closed_loop.scenario import RunOptions, find_scenario, scenario_names
from residual_mpc.learning.stream.samples import Samples
from residual_mpc.learning.stream.updates import StreamSettings
from scenarios.experiments import arm, wheeled
from scenarios.experiments.scenario import LearningScenario
from scenarios.experiments.setting import Setting, learn

NINE = (*(f"wheeled_{x}" for x in "abcde"), *(f"arm_{x}" for x in "abcd"))
SILENT = lambda stage, done: None  # noqa: E731


def planted(form: str, seed: int, low_pass: float) -> Setting:
    """A lag that the inputs tell, instead of a simulator."""

    def part(stream: int, n: int) -> Samples:
        rng = np.random.default_rng((seed, stream))
        t = 0.05 * np.arange(n)
        z = np.stack([np.sin(t), np.cos(t), np.sin(2 * t)], axis=1)
        y = z + np.stack([0.3 * np.cos(t), -0.3 * np.sin(t), 0.2 * np.cos(2 * t)], axis=1)
        return Samples(t, z, z, y + 0.01 * rng.standard_normal(z.shape), 0.05)

    return Setting(part(0, 1200), part(1, 300), (("a", "b", "c"), ("x", "y", "z")), form, "toy")


def test_all_nine_are_there_by_name():
    assert set(NINE) <= set(scenario_names())
    for name in NINE:
        found = find_scenario(name)
        assert found.name == name and found.experiment.case in ("sim-to-dyn", "real-to-dyn", "real-to-sim")


def test_an_experiment_answers_with_the_learn_object(tmp_path):
    experiment = replace(arm.A.experiment, build=planted, settings=StreamSettings(replays=2))
    made = [LearningScenario(experiment).run(RunOptions(seeds=2, out=tmp_path), SILENT) for _ in range(2)]
    for r in made:
        del r["update_ms"]  # the one thing that a clock decides
    assert json.dumps(made[0]) == json.dumps(made[1])
    r = made[0]
    assert {"case", "updates", "parameters", "h2_norm", "converged_after"} <= set(r)
    assert r["parameters"] == 183 and r["h2_norm"]["held_out_after"] < 0.3 * r["h2_norm"]["held_out_before"]
    assert r["converged_after"] < 60.0 and r["seeds"] == 2
    assert 5_000 < (tmp_path / "arm_a.png").stat().st_size < 150_000


@pytest.mark.slow
def test_what_came_before_is_kept_only_where_the_papers_condition_holds():
    setting = planted("task", 0, 0.0)
    quick = StreamSettings(replays=1)
    before = learn(setting, quick, np.random.default_rng(0)).streamed.residual
    kept = learn(replace(setting, earlier=before), quick, np.random.default_rng(1))
    assert kept.condition.holds and kept.streamed.fixed == (before,)
    harmful = before.with_theta(-3.0 * before.theta)
    dropped = learn(replace(setting, earlier=harmful), quick, np.random.default_rng(1))
    assert not dropped.condition.holds and dropped.streamed.fixed == ()


@pytest.mark.parametrize("builder, form", [(wheeled.Wheeled("A"), "body"), (wheeled.Wheeled("A"), "paper")])
def test_samples_of_the_simulator_fit_the_model(builder, form, monkeypatch):
    """One sample of misalignment would leave twice what the motors' lag leaves."""
    monkeypatch.setattr(wheeled, "SECONDS", 12.0)
    monkeypatch.setattr(wheeled, "FRESH", 3.0)
    s = builder(form, 0, 0.0).samples
    off = np.nanstd(s.reference - s.model, axis=0)
    early = np.nanstd(s.reference[1:] - s.model[:-1], axis=0)
    assert off[2] < 0.15 and early[2] < off[2]  # the robot is behind its model, by less than a lag of 60 ms


@pytest.mark.slow
def test_the_first_arm_experiment_converges_in_two_minutes(capsys):
    with pytest.raises(SystemExit) as end:
        main(["run", "arm_a", "--seeds", "2", "--json"])
    assert not end.value.code
    r = json.loads(capsys.readouterr().out)
    assert r["converged_after"] < 120.0 and r["h2_norm"]["held_out_after"] < 0.3 * r["h2_norm"]["held_out_before"]
    assert r["parameters"] == 213
