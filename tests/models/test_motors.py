"""[motor] in a robot file: who has which constants, and every slip as one clear message."""

from __future__ import annotations

from pathlib import Path

import pytest
from oracles.arms import arm_xml

import residual_mpc as rm
from residual_mpc.effects.servo.changes import ADVICE, advice_on
from residual_mpc.errors import BadInput
from residual_mpc.models.motors.published import DYNAMIXEL_X, FEETECH_STS, SERVOS
from residual_mpc.models.motors.tables import motor_of
from residual_mpc.models.robot_file import RobotFile, for_run, read_robot_file

HEAD = 'name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n'
GOOD = "[motor]\nvoltage = 7.4\nresistance = 4.02\ntorque_constant = 0.387\n"
ACTUATORS = '<position name="s1" joint="j1" kp="30"/><position name="s2" joint="j2" kp="20"/>'


def read(folder: Path, text: str) -> RobotFile:
    (folder / "arm.xml").write_text(arm_xml(ACTUATORS))
    (folder / "robot.toml").write_text(HEAD + text)
    return read_robot_file(folder / "robot.toml")


def test_a_table_holds_for_every_actuator_and_its_own_for_one(tmp_path: Path) -> None:
    robot = read(tmp_path, GOOD + "p_gain = 16\n[motor.s2]\nresistance = 3\n")
    first, second = motor_of(robot.motors, "s1"), motor_of(robot.motors, "s2")
    assert first is not None and (first.voltage, first.resistance, first.p_gain) == (7.4, 4.02, 16.0)
    assert second is not None and (second.voltage, second.resistance, second.p_gain) == (7.4, 3.0, 16.0)
    assert rm.load_robot(tmp_path / "robot.toml").file.motors == robot.motors


def test_without_a_table_no_motor_is_known(tmp_path: Path) -> None:
    assert motor_of(read(tmp_path, "").motors, "s1") is None


def test_a_servo_is_told_by_its_name_and_the_supply_that_it_has(tmp_path: Path) -> None:
    robot = read(tmp_path, '[motor]\nservo = "STS3215"\nvoltage = 6.0\np_gain = 16\n')
    motor, servo = motor_of(robot.motors, "s1"), SERVOS["sts3215"]
    assert motor is not None and motor.servo == "sts3215" and motor.voltage == 6.0
    assert (motor.resistance, motor.torque_constant) == (servo.resistance, servo.torque_constant)
    assert motor.stiffness == pytest.approx(servo.torque_constant * 6.0 / servo.resistance * 16 * 0.166)


def test_one_servo_may_be_another_than_the_rest(tmp_path: Path) -> None:
    robot = read(tmp_path, '[motor]\nservo = "sts3215"\nresistance = 3.0\n[motor.s2]\nservo = "xl330-m288"\n')
    second = motor_of(robot.motors, "s2")
    assert second is not None and second.resistance == SERVOS["xl330-m288"].resistance  # not the others' 3 ohm


def test_a_variant_overrides_one_entry(tmp_path: Path) -> None:
    robot = read(tmp_path, GOOD + '[[variant]]\nruns = "kp100_*"\n[variant.motor]\np_gain = 100\n')
    motor = motor_of(for_run(robot, "kp100_1").motors, "s1")
    assert motor is not None and (motor.p_gain, motor.voltage) == (100.0, 7.4)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[motor]\nvoltage = 7.4\n", "resistance and torque_constant are missing"),
        ("[motor.s1]\nvoltage = 7.4\nresistance = 4\n", "[motor.s1]: torque_constant is missing"),
        (GOOD.replace("4.02", "-4.02"), "resistance must be a number > 0, got -4.02. Give it in ohm"),
        (GOOD.replace("4.02", "true"), "resistance must be a number > 0, got True"),
        (GOOD.replace("4.02", "nan"), "resistance must be a number > 0, got nan"),
        (GOOD.replace("resistance", "resistence"), "Did you mean 'resistance'?"),
        ('[motor]\nservo = "xl330"\n', "unknown servo 'xl330'"),
        ("[motor]\nservo = 3215\n", "unknown servo 3215. Give a name in quotes"),
        ('motor = "sts3215"\n', "a table [motor]"),
        ('[[variant]]\nruns = "a"\n[variant.motor]\nvoltage = 7.4\n', "missing"),
    ],
)
def test_a_slip_is_named_with_its_place(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(BadInput) as fault:
        read(tmp_path, text)
    assert said in str(fault.value) and "robot.toml" in str(fault.value)


def test_a_motor_of_no_actuator_is_refused(tmp_path: Path) -> None:
    read(tmp_path, GOOD + "[motor.s3]\nvoltage = 6.0\n")
    with pytest.raises(BadInput, match="the model has no actuator 's3'") as fault:
        rm.load_robot(tmp_path / "robot.toml")
    assert "s1, s2" in str(fault.value)


def test_every_published_servo_states_its_source_and_makes_a_motor(tmp_path: Path) -> None:
    for name, servo in SERVOS.items():
        robot = read(tmp_path, f'[motor]\nservo = "{name}"\n')
        motor = motor_of(robot.motors, "s1")
        assert motor is not None and motor.stall_torque > 0.0 and servo.source


def test_the_e_manuals_stall_torque_is_read_back() -> None:
    servo = SERVOS["xl330-m288"]
    assert servo.torque_constant * servo.voltage / servo.resistance == pytest.approx(0.52)


def test_registers_are_named_by_settings_that_exist() -> None:
    numbers = {"gain": 0.9, "bias": 0.1, "delay": 0.02}
    settings = {a.register for e in ADVICE for a in advice_on(e, numbers, 20.0, 16.0)}
    assert {*DYNAMIXEL_X, *FEETECH_STS} <= settings
