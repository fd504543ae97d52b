"""What may be added to a model at most follows from its own masses, inertias and motors."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import CHANNELS, MIXED, SERVOS, arm_xml, random_drive, random_start, robot_of, settings_of, wheel_xml

from plants.mujoco_robot import MujocoRobot

LINK = """<body name="{name}" pos="{at} 0 0"><joint name="{name}" axis="0 1 0" {joint}/>
  <inertial pos="0.1 0 0" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>{rest}</body>"""


def wrist_xml(armature: str = "", motor: str = "") -> str:
    """Two heavy links and a wrist whose inertia is a thousandth of theirs."""
    wrist = LINK.format(name="wrist", at=0.4, joint=armature, mass=0.05, inertia=1e-4, rest="")
    elbow = LINK.format(name="elbow", at=0.4, joint=armature, mass=3.0, inertia=0.05, rest=wrist)
    links = LINK.format(name="shoulder", at=0, joint=armature, mass=6.0, inertia=0.1, rest=elbow)
    servos = "".join(
        f'<position name="{j}" joint="{j}" kp="100" kv="5" {motor if j == "wrist" else ""}/>'
        for j in ("shoulder", "elbow", "wrist")
    )
    return f"<mujoco><option timestep='0.002'/><worldbody>{links}</worldbody><actuator>{servos}</actuator></mujoco>"


def literal_inertia(model: mujoco.MjModel, steps: int = 91) -> np.ndarray:
    """(2,) largest diagonal of the mass matrix of the two-joint arm over its second joint, without rotors."""
    data, most = mujoco.MjData(model), np.zeros(2)
    for angle in np.linspace(-np.pi / 2, np.pi / 2, steps):
        data.qpos[1] = angle
        mujoco.mj_forward(model, data)
        full = np.zeros((2, 2))
        mujoco.mj_fullM(model, data, full)
        most = np.maximum(most, np.diag(full) - model.dof_armature)
    return most


def highest(robot: MujocoRobot, effect: str, parameter: str, slot: str | None) -> float:
    return robot.bounds(effect, parameter, slot)[1]


def test_a_rotor_is_at_most_three_times_what_the_joint_carries(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml(gravity=0.0))
    shoulder, _ = 3.0 * literal_inertia(robot.model)
    assert highest(robot, "armature", "inertia", "j1") == pytest.approx(shoulder, rel=0.02)


def test_a_rotor_of_every_joint_alike_does_not_freeze_the_smallest(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, wrist_xml())
    wrist = 1e-4 + 0.05 * 0.1**2
    assert highest(robot, "armature", "inertia", "shoulder") > 1.0
    assert highest(robot, "armature", "inertia", None) == pytest.approx(10.0 * wrist)
    modelled = robot_of(tmp_path, wrist_xml('armature="0.1"'))  # what the model itself has is possible
    assert highest(modelled, "armature", "inertia", None) == pytest.approx(0.1 + 10.0 * wrist)


def test_a_wrists_rotor_may_be_larger_than_what_it_carries(tmp_path: Path) -> None:
    """As far as its motor still moves it; where nothing is known of the motor, like a typical joint of the arm."""
    strong = robot_of(tmp_path, wrist_xml(motor='forcerange="-12 12"'))
    assert highest(strong, "armature", "inertia", "wrist") == pytest.approx(12.0 / 5.0)
    unknown = robot_of(tmp_path, wrist_xml())
    elbow = 0.05 + 3.0 * 0.1**2 + 1e-4 + 0.05 * 0.5**2
    assert highest(unknown, "armature", "inertia", "wrist") == pytest.approx(3.0 * elbow, rel=0.02)


def test_the_only_joint_is_no_joint_among_many(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, wheel_xml('<motor name="hub" joint="hub" ctrlrange="-1 1" gear="4"/>'))
    for slot in (None, "hub"):
        assert highest(robot, "armature", "inertia", slot) == pytest.approx(4.0 / 5.0)


def test_no_mass_is_added_beyond_the_arms_own(tmp_path: Path) -> None:
    pedestal = '<body name="pedestal" pos="2 0 0"><geom size="0.1" mass="50"/></body>'
    robot = robot_of(tmp_path, wrist_xml().replace("<worldbody>", f"<worldbody>{pedestal}"))
    assert highest(robot, "payload", "mass", None) == pytest.approx(9.05)
    assert highest(robot, "link_mass", "mass", "wrist") == pytest.approx(9.05)
    assert robot.bounds("link_mass", "com", "wrist") == (-np.inf, np.inf)


def test_friction_is_at_most_what_the_motors_overcome(tmp_path: Path) -> None:
    servos = robot_of(tmp_path, arm_xml(SERVOS))
    assert highest(servos, "coulomb_friction", "torque", "j2") == pytest.approx(3.0)  # its force range
    assert highest(servos, "coulomb_friction", "torque", "j1") == np.inf  # nothing is said of its force
    assert highest(servos, "coulomb_friction", "torque", None) == pytest.approx(3.0)
    assert highest(servos, "stribeck_friction", "static", "j2") == pytest.approx(3.0)
    assert highest(servos, "stribeck_friction", "velocity", "j2") == np.inf
    motor = MIXED.replace('gear="3"', 'gear="3" ctrlrange="-2 2"')
    assert highest(robot_of(tmp_path, arm_xml(motor)), "coulomb_friction", "torque", "j1") == pytest.approx(6.0)
    held = arm_xml(motor).replace('name="j1" axis', 'name="j1" actuatorfrcrange="-5 5" axis')
    assert highest(robot_of(tmp_path, held), "coulomb_friction", "torque", "j1") == pytest.approx(5.0)


def test_friction_may_take_all_of_the_damping_of_a_strong_servo(tmp_path: Path) -> None:
    servos = robot_of(tmp_path, arm_xml(SERVOS))  # whose first has a gear of 2
    assert servos.bounds("viscous_friction", "coefficient", "j1")[0] == pytest.approx(-(0.1 + 5.0 * 1.5 * 2**2))
    assert servos.bounds("viscous_friction", "coefficient", "j2")[0] == pytest.approx(-(0.05 + 5.0 * 0.8))
    assert servos.bounds("viscous_friction", "coefficient", None)[0] == pytest.approx(-(0.05 + 5.0 * 0.8))
    others = robot_of(tmp_path, arm_xml(MIXED))  # a motor, and a servo of the speed
    assert [others.bounds("viscous_friction", "coefficient", j)[0] for j in ("j1", "j2")] == [-0.1, -0.05]


def test_what_is_taken_from_a_retuned_model_leaves_no_negative_friction(tmp_path: Path) -> None:
    """The joint's own damping is gone, and the rest comes off the servo's."""
    robot = robot_of(tmp_path, arm_xml())
    drive, start = random_drive(robot, 2, 200), random_start(robot, 2)
    tuned = {
        ("tune", None, "joint.j1.damping"): 0.02,
        ("tune", None, "joint.j1.armature"): 0.0,
        ("tune", None, "actuator.j1.kv"): 1.5,
    }
    below = {("viscous_friction", "j1", "coefficient"): -0.1, ("armature", "j1", "inertia"): -0.005}
    none = {
        ("tune", None, "joint.j1.damping"): 0.0,
        ("tune", None, "joint.j1.armature"): 0.0,
        ("tune", None, "actuator.j1.kv"): 1.5 - 0.08 / 2**2,
    }
    found = robot.replay(start, drive, settings_of(robot, tuned | below, none), CHANNELS)
    wanted = robot.replay(start, drive, settings_of(robot, none, none), CHANNELS)
    for channel in CHANNELS:
        np.testing.assert_allclose(found[channel][0], wanted[channel][0], rtol=0, atol=1e-12)


def test_settings_of_one_robot_share_their_widest_bounds(tmp_path: Path) -> None:
    light, heavy = robot_of(tmp_path, wrist_xml()), robot_of(tmp_path, wrist_xml().replace('"6.0"', '"8.0"'))
    both = light.merged([heavy])
    assert both is not None
    assert highest(both, "payload", "mass", None) == pytest.approx(11.05)
    assert both.bounds("payload", "mass", None)[0] == pytest.approx(-0.9 * 0.05)
