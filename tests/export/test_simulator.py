"""The corrected simulator steps as the diagnosis replays; the MJCF moves as the replay does."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import DT, MIXED, SERVOS, arm_xml

from plants.mujoco_robot import MujocoRobot, build
from residual_mpc.cli.main import main
from residual_mpc.errors import BadInput
from residual_mpc.export.simulator import corrected_simulator
from residual_mpc.models.protocol import Drive
from residual_mpc.models.robot_file import read_robot_file
from residual_mpc.models.settings import Settings, assemble
from residual_mpc.models.simulating import Simulator

PERIOD, PERIODS = 0.02, 60
CONSTANT = {  # what MuJoCo itself can hold
    "command_delay": {"delay": 0.013},
    "actuator_gain": {"gain": 0.8},
    "saturation": {"limit": 2.5},
    "coulomb_friction": {"torque": 0.15},
    "viscous_friction": {"coefficient": 0.05},
    "armature": {"inertia": 0.004},
    "payload": {"mass": 0.3, "x": 0.06, "z": -0.03},
    "link_mass": {"mass": 0.1, "com": 0.02},
}
CHANGING = {
    "voltage_sag": {"rate": 0.15},
    "dead_zone": {"width": 0.04},
    "stribeck_friction": {"static": 0.2, "kinetic": 0.1, "velocity": 0.5},
    "load_dependent_friction": {"coefficient": 0.1},
    "actuator_lag": {"time_constant": 0.03},
}

GEARED = {"joint_compliance": {"stiffness": 80.0}, "backlash": {"gap": 0.02}, "link_length": {"offset": 0.05}}
BESIDE = {
    "rate_limit": {"rate": 0.8}, "torque_speed_limit": {"stall_torque": 3.0, "no_load_speed": 4.0},
    "gear_efficiency": {"forward": 0.8, "backward": 0.9}, "joint_spring": {"stiffness": 2.0, "rest": 0.3},
    "torque_offset": {"torque": 0.2}, "end_stop": {"position": 0.15}, "base_tilt": {"roll": 0.05, "pitch": -0.1},
    "torque_ripple": {"amplitude": 0.3, "cycles": 9.0, "phase": 0.5, "lead": 0.02},
    "gravity_compensation": {"share": 0.8},
}  # fmt: skip
SERVOS_ALONE = {"servo_integral": {"gain": 3.0}, "position_gain": {"gain": 1.3}}


def written(folder: Path, effects: dict[str, dict[str, float]], actuators: str = SERVOS) -> Path:
    """A model.json beside its robot file."""
    (folder / "arm.xml").write_text(arm_xml(actuators))
    (folder / "robot.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\npayload_site = "tool"\n')
    return model_json(folder, "arm", effects)


def model_json(folder: Path, robot: str, effects: dict[str, dict[str, float]]) -> Path:
    values = [
        {"effect": e, "target": None, "parameter": p, "value": v} for e, ps in effects.items() for p, v in ps.items()
    ]
    document = {"schema": "residual-mpc/model/1", "robot": robot, "values": values, "robot_file": "robot.toml"}
    (folder / "model.json").write_text(json.dumps(document))
    return folder / "model.json"


def arm(folder: Path) -> MujocoRobot:
    return build(read_robot_file(folder / "robot.toml"))


def settings_of(robot: MujocoRobot, folder: Path) -> Settings:
    from residual_mpc.models.model_file import model_in, read_written

    values = model_in(read_written(folder / "model.json"))[1]
    return assemble([values], {k.effect: robot.slots(k.effect) for k in values})


def commands(rows: int) -> np.ndarray:
    """(rows, PERIODS, 2)"""
    phase = np.random.default_rng(3).uniform(0, 6, (rows, 1, 2))
    return 0.6 * np.sin(2 * np.pi * 0.9 * PERIOD * np.arange(PERIODS)[None, :, None] + phase)


def played(simulator: Simulator, u: np.ndarray, start: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """channel -> (rows, PERIODS + 1)"""
    seen = [simulator.reset(start, u[:, 0])] + [simulator.step(u[:, k]) for k in range(u.shape[1])]
    return {c: np.stack([s[c] for s in seen], axis=1) for c in seen[0]}


@pytest.mark.parametrize("actuators", [SERVOS, MIXED], ids=["servos", "motor and speed"])
@pytest.mark.parametrize(
    "effects",
    [{}, CONSTANT, {**CONSTANT, **CHANGING}, {**CONSTANT, **GEARED}, {**CHANGING, **GEARED}, BESIDE],
    ids=["none", "constant", "changing", "geared", "geared and changing", "beside"],
)
def test_stepping_is_the_replay_of_the_diagnosis(tmp_path: Path, effects: dict, actuators: str) -> None:
    path = written(tmp_path, effects, actuators)
    robot, u, rows = arm(tmp_path), commands(3), 3
    start = {"position.j1": np.array([0.0, 0.2, -0.3]), "velocity.j2": np.array([0.5, 0.0, -1.0])}
    simulator = corrected_simulator(path, rows=rows, period=PERIOD)
    stepped = played(simulator, u, start)
    whole = {s: np.zeros(rows) for st in robot.states for s in (st.position, st.velocity)} | start
    drive = Drive(DT, 0, np.repeat(u, round(PERIOD / DT), axis=1), None, np.zeros(rows), None)
    each = settings_of(robot, tmp_path).take(np.zeros(rows, dtype=int))
    replayed = robot.replay(whole, drive, each, tuple(robot.channels))
    for channel, nodes in replayed.items():
        np.testing.assert_allclose(stepped[channel], nodes[:, :: round(PERIOD / DT)], atol=1e-9)
    assert np.ptp(stepped["position.j1"]) > 0.1


def test_a_future_that_was_tried_leaves_no_trace(tmp_path: Path) -> None:
    simulator = corrected_simulator(written(tmp_path, {**CONSTANT, **CHANGING}), rows=2)
    for _ in range(10):
        simulator.step([0.4, -0.2])
    here = simulator.save()
    expected = simulator.step([0.1, 0.1])
    simulator.restore(here)
    for _ in range(5):
        simulator.step([-1.0, 1.0])
    simulator.restore(here)
    again = simulator.step([0.1, 0.1])
    assert all(np.array_equal(expected[c], again[c]) for c in expected)


@pytest.mark.parametrize("beside", [{}, {**CHANGING, **GEARED}], ids=["alone", "geared and changing"])
def test_integral_parts_are_stepped_saved_and_begun_again(tmp_path: Path, beside: dict) -> None:
    effects = {**SERVOS_ALONE, **beside}
    test_stepping_is_the_replay_of_the_diagnosis(tmp_path, effects, SERVOS)
    path = written(tmp_path, effects)
    both, fresh = corrected_simulator(path, rows=2), corrected_simulator(path, rows=1)
    for _ in range(10):
        both.step([0.4, -0.2])
    here = both.save()
    expected = both.step([0.1, 0.1])
    both.restore(here)
    assert all(np.array_equal(y, expected[c]) for c, y in both.step([0.1, 0.1]).items())
    both.reset({"position.j1": 0.1}, [0.1, 0.0], where=np.array([False, True]))
    fresh.reset({"position.j1": 0.1}, [0.1, 0.0])
    for _ in range(10):
        mixed, new = both.step([0.2, 0.2]), fresh.step([0.2, 0.2])
    assert all(mixed[c][1] == pytest.approx(new[c][0], abs=1e-9) for c in mixed)


def test_one_row_begins_again_and_the_other_goes_on(tmp_path: Path) -> None:
    path = written(tmp_path, {**CONSTANT, **CHANGING, "sensor_delay": {"delay": 0.035}})
    both, first = corrected_simulator(path, rows=2), corrected_simulator(path, rows=2)
    for s in (both, first):
        for _ in range(20):
            s.step([0.5, 0.3])
    both.reset({"position.j1": 0.1}, [0.1, 0.0], where=np.array([False, True]))
    fresh = corrected_simulator(path, rows=1)
    fresh.reset({"position.j1": 0.1}, [0.1, 0.0])
    for _ in range(20):
        mixed, old, new = both.step([0.2, 0.2]), first.step([0.2, 0.2]), fresh.step([0.2, 0.2])
    for c in mixed:
        assert mixed[c][0] == pytest.approx(old[c][0], abs=1e-12)
        assert mixed[c][1] == pytest.approx(new[c][0], abs=1e-9)


def test_readings_arrive_late_and_offset(tmp_path: Path) -> None:
    late = {"sensor_delay": {"delay": 0.05}, "sensor_bias": {"bias": 0.01}}
    (tmp_path / "late").mkdir()
    u = commands(1)
    true = played(corrected_simulator(written(tmp_path, {})), u, {})
    seen = played(corrected_simulator(written(tmp_path / "late", late)), u, {})
    between = 0.5 * (true["position.j1"][0, 2:-3] + true["position.j1"][0, 3:-2])  # 2.5 periods before
    np.testing.assert_allclose(seen["position.j1"][0, 5:], between + 0.01, atol=1e-12)


@pytest.mark.parametrize("actuators", [SERVOS, MIXED], ids=["servos", "motor and speed"])
def test_an_mjcf_moves_as_the_replay(tmp_path: Path, actuators: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, CONSTANT, actuators)
    with pytest.raises(SystemExit) as end:
        main(["export", str(path), "--to", "mjcf", "--out", str(tmp_path / "out"), "--json"])
    assert not end.value.code
    document = json.loads(capsys.readouterr().out)
    assert document["largest_difference"]["largest"] < 1e-7 and not document["left_out"]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "model.xml"))
    assert model.actuator_delay == pytest.approx([0.013, 0.013])
    assert model.body("lower").mass[0] == pytest.approx(0.4 + 0.3 + 0.1)
    assert "simple=" not in (tmp_path / "out" / "model.xml").read_text()  # a mark for the batches of hypotheses alone


def test_an_mjcf_says_what_it_leaves_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, {**CONSTANT, **CHANGING})
    with pytest.raises(SystemExit):
        main(["export", str(path), "--to", "mjcf", "--out", str(tmp_path / "out")])
    said = capsys.readouterr()
    for effect in ("voltage_sag", "dead_zone", "load_dependent_friction"):
        assert f"left out: {effect}" in said.err
    assert "approximated: stribeck_friction" in said.err
    assert "largest difference" in said.out and "from the model with all diagnosed effects" in said.out
    apart = json.loads((tmp_path / "out" / "export.json").read_text())["largest_difference"]
    assert apart["largest"] < 0.02  # a lag is one filter of MuJoCo's, within half a step
    assert apart["from_all_effects"] > 2 * apart["largest"]


def test_an_mjcf_brakes_by_the_middle_of_a_falling_friction(tmp_path: Path) -> None:
    falling = {"static": 0.06, "kinetic": 0.02, "velocity": 0.1}
    path = written(tmp_path, {"stribeck_friction": falling, "coulomb_friction": {"torque": 0.01}})
    with pytest.raises(SystemExit):
        main(["export", str(path), "--to", "mjcf", "--out", str(tmp_path / "out")])
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "model.xml"))
    nominal = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    assert model.dof_frictionloss - nominal.dof_frictionloss == pytest.approx([0.05, 0.05])


def test_the_rover_is_stepped_by_its_equation(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(
        'name = "rover"\nplant = "diff_drive"\n[parameters]\nwheel_radius = 0.033\ntrack_width = 0.16\n'
    )
    simulator = corrected_simulator(model_json(tmp_path, "rover", {"track_width": {"scale": 2.0}}), None, 2, 0.05)
    simulator.reset({"pose.theta": np.array([0.0, 1.0])})
    for _ in range(20):
        seen = simulator.step([-1.0, 1.0])
    assert seen["pose.theta"] == pytest.approx([0.20625, 1.20625], abs=1e-6)  # 2 * 0.033 / 0.32 in 1 s


@pytest.mark.parametrize(
    ("period", "words"), [(0.0203, "multiple of the model's time step"), (0.02, "of 'leg', got one of 'arm'")]
)
def test_what_cannot_be_stepped_is_refused(tmp_path: Path, period: float, words: str) -> None:
    path = written(tmp_path, {})
    if "leg" in words:
        (tmp_path / "robot.toml").write_text((tmp_path / "robot.toml").read_text().replace('"arm"', '"leg"', 1))
    with pytest.raises(BadInput, match=words):
        corrected_simulator(path, period=period)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ({"effect": "actuator_gain", "target": "j9", "parameter": "gain"}, "arm lacks actuator_gain on j9"),
        ({"effect": "warp", "target": None, "parameter": "gain"}, "the effect 'warp' is not installed"),
        ({"effect": "actuator_gain", "target": "j1", "parameter": "loss"}, "lacks a parameter loss of actuator_gain"),
        ({"effect": "tune", "target": None, "parameter": "joint.j9.damping"}, "arm lacks joint.j9.damping"),
    ],
)
def test_what_the_robot_lacks_is_refused(
    tmp_path: Path, value: dict[str, str | None], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, {})
    path.write_text(json.dumps({**json.loads(path.read_text()), "values": [{**value, "value": 0.5}]}))
    with pytest.raises(BadInput, match=words):
        corrected_simulator(path)
    with pytest.raises(SystemExit) as end:
        main(["export", str(path), "--to", "mjcf", "--out", str(tmp_path / "out")])
    assert end.value.code == 2
    assert words in capsys.readouterr().err and not (tmp_path / "out").exists()
