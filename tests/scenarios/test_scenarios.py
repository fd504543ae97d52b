"""The scenarios by name, the list, and (slow) one whole story from a bad drive to a good one."""

from __future__ import annotations

import json
from importlib.metadata import entry_points

import numpy as np
import pytest

from plants.simulator import Plant
from residual_mpc.cli.main import main
from residual_mpc.closed_loop.scenario import GROUP, RunOptions, find_scenario
from scenarios.robots import DelayedCommands

NAMES = ("back_and_forth", "constant_yaw_rate", "figure_eight", "route", "spin")


def call(capsys, *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    out = capsys.readouterr()
    return int(end.value.code or 0), out.out, out.err


def test_the_list(capsys):
    if not list(entry_points(group=GROUP)):
        pytest.fail("no entry point in the group: install the project anew (`pip install -e .`)")
    code, out, _ = call(capsys, "run", "--json")
    assert code == 0
    named = {s["name"]: s["summary"] for s in json.loads(out)["scenarios"]}
    assert set(named) >= set(NAMES) and all(named.values())
    assert call(capsys, "run")[1].count("\n") == len(named)


def test_an_unknown_scenario_is_refused_with_a_hint(capsys):
    code, out, err = call(capsys, "run", "figur_eight", "--json")
    assert code == 2 and not out and "figure_eight" in err


@pytest.mark.parametrize("name", NAMES)
def test_every_path_can_be_driven_and_every_effect_is_known(name):
    from residual_mpc.effects.library import BY_NAME

    s = find_scenario(name).task
    path = s.reference().path(s.dt * np.arange(round(s.seconds / s.dt) + 21))
    rate = np.abs(np.diff(path, axis=0)) / s.dt
    assert rate[:, 0].max() < 0.5 and rate[:, 2].max() < 3.0, "a TurtleBot's speeds"
    assert rate[0].max() < 0.1, "it starts from rest"
    for effect, _, parameter in s.withheld:
        BY_NAME[effect].parameter(parameter)


def test_no_clock_decides_in_a_scenario_unless_asked_for():
    from scenarios.closed_loop.controllers import _stack

    s = find_scenario("figure_eight").task
    for options, budget in ((RunOptions(), np.inf), (RunOptions(budget=0.03), 0.03)):
        assert _stack(s, s.setup(), {}, None, options).controller.settings.budget == budget


class Recorder:
    """What the inner plant is told, and when."""

    def __init__(self):
        self.time, self.heard = 0.0, []

    def step(self, command, dt):
        self.heard.append((self.time, float(command[0])))
        self.time += dt


def test_a_late_robot_hears_each_command_exactly_so_much_later():
    inner = Recorder()

    class Fake:
        name, actuators, channels = "fake", ("a",), ()

        def start(self, rng, at) -> Plant:
            return inner  # type: ignore[return-value]

    plant = DelayedCommands(Fake(), 0.13).start(np.random.default_rng(0), {})  # type: ignore[arg-type]
    for k in range(1, 6):
        plant.step(np.array([float(k)]), 0.05)
    first = {value: t for t, value in reversed(inner.heard)}
    for k in (1, 2):
        assert first[float(k)] == pytest.approx(0.05 * (k - 1) + 0.13)
    assert first[0.0] == 0.0 and inner.time == pytest.approx(0.25)


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["mpc", "lqr"])
def test_the_whole_story(controller, tmp_path):
    s = find_scenario("figure_eight")
    result = s.run(RunOptions(controller, 2, 0, tmp_path), lambda stage, done: None)
    c = result["controllers"]
    assert result["diagnosis"]["verdict"] == "effects"
    assert c["effects"]["tracking_rmse"] < 0.4 * c["nominal"]["tracking_rmse"]
    assert c["effects"]["h2_norm"] < 0.2 * c["nominal"]["h2_norm"]
    assert result["recovered"]["effects"]["value"] >= 0.8
    assert ("online" in c) == (controller == "mpc")
    assert {"tracking.png", "drive.html", "motion.webp", "nominal_0.csv"} <= {p.name for p in tmp_path.iterdir()}
