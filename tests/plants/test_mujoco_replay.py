"""The batched replay is mujoco.mj_step row by row; an effect is the model compiled with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import (
    CHANNELS,
    FILTERED,
    MIXED,
    SERVOS,
    arm_xml,
    assert_rows_are_themselves,
    literal,
    random_drive,
    random_start,
    robot_of,
    settings_of,
    wheel_xml,
)

from plants.mujoco_robot.simulation import replay as module
from residual_mpc.effects.command import delay_sequence
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings

ROWS, STEPS = 3, 150
OUTPUTS = ("output.j1", "output.j2")


def agree(came: dict[str, np.ndarray], row: int, q: np.ndarray, v: np.ndarray, atol: float = 1e-12) -> None:
    for j, joint in enumerate(("j1", "j2")):
        np.testing.assert_allclose(came[f"position.{joint}"][row], q[:, j], rtol=0, atol=atol)
        np.testing.assert_allclose(came[f"velocity.{joint}"][row], v[:, j], rtol=0, atol=100 * atol)


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast", "RK4"])
@pytest.mark.parametrize("actuators", [SERVOS, MIXED])
def test_without_effects_it_is_mj_step(tmp_path: Path, actuators: str, integrator: str) -> None:
    xml = arm_xml(actuators, integrator)
    robot = robot_of(tmp_path, xml)
    drive, start = random_drive(robot, ROWS, STEPS), random_start(robot, ROWS)
    came = dict(robot.replay(start, drive, Settings(ROWS), CHANNELS))
    plain = mujoco.MjModel.from_xml_string(xml)  # compiled by itself, without what the robot adds for its effects
    for row in range(ROWS):
        agree(came, row, *literal(plain, start, drive.command[row, drive.lead :], row)[:2])


def test_an_actuator_with_a_filter_settles_on_its_first_command(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml(FILTERED))
    drive, start = random_drive(robot, ROWS, STEPS), random_start(robot, ROWS)
    came = dict(robot.replay(start, drive, Settings(ROWS), CHANNELS))
    for row in range(ROWS):
        agree(came, row, *literal(robot.model, start, drive.command[row, drive.lead :], row)[:2])


@pytest.mark.parametrize("actuators", [SERVOS, MIXED, FILTERED])
def test_rolled_out_and_stepped_agree(tmp_path: Path, actuators: str) -> None:
    """Wanting the outputs forces one call a step."""
    robot = robot_of(tmp_path, arm_xml(actuators))
    drive, start = random_drive(robot, ROWS, STEPS), random_start(robot, ROWS)
    settings = settings_of(
        robot,
        {},
        {("payload", None, "mass"): 0.2, ("coulomb_friction", "j1", "torque"): 0.1},
        {("actuator_gain", "j2", "gain"): 0.7, ("command_delay", None, "delay"): 0.031},
    )
    rolled = robot.replay(start, drive, settings, CHANNELS)
    stepped = robot.replay(start, drive, settings, (*CHANNELS, *OUTPUTS))
    for channel in CHANNELS:
        np.testing.assert_allclose(rolled[channel], stepped[channel], rtol=0, atol=1e-12)


def test_rows_that_need_a_word_between_the_steps_mix_with_others(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    assert_rows_are_themselves(
        robot, [{}, {("voltage_sag", None, "rate"): 0.05}, {("armature", "j1", "inertia"): 0.02}], STEPS
    )


def test_outputs_are_the_actuators_forces(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    drive, start = random_drive(robot, ROWS, STEPS), random_start(robot, ROWS)
    came = robot.replay(start, drive, Settings(ROWS), OUTPUTS)
    for row in range(ROWS):
        force = literal(robot.model, start, drive.command[row, drive.lead :], row)[2]
        for i, name in enumerate(OUTPUTS):
            np.testing.assert_allclose(came[name][row, :-1], force[:, i], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("hypothesis", "old", "new"),
    [
        ({("armature", "j1", "inertia"): 0.03}, 'armature="0.01"', 'armature="0.04"'),
        ({("viscous_friction", "j2", "coefficient"): 0.2}, 'damping="0.05"', 'damping="0.25"'),
        ({("tune", None, "joint.j1.damping"): 0.35}, 'damping="0.1"', 'damping="0.35"'),
        ({("tune", None, "joint.j2.frictionloss"): 0.3}, 'frictionloss="0.02"', 'frictionloss="0.3"'),
        ({("tune", None, "actuator.j2.kp"): 33.0}, 'kp="20"', 'kp="33"'),
        ({("tune", None, "actuator.j2.kv"): 1.7}, 'kv="0.8"', 'kv="1.7"'),
        ({("tune", None, "body.lower.mass"): 0.7}, 'mass="0.4"', 'mass="0.7"'),
        ({("actuator_gain", "j1", "gain"): 0.6}, 'kp="30" kv="1.5"', 'kp="18" kv="0.9"'),
        ({("saturation", "j1", "limit"): 2.0}, 'kv="1.5"', 'kv="1.5" forcerange="-2 2"'),
        ({("saturation", None, "limit"): 2.5}, 'forcerange="-3 3"', 'forcerange="-2.5 2.5"'),
        ({("saturation", "j2", "limit"): 4.5}, 'forcerange="-3 3"', 'forcerange="-4.5 4.5"'),
    ],
)
def test_a_constant_effect_is_the_model_compiled_with_it(
    tmp_path: Path, hypothesis: dict[tuple[str, str | None, str], float], old: str, new: str
) -> None:
    xml = arm_xml()
    if hypothesis == {("saturation", None, "limit"): 2.5}:
        xml = xml.replace('kv="1.5"', 'kv="1.5" forcerange="-2.5 2.5"')
    assert old in xml
    robot = robot_of(tmp_path, arm_xml())
    drive, start = random_drive(robot, ROWS, STEPS), random_start(robot, ROWS)
    came = dict(robot.replay(start, drive, settings_of(robot, *[hypothesis] * ROWS), CHANNELS))
    compiled = mujoco.MjModel.from_xml_string(xml.replace(old, new))
    plain = mujoco.MjModel.from_xml_string(arm_xml())
    for row in range(ROWS):
        q, v, _ = literal(compiled, start, drive.command[row, drive.lead :], row)
        assert np.abs(q - literal(plain, start, drive.command[row, drive.lead :], row)[0]).max() > 1e-4
        agree(came, row, q, v, atol=1e-11)


@pytest.mark.parametrize("gain", [1.0, 0.8, 1.3])
def test_friction_below_zero_is_a_servo_that_damps_less(tmp_path: Path, gain: float) -> None:
    """By the coefficient, whatever the gain; a servo at its limit does not push, and one that is off neither."""
    robot = robot_of(tmp_path, arm_xml())
    drive, start = random_drive(robot, ROWS, STEPS, size=1.5), random_start(robot, ROWS)
    found = {("viscous_friction", "j1", "coefficient"): -2.1, ("viscous_friction", "j2", "coefficient"): -0.45}
    weaker = {("actuator_gain", "j1", "gain"): gain, ("actuator_gain", "j2", "gain"): gain}
    compiled = arm_xml()
    for old, new in (
        ('damping="0.1"', 'damping="0"'),
        ('damping="0.05"', 'damping="0"'),
        ('kp="30" kv="1.5"', f'kp="{30 * gain}" kv="{1.5 * gain - 2.0 / 2**2}"'),
        ('kp="20" kv="0.8"', f'kp="{20 * gain}" kv="{0.8 * gain - 0.4}"'),
    ):
        assert old in compiled
        compiled = compiled.replace(old, new)
    expected = robot_of(tmp_path, compiled)
    on = np.ones((ROWS, STEPS, 2))
    on[1, 60:, 0] = 0.0
    for enabled in (None, on):
        switched = replace(drive, enabled=enabled)
        came = robot.replay(start, switched, settings_of(robot, *[found | weaker] * ROWS), CHANNELS)
        wanted = expected.replay(start, switched, Settings(ROWS), CHANNELS)
        for channel in CHANNELS:
            np.testing.assert_allclose(came[channel], wanted[channel], rtol=0, atol=1e-9)
    forces = expected.replay(start, drive, Settings(ROWS), OUTPUTS)["output.j2"]
    assert (np.abs(forces) == 3.0).any()  # its limit


def test_a_servo_damps_no_less_than_not_at_all(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    drive, start = random_drive(robot, 2, STEPS), random_start(robot, 2)
    weak = {("actuator_gain", "j2", "gain"): 0.3}
    least, less = ({**weak, ("viscous_friction", "j2", "coefficient"): c} for c in (-0.05 - 0.3 * 0.8, -0.8))
    came = robot.replay(start, drive, settings_of(robot, least, less), CHANNELS)
    wanted = robot.replay(start, drive, settings_of(robot, least, least), CHANNELS)
    for channel in CHANNELS:
        np.testing.assert_allclose(came[channel][1], wanted[channel][1], rtol=0, atol=1e-12)


def test_a_command_delay_is_a_late_control(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    drive, start = random_drive(robot, ROWS, STEPS), random_start(robot, ROWS)
    came = dict(
        robot.replay(start, drive, settings_of(robot, *[{("command_delay", "j1", "delay"): 0.0531}] * ROWS), CHANNELS)
    )
    late = delay_sequence({"delay": np.array([[0.0531, 0.0]] * ROWS)}, drive.command, drive.dt)
    for row in range(ROWS):
        agree(came, row, *literal(robot.model, start, late[row, drive.lead :], row)[:2])


def test_a_servo_that_is_off_swings_freely(tmp_path: Path) -> None:
    """Off in the middle of the window, as a model without its actuators from there on."""
    robot = robot_of(tmp_path, arm_xml())
    drive, start = random_drive(robot, 1, STEPS), random_start(robot, 1)
    on = np.ones((1, STEPS, 2))
    on[:, 60:] = 0.0
    came = dict(robot.replay(start, replace(drive, enabled=on), Settings(1), CHANNELS))
    q, v, _ = literal(robot.model, start, drive.command[0, drive.lead : drive.lead + 60], 0)
    free = mujoco.MjModel.from_xml_string(arm_xml("").replace("<actuator></actuator>", ""))
    middle = {f"{k}.j{j + 1}": x[-1, j : j + 1] for k, x in (("position", q), ("velocity", v)) for j in (0, 1)}
    q_free, v_free, _ = literal(free, middle, np.zeros((STEPS - 60, 0)), 0)
    agree(came, 0, np.vstack([q, q_free[1:]]), np.vstack([v, v_free[1:]]), atol=1e-11)


def test_a_motor_may_come_on_again(tmp_path: Path) -> None:
    """Rolled out in parts and stepped: the same, whichever way the switching is done."""
    robot = robot_of(tmp_path, arm_xml())
    drive, start = random_drive(robot, ROWS, STEPS), random_start(robot, ROWS)
    on = np.ones((ROWS, STEPS, 2))
    on[0, 20:50, 0], on[1, 70:, 1], on[2, 5:9] = 0.0, 0.0, 0.0
    switched = replace(drive, enabled=on)
    rolled = robot.replay(start, switched, Settings(ROWS), CHANNELS)
    stepped = robot.replay(start, switched, Settings(ROWS), (*CHANNELS, *OUTPUTS))
    for channel in CHANNELS:
        np.testing.assert_allclose(rolled[channel], stepped[channel], rtol=0, atol=1e-12)
    assert (stepped["output.j1"][0, 21:50] == 0.0).all() and (stepped["output.j1"][0, 51:60] != 0.0).all()


@pytest.mark.parametrize(("size", "cores", "wanted"), [(3, 8, 1), (50, 8, 2), (10_000, 8, 8), (10_000, 1, 1)])
def test_threads_are_as_many_as_the_batch_is_worth(
    monkeypatch: pytest.MonkeyPatch, size: int, cores: int, wanted: int
) -> None:
    monkeypatch.setattr(module, "_cores", lambda: cores)
    assert module.threads_for(size) == wanted


def test_a_row_that_diverges_stays_where_it_was_last(tmp_path: Path) -> None:
    """Alike whether it is rolled out or stepped; MuJoCo itself would put it back to its start."""
    runaway = '<motor name="hub" joint="hub"/>'
    joint = 'damping="-200"'
    xml = wheel_xml(runaway, joint).replace("implicitfast", "Euler").replace("<option", "<option ")
    robot = robot_of(tmp_path, xml)
    steps = 400
    drive = Drive(0.002, 0, np.zeros((2, steps, 1)), None, np.zeros(2))
    start = {"position.hub": np.full(2, 0.3), "velocity.hub": np.array([0.1, 0.0])}
    for wanted in (("position.hub", "velocity.hub"), ("position.hub", "velocity.hub", "output.hub")):
        came = robot.replay(start, drive, Settings(2), wanted)
        away = came["position.hub"]
        assert np.isfinite(away).all() and np.abs(away[0, -1]) > 1e3 and away[0, -1] == away[0, -2]
        assert (np.diff(np.abs(away[0])) >= 0).all()  # never back
        np.testing.assert_array_equal(away[1], 0.3)
