"""A user's own arm in closed loop: what was diagnosed pays, in joint and in tool space, on any plant."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from oracles.arms import arm_xml
from oracles.rover_log import ROBOT
from oracles.urdfs import arm_urdf

import residual_mpc as rm
from controllers.usual import usual_settings
from residual_mpc.cli.main import cli
from residual_mpc.closed_loop.scenario import RunOptions
from residual_mpc.errors import BadInput
from residual_mpc.models.drawing import NoRenderer
from residual_mpc.models.settings import Knob
from scenarios.own import OwnScenario, Waypoints, drive, read_reference
from scenarios.own.demands import _late, _out_of_reach
from scenarios.own.reference import named_motion

SERVOS = """
<position name="j1" joint="j1" kp="120" kv="8" ctrlrange="-2 2"/>
<position name="j2" joint="j2" kp="60" kv="3" ctrlrange="-1.5 1.5"/>
"""
TRUTH = {Knob("command_delay", None, "delay"): 0.03, Knob("payload", None, "mass"): 0.3}
SHORT = np.linspace(0.0, 1.5, 31)


def robot_file(folder: Path, values: Mapping[Knob, float] = TRUTH) -> rm.NominalRobot:
    """arm.toml and model.json with these effects."""
    (folder / "arm.xml").write_text(arm_xml(SERVOS))
    (folder / "arm.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\npayload_site = "tool"\n')
    rows = [{"effect": k.effect, "target": k.target, "parameter": k.parameter, "value": v} for k, v in values.items()]
    written = {"schema": "residual-mpc/model/1", "robot": "arm", "robot_file": "arm.toml", "values": rows}
    (folder / "model.json").write_text(json.dumps(written))
    return rm.load_robot(folder / "arm.toml")


def swing(names: tuple[str, ...] = ("position.j1", "position.j2")) -> Waypoints:
    slow = np.sin(np.pi * SHORT) * np.minimum(SHORT, 1.0)
    return Waypoints(names, SHORT, np.stack([0.4 * slow, -0.3 * slow], axis=-1))


def errors(result: Mapping[str, Any]) -> dict[str, float]:
    return {name: c["tracking_rmse"] for name, c in result["controllers"].items()}


@pytest.fixture(autouse=True)
def interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Episodes this short take less time than a C compiler."""
    for module in ("controllers.rollout", "residual_mpc.closed_loop.estimator"):
        monkeypatch.setattr(f"{module}.compiler", lambda: None)


def no_renderer() -> str:
    raise NoRenderer("a skeleton is drawn sooner")


@pytest.mark.parametrize("controller", ["mpc", pytest.param("lqr", marks=pytest.mark.slow)])
def test_the_diagnosed_effects_pay_in_joint_space(
    tmp_path: Path, controller: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("plants.mujoco_robot.drawing.renderer._backend", no_renderer)
    robot = robot_file(tmp_path)
    model = rm.augment(robot, tmp_path / "model.json", dt=0.02)
    result = OwnScenario(robot, model, swing(), withheld=TRUTH).run(RunOptions(controller, 1, 0, tmp_path / "out"))
    found = errors(result)
    assert found["augmented"] < 0.3 * found["nominal"]
    assert found["augmented"] == pytest.approx(found["oracle"], rel=1e-6)
    assert result["recovered"]["augmented"]["value"] == pytest.approx(1.0)
    assert result["unit"] == "rad" and result["tracked"] == ["position.j1", "position.j2"]
    assert {c["failures"] for c in result["controllers"].values()} == {0}
    assert {p.name for p in (tmp_path / "out").iterdir()} == set(result["files"])
    assert {"tracking.png", "drive.gif", "drive.html", "result.json", "nominal_0.csv"} <= set(result["files"])


def test_the_tool_follows_a_path(tmp_path: Path) -> None:
    """Two joints reach a surface; the path lies in it, since joints drew it."""
    robot = robot_file(tmp_path)
    model = rm.augment(robot, tmp_path / "model.json", dt=0.02)
    at = OwnScenario(robot, model, "circle", withheld=TRUTH)._models()["nominal"]
    joints = np.array([0.3, 0.7]) + swing().values
    drawn = np.stack([at.outputs(at.start(dict(zip(at.stepped.poses, q, strict=True)))) for q in joints.tolist()])
    motion = Waypoints(("tool.x", "tool.y", "tool.z"), SHORT, drawn)
    result = OwnScenario(robot, model, motion, withheld=TRUTH).run(RunOptions(seeds=1))
    found = errors(result)
    assert result["unit"] == "m" and found["augmented"] < 0.5 * found["nominal"] and found["augmented"] < 0.004


class Sluggish:
    """A plant of the user's own: each joint follows its command with a lag of 0.1 s."""

    actuators = ("j1", "j2")
    channels = ("position.j1", "position.j2")

    def __init__(self, robot: Any, period: float) -> None:
        self.period = period

    def start(self, rng: np.random.Generator, at: Mapping[str, float]) -> Sluggish:
        self.q = np.array([at[c] for c in self.channels])
        return self

    def measure(self) -> dict[str, float]:
        return dict(zip(self.channels, self.q.tolist(), strict=True))

    truth = measure

    def step(self, command: np.ndarray, dt: float) -> None:
        self.q = self.q + (1.0 - np.exp(-dt / 0.1)) * (command - self.q)

    def close(self) -> None:
        pass


def test_a_plant_of_ones_own_is_driven(tmp_path: Path) -> None:
    robot = robot_file(tmp_path)
    model = rm.augment(robot, tmp_path / "model.json", dt=0.02)
    result = OwnScenario(robot, model, swing(), plant=Sluggish).run(RunOptions(seeds=1))
    assert result["plant"] == "own plant" and set(result["controllers"]) == {"nominal", "augmented"}
    assert errors(result)["nominal"] < 0.05


def test_a_plant_of_ones_own_gets_no_noise_that_nobody_asked_for(tmp_path: Path) -> None:
    robot = robot_file(tmp_path)
    model = rm.augment(robot, tmp_path / "model.json", dt=0.02)
    for noise in ({}, {"position.j1": 0.01}):
        scenario = OwnScenario(robot, model, swing(), plant=Sluggish, noise=noise, controllers=("nominal",))
        driven = scenario.drive(RunOptions(seeds=1), lambda stage, done: None)
        (episode,) = driven.comparison.episodes["nominal"]
        off = episode.measured["position.j1"] - episode.truth[:, 0]
        assert np.std(off) == pytest.approx(noise.get("position.j1", 0.0), rel=0.3)


class Broken(Sluggish):
    """`fault` says what is wrong with it."""

    fault = ""

    def start(self, rng: np.random.Generator, at: Mapping[str, float]) -> Any:
        return None if self.fault == "no plant" else super().start(rng, at)

    def measure(self) -> Any:
        found = super().measure()
        if self.fault == "too few":
            found.pop("position.j2")
        return [0.0] if self.fault == "a list" else {**found, "position.j1": "up"} if self.fault == "a word" else found

    def step(self, command: np.ndarray, dt: float) -> None:
        if self.fault == "raises":
            raise RuntimeError("the bus is off")
        super().step(command, dt)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("no plant", "`start` must return a plant with measure, truth, step, close, got NoneType without measure"),
        ("too few", "the reading of `measure` has no 'position.j2'"),
        ("a list", "`measure` must return a dict, got list"),
        ("a word", "`measure` gives no number for position.j1: 'up'"),
        ("raises", r"`step\(\)` of the plant raised RuntimeError: the bus is off .*test_own.py, line"),
    ],
)
def test_what_is_wrong_with_a_plant_is_said(tmp_path: Path, monkeypatch: Any, fault: str, said: str) -> None:
    robot = robot_file(tmp_path)
    model = rm.augment(robot, tmp_path / "model.json", dt=0.02)
    plant = type("Faulty", (Broken,), {"fault": fault})
    if fault != "raises":  # before the controllers are built, which takes long
        monkeypatch.setattr(OwnScenario, "_stack", lambda *_: pytest.fail("built a controller"))
    with pytest.raises(BadInput, match=said):
        OwnScenario(robot, model, swing(), plant=plant).run(RunOptions(seeds=1))


def test_a_plant_with_other_actuators_is_refused(tmp_path: Path) -> None:
    robot = robot_file(tmp_path)
    model = rm.augment(robot, tmp_path / "model.json", dt=0.02)
    plant = type("Three", (Sluggish,), {"actuators": ("j1", "j2", "j3")})
    with pytest.raises(BadInput, match="must have the actuators j1, j2 in this order, got j1, j2, j3"):
        OwnScenario(robot, model, swing(), plant=plant).run(RunOptions(seeds=1))


@pytest.mark.parametrize(("dt", "horizon"), [(0.02, 22), pytest.param(0.002, 35, marks=pytest.mark.slow)])
def test_controllers_look_beyond_the_dead_time(tmp_path: Path, dt: float, horizon: int) -> None:
    """However short the samples are: within the dead time no command acts."""
    robot = robot_file(tmp_path)
    motion = Waypoints(swing().names, SHORT[:11], swing().values[:11])
    model = rm.augment(robot, tmp_path / "model.json", dt=dt)
    driven = OwnScenario(robot, model, motion, withheld=TRUTH).drive(RunOptions(seeds=1), lambda stage, done: None)
    assert driven.settings.horizon == horizon
    rmse = {name: fs[0].tracking_rmse for name, fs in driven.comparison.figures.items()}
    assert rmse["augmented"] < 0.5 * rmse["nominal"]


def test_a_factory_that_fails_is_named(tmp_path: Path) -> None:
    robot = robot_file(tmp_path)
    model = rm.augment(robot, tmp_path / "model.json", dt=0.02)
    with pytest.raises(BadInput, match="the factory of the plant raised TypeError"):
        OwnScenario(robot, model, swing(), plant=lambda: None).run(RunOptions(seeds=1))  # type: ignore[arg-type,misc]


class Base:
    """A differential drive of the user's own, with wheels of 0.1 m, 0.5 m apart; it is seen `every` samples."""

    actuators = ("left", "right")
    channels = ("pose.x", "pose.y", "pose.theta")
    every = 1

    def __init__(self, robot: Any, period: float) -> None:
        pass

    def start(self, rng: np.random.Generator, at: Mapping[str, float]) -> Base:
        self.pose, self.count = np.array([at[c] for c in self.channels]), 0
        return self

    def measure(self) -> dict[str, float]:
        self.count += 1
        return self.truth() if self.count % self.every == 0 else dict.fromkeys(self.channels, np.nan)

    def truth(self) -> dict[str, float]:
        return dict(zip(self.channels, self.pose.tolist(), strict=True))

    def step(self, command: np.ndarray, dt: float) -> None:
        v, w = 0.05 * (command[0] + command[1]), 0.1 * (command[1] - command[0]) / 0.5
        self.pose += dt * np.array(
            [v * np.cos(self.pose[2] + 0.5 * w * dt), v * np.sin(self.pose[2] + 0.5 * w * dt), w]
        )

    def close(self) -> None:
        pass


def circle(wrapped: bool) -> Waypoints:
    """A circle of 2 m at 3 m/s, which needs wheels of 37 rad/s, begun at rest."""
    t = np.linspace(0.0, 6.0, 121)
    angle = 1.5 * np.where(t < 1.0, 0.5 * t * t, t - 0.5)
    heading = np.angle(np.exp(1j * angle)) if wrapped else angle
    return Waypoints(Base.channels, t, np.stack([2.0 * np.sin(angle), 2.0 - 2.0 * np.cos(angle), heading], axis=-1))


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> rm.NominalRobot:
    folder = tmp_path_factory.mktemp("base")
    (folder / "base.toml").write_text(
        'name = "base"\nplant = "diff_drive"\n[parameters]\nwheel_radius = 0.1\ntrack_width = 0.5\n'
    )
    return rm.load_robot(folder / "base.toml")


@pytest.mark.parametrize("wrapped", [True, False])
def test_a_robot_that_drives_fast_may_command_what_its_reference_needs(base: rm.NominalRobot, wrapped: bool) -> None:
    """Twelve rad/s, a small rover's limit, would leave it metres behind; a heading that jumps by a turn is the same."""
    scenario = OwnScenario(base, rm.augment(base, dt=0.05), circle(wrapped), plant=Base, controllers=("augmented",))
    found = scenario.run(RunOptions(seeds=1))["controllers"]["augmented"]
    assert found["tracking_rmse"] < 0.05 and found["heading_rmse"] < 0.05


@pytest.mark.parametrize(("wider", "smaller"), [(2.6, 1.0), (1.0, 0.5)])
def test_a_corrected_model_may_command_what_its_own_numbers_need(
    base: rm.NominalRobot, tmp_path: Path, wider: float, smaller: float
) -> None:
    """A robot that turns or drives far less than the nominal one has to be told far more."""

    class Weak(Base):
        def step(self, command: np.ndarray, dt: float) -> None:
            forward, half = 0.5 * (command[0] + command[1]), 0.5 * (command[1] - command[0]) / wider
            super().step(smaller * np.array([forward - half, forward + half]), dt)

    rows = [
        {"effect": "track_width", "target": None, "parameter": "scale", "value": wider},
        {"effect": "wheel_radius", "target": None, "parameter": "scale", "value": smaller},
    ]
    (tmp_path / "model.json").write_text(
        json.dumps({"schema": "residual-mpc/model/1", "robot": "base", "values": rows})
    )
    model = rm.augment(base, tmp_path / "model.json", dt=0.05)
    spin = Waypoints(Base.channels, np.linspace(0.0, 4.0, 81), np.zeros((81, 3)))
    spin.values[:, 2] = 0.8 * np.linspace(0.0, 4.0, 81) ** 2
    for reference in (spin, circle(False)):
        scenario = OwnScenario(base, model, reference, plant=Weak, controllers=("augmented",))
        found = scenario.run(RunOptions(seeds=1))["controllers"]["augmented"]
        assert found["tracking_rmse"] < 0.05 and found["heading_rmse"] < 0.1


@pytest.mark.parametrize(
    ("t", "headings"), [([0.0, 10.0], [0.0, 6.28]), ([0.0, 1.0, 2.0], [0.0, 3.5, 7.0]), ([0.0, 1.0], [0, 4])]
)
def test_headings_that_count_turns_stay_as_they_are(t: list[float], headings: list[float]) -> None:
    still = np.zeros(len(t))
    path = Waypoints(Base.channels, np.array(t), np.stack([still, still, headings], axis=-1))
    np.testing.assert_array_equal(path.ordered(Base.channels, "here").values[:, 2], headings)


def test_a_plant_whose_truth_has_gaps_is_scored_by_its_last_one(base: rm.NominalRobot) -> None:
    class Seldom(Base):
        def truth(self) -> dict[str, float]:
            self.calls = getattr(self, "calls", 0) + 1
            return super().truth() if self.calls % 3 == 1 else dict.fromkeys(self.channels, np.nan)

        def measure(self) -> dict[str, float]:
            return super().truth()

    scenario = OwnScenario(base, rm.augment(base, dt=0.05), circle(False), plant=Seldom, controllers=("nominal",))
    result = scenario.run(RunOptions(seeds=1))
    assert result["controllers"]["nominal"]["tracking_rmse"] < 0.3
    json.dumps(result, allow_nan=False)


def test_the_first_failure_of_a_plant_is_the_one_that_is_said(tmp_path: Path) -> None:
    robot = robot_file(tmp_path)
    for fault, said in (("raises", "the bus is off"), ("too few", "has no 'position.j2'")):

        class Dead(Broken):
            def close(self) -> None:
                raise OSError("cannot close")

        Dead.fault = fault
        with pytest.raises(BadInput, match=said):
            OwnScenario(robot, rm.augment(robot, dt=0.02), swing(), plant=Dead).run(RunOptions(seeds=1))


def test_readings_that_are_mostly_missing_are_said_to_be(base: rm.NominalRobot) -> None:
    for every, notes in ((1, []), (4, [f"{c} is missing in 75% of the samples" for c in Base.channels])):
        plant = type("Seen", (Base,), {"every": every})
        scenario = OwnScenario(base, rm.augment(base, dt=0.05), circle(False), plant=plant, controllers=("nominal",))
        assert scenario.run(RunOptions(seeds=1))["notes"] == notes


def test_a_path_that_the_tool_cannot_follow_is_said_to_be(tmp_path: Path) -> None:
    """The named circle goes 60 mm to both sides of an arm whose joints move it on a surface."""
    robot = robot_file(tmp_path)
    model = rm.augment(robot, tmp_path / "model.json", dt=0.02)
    nominal = OwnScenario(robot, model, "circle", withheld=TRUTH)._models()["nominal"]
    (note,) = _out_of_reach(nominal, named_motion("circle", nominal))
    assert note.startswith("the tool comes no closer than ") and note.endswith(" mm to parts of the reference")
    begin = nominal.outputs(nominal.start())
    still = Waypoints(("tool.x", "tool.y", "tool.z"), SHORT, np.repeat(begin[None], len(SHORT), axis=0))
    assert _out_of_reach(nominal, still) == []


RANGE = "the reference leaves the range of position.j2 (-1.57 to 1.57) by 0.17"
HELD = "augmented: a command is at its limit in 100% of the samples"
DEAD = "the horizon (20 ms) ends before the model's dead time (30 ms): use a longer sample time or a longer horizon"
NEAR = DEAD.replace("20 ms) ends before", "40 ms) reaches only 10 ms beyond")


@pytest.mark.parametrize(("times", "said"), [(10.0, [RANGE, HELD]), (1.0, [])])
def test_what_the_robot_cannot_do_on_a_reference_is_said(tmp_path: Path, times: float, said: list[str]) -> None:
    robot = robot_file(tmp_path)
    motion = Waypoints(swing().names, SHORT[:5], times * swing().values[10:15])
    model = rm.augment(robot, tmp_path / "model.json", dt=0.02)
    scenario = OwnScenario(robot, model, motion, plant=Sluggish, controllers=("augmented",))
    notes = scenario.run(RunOptions(seeds=1))["notes"]
    assert len(notes) == len(said) and all(note.startswith(s) for note, s in zip(notes, said, strict=True)), notes


@pytest.mark.parametrize(
    ("dt", "horizon", "said"), [(0.02, 20, []), (0.002, 35, []), (0.001, 20, [DEAD]), (0.001, 40, [NEAR])]
)
def test_a_horizon_that_ends_soon_after_the_dead_time_is_said_to(
    tmp_path: Path, dt: float, horizon: int, said: list[str]
) -> None:
    model = rm.augment(robot_file(tmp_path), tmp_path / "model.json", dt=dt).augmented
    assert _late(model, replace(usual_settings(model), horizon=horizon)) == said


@pytest.mark.parametrize(
    ("t", "values", "said"),
    [
        ([0.0, 1.0], [[0.0], [np.nan]], "not finite"),
        ([0.0, 0.0], [[0.0], [1.0]], "do not increase"),
        ([0.0, 1.0], [[0.0, 1.0], [1.0, 2.0]], "a column for each of position.j1, got \\(2, 2\\)"),
        ([0.0], [[0.0]], "two rows"),
    ],
)
def test_waypoints_that_make_no_sense_are_refused(t: list[float], values: list[list[float]], said: str) -> None:
    with pytest.raises(BadInput, match=said):
        Waypoints(("position.j1",), np.array(t), np.array(values))


@pytest.mark.parametrize("wrong", [{"controller": "pid"}, {"seeds": 0}, {"budget": 0.0}])
def test_options_that_make_no_sense_are_refused(wrong: dict[str, Any]) -> None:
    said = {
        "controller": "unknown controller 'pid'",
        "seeds": "at least one seed, got 0",
        "budget": "be positive, got 0",
    }
    with pytest.raises(BadInput, match=said[next(iter(wrong))]):
        RunOptions(**wrong)


def test_settings_that_would_be_ignored_are_refused(tmp_path: Path) -> None:
    robot = robot_file(tmp_path)
    model = rm.augment(robot, tmp_path / "model.json", dt=0.02)
    with pytest.raises(BadInput, match="withheld effects cannot be put into a plant"):
        OwnScenario(robot, model, swing(), withheld=TRUTH, plant=Sluggish)
    with pytest.raises(BadInput, match="unknown controller 'nominl'"):
        OwnScenario(robot, model, swing(), controllers=("nominl",))


def test_the_command_reads_a_table_and_what_was_withheld(tmp_path: Path) -> None:
    robot = robot_file(tmp_path)
    rows = "\n".join(f"{t},{a},{b}" for t, (a, b) in zip(SHORT, swing().values, strict=True))
    (tmp_path / "path.csv").write_text("t,position.j1,position.j2\n" + rows)
    model = rm.augment(robot, tmp_path / "model.json", dt=0.02)
    where = tmp_path / "path.csv", tmp_path / "model.json"
    result = drive(robot, model, str(where[0]), None, where[1], RunOptions(seeds=1), lambda stage, done: None)
    assert result["scenario"] == "path" and result["recovered"]["augmented"]["value"] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--robot", "arm.toml"], "--model is missing"),
        (["spin", "--robot", "arm.toml", "--model", "model.json"], "the scenario 'spin' cannot be combined"),
        (["spin", "--dt", "0.1"], "--dt is for a robot of your own"),
        (["--robot", "arm.toml", "--model", "model.json", "--plant", "nowhere"], "'nowhere' is not a factory"),
    ],
)
def test_options_that_do_not_fit_are_refused(tmp_path: Path, monkeypatch: Any, words: list[str], said: str) -> None:
    robot_file(tmp_path)
    monkeypatch.chdir(tmp_path)
    found = CliRunner().invoke(cli, ["run", *words])
    assert isinstance(found.exception, BadInput) and said in str(found.exception), found.exception


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t,position.j1\n0,1\n0,2\n", "must increase, but does not at line 3"),
        ("t,position.j1\n0,1\n1,\n", "line 3"),
        ("a,b\n0,1\n", "column t"),
        ("", "cannot be read"),
    ],
)
def test_a_table_that_is_no_reference_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "path.csv").write_text(text)
    with pytest.raises(BadInput, match=said):
        read_reference(tmp_path / "path.csv")


@pytest.mark.parametrize(
    ("reference", "said"),
    [
        ("sinus", "neither a file nor a named motion"),
        (Waypoints(("position.j1",), SHORT, np.zeros((31, 1))), "no column 'position.j2'"),
        (Waypoints(("tool.x", "tool.y", "tool.z"), SHORT, np.full((31, 3), 9.0)), "comes no closer"),
    ],
)
def test_a_reference_that_does_not_fit_is_refused(tmp_path: Path, reference: Any, said: str) -> None:
    robot = robot_file(tmp_path)
    model = rm.augment(robot, tmp_path / "model.json", dt=0.02)
    with pytest.raises(BadInput, match=said):
        OwnScenario(robot, model, reference).run(RunOptions(seeds=1))


def test_a_held_joint_needs_no_reference(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(arm_urdf(("j1", "j2"), -2.5, 2.0))
    drives = "".join(f'[actuator.{j}]\nkind = "position"\nkp = 60\nkv = 3\n' for j in ("j1", "j2"))
    text = f'name = "arm"\nplant = "mujoco"\nmodel = "arm.urdf"\nheld = ["j2"]\n{drives}'
    (tmp_path / "arm.toml").write_text(text)
    robot = rm.load_robot(tmp_path / "arm.toml")
    model = rm.augment(robot, dt=0.02)
    nominal = OwnScenario(robot, model)._models()["nominal"]
    assert nominal.stepped.tracked == ("position.j1", "position.j2")
    alone = Waypoints(("position.j1",), SHORT, 0.1 * np.sin(np.pi * SHORT)[:, None])
    result = OwnScenario(robot, model, alone, controllers=("nominal",)).run(RunOptions(seeds=1))
    assert result["controllers"]["nominal"]["tracking_rmse"] < 0.1
    for name in ("sines", "postures"):
        assert (np.ptp(named_motion(name, nominal).values, axis=0) > 0.01).tolist() == [True, False]


def test_a_robot_that_drives_needs_a_path(tmp_path: Path) -> None:
    (tmp_path / "rover.toml").write_text(ROBOT)
    robot = rm.load_robot(tmp_path / "rover.toml")
    with pytest.raises(BadInput, match="is for an arm, and 'rover' drives.*pose.theta"):
        OwnScenario(robot, rm.augment(robot, dt=0.05), "sines", plant=Sluggish).run(RunOptions(seeds=1))
