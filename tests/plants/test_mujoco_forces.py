"""Effects written into MuJoCo's fields do what their equations say to a force, and to a wheel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import DT, arm_xml, literal, random_drive, random_start, robot_of, settings_of, wheel_xml

from plants.mujoco_robot import MujocoRobot
from residual_mpc.effects.actuator import gain_step, sag_step, saturation_step
from residual_mpc.effects.command import dead_zone_step
from residual_mpc.effects.ops import NUMPY
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings

INERTIA = 0.02  # kg m^2, of the wheel
OUTPUTS = ("output.j1", "output.j2")
ROWS = 40


def first_forces(robot: MujocoRobot, hypothesis: dict[tuple[str, str | None, str], float]) -> np.ndarray:
    """(ROWS, nu) N m: forces in the first step, 7 s into the run."""
    drive, start = random_drive(robot, ROWS, 1), random_start(robot, ROWS)
    drive = replace(drive, clock=np.full(ROWS, 7.0))
    out = robot.replay(start, drive, settings_of(robot, *[hypothesis] * ROWS), OUTPUTS)
    return np.stack([out[c][:, 0] for c in OUTPUTS], axis=-1)


def test_gain_saturation_and_sag_act_on_the_force(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml().replace('forcerange="-3 3"', ""))
    force, clock = first_forces(robot, {}), np.array(7.0 + 0.5 * DT)
    gain = gain_step(NUMPY, {"gain": np.array(0.7)}, (), force, clock, DT)[0]
    np.testing.assert_allclose(first_forces(robot, {("actuator_gain", None, "gain"): 0.7}), gain, atol=1e-12)
    sag = sag_step(NUMPY, {"rate": np.array(0.03)}, (), force, clock, DT)[0]
    np.testing.assert_allclose(first_forces(robot, {("voltage_sag", None, "rate"): 0.03}), sag, atol=1e-12)
    limit = float(np.median(np.abs(force)))
    held = saturation_step(NUMPY, {"limit": np.array(limit)}, (), force, clock, DT)[0]
    assert 0.3 < np.mean(held != force) < 0.7
    np.testing.assert_allclose(first_forces(robot, {("saturation", None, "limit"): limit}), held, atol=1e-12)


def test_the_three_act_together_in_the_order_of_the_chain(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml().replace('forcerange="-3 3"', ""))
    force = first_forces(robot, {})
    limit = float(np.median(np.abs(force))) * 0.5
    hypothesis = {
        ("actuator_gain", None, "gain"): 0.7,
        ("voltage_sag", None, "rate"): 0.03,
        ("saturation", None, "limit"): limit,
    }
    scaled = 0.7 * (1.0 - 0.03 * (7.0 + 0.5 * DT)) * force
    np.testing.assert_allclose(first_forces(robot, hypothesis), np.clip(scaled, -limit, limit), atol=1e-12)


def test_a_servos_dead_zone_is_one_of_its_error(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    width, drive, start = 0.12, random_drive(robot, 1, 200, size=0.3), random_start(robot, 1)
    settings = settings_of(robot, {("dead_zone", "j2", "width"): width})
    came = robot.replay(start, drive, settings, ("position.j2",))["position.j2"][0]
    data = mujoco.MjData(robot.model)
    data.qpos[:] = [start[f"position.{j}"][0] for j in ("j1", "j2")]
    data.qvel[:] = [start[f"velocity.{j}"][0] for j in ("j1", "j2")]
    quiet, seen = 0, [data.qpos[1]]
    for u in drive.command[0, drive.lead :]:
        error = dead_zone_step(NUMPY, {"width": np.array(width)}, (), u[1] - data.qpos[1], DT)[0]
        quiet += error == 0.0
        data.ctrl[:] = u[0], data.qpos[1] + error
        mujoco.mj_step(robot.model, data)
        seen.append(data.qpos[1])
    assert 20 < quiet < 180
    np.testing.assert_allclose(came, seen, rtol=0, atol=1e-10)


def spin(robot: MujocoRobot, speed: float, torque: float, steps: int, settings: Settings) -> np.ndarray:
    """(steps + 1,) rad/s under a constant torque."""
    drive = Drive(DT, 10, np.full((1, steps + 10, 1), torque), None, np.zeros(1))
    start = {"position.hub": np.zeros(1), "velocity.hub": np.array([speed])}
    return np.asarray(robot.replay(start, drive, settings, ("velocity.hub",))["velocity.hub"][0])


def test_dry_friction_slows_a_wheel_evenly_and_holds_it(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, wheel_xml())
    friction, speed = 0.05, 2.0
    stop = speed * INERTIA / friction  # 0.8 s
    v = spin(robot, speed, 0.0, 600, settings_of(robot, {("coulomb_friction", None, "torque"): friction}))
    t = DT * np.arange(601)
    wanted = np.maximum(speed - friction / INERTIA * t, 0.0)
    sliding, held = t < stop - 0.1, t > stop + 0.05
    np.testing.assert_allclose(v[sliding], wanted[sliding], rtol=0, atol=0.01 * speed)
    assert np.abs(v[held]).max() < 1e-3


@pytest.mark.parametrize("torque", [0.02, -0.04, 0.049])
def test_dry_friction_holds_a_wheel_against_less_torque(tmp_path: Path, torque: float) -> None:
    robot = robot_of(tmp_path, wheel_xml())
    v = spin(robot, 0.0, torque, 300, settings_of(robot, {("coulomb_friction", None, "torque"): 0.05}))
    assert np.abs(v).max() < 0.01 * abs(torque) / INERTIA  # a free wheel reaches 0.6 of this factor


@pytest.mark.parametrize(
    ("effect", "parameters", "level"),
    [
        ("coulomb_friction", {"torque": 0.05}, 0.05),
        (
            "stribeck_friction",
            {"static": 0.09, "kinetic": 0.05, "velocity": 0.1},
            0.05,
        ),  # far above its velocity
        ("load_dependent_friction", {"coefficient": 0.25}, 0.05),  # of the motor's 0.2 N m
        ("load_dependent_friction", {"coefficient": 0.1, "quadratic": 0.75}, 0.05),
        ("viscous_friction", {"coefficient": 0.01}, None),
    ],
)
def test_a_driven_wheel_accelerates_by_what_is_left(
    tmp_path: Path, effect: str, parameters: dict[str, float], level: float | None
) -> None:
    robot = robot_of(tmp_path, wheel_xml())
    settings = settings_of(robot, {(effect, None, p): x for p, x in parameters.items()})
    v = spin(robot, 3.0, 0.2, 300, settings)
    t = DT * np.arange(301)
    if level is None:  # I dv/dt = tau - b v
        b = parameters["coefficient"]
        wanted = 0.2 / b + (3.0 - 0.2 / b) * np.exp(-b * t / INERTIA)
    else:
        wanted = 3.0 + (0.2 - level) / INERTIA * t
    np.testing.assert_allclose(v, wanted, rtol=0, atol=0.012 * (v[-1] - v[0]))


def test_stribeck_friction_is_larger_at_rest(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, wheel_xml())
    shape = {"static": 0.09, "kinetic": 0.03, "velocity": 0.2}
    settings = settings_of(robot, {("stribeck_friction", None, p): x for p, x in shape.items()})
    assert np.abs(spin(robot, 0.0, 0.08, 300, settings)).max() < 0.05  # held at rest
    assert spin(robot, 1.0, 0.08, 300, settings)[-1] > 1.5  # kept going by the same torque in motion


def test_a_frictions_sign_follows_the_motion(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, wheel_xml())
    for effect, p in (("coulomb_friction", "torque"), ("viscous_friction", "coefficient")):
        settings = settings_of(robot, {(effect, None, p): 0.02})
        forth, back = spin(robot, 2.0, 0.0, 100, settings), spin(robot, -2.0, 0.0, 100, settings)
        np.testing.assert_allclose(forth, -back, atol=1e-12)
        assert forth[-1] < 2.0


def test_a_negative_friction_takes_from_the_models_own(tmp_path: Path) -> None:
    """Down to none: a friction that drives the joint would be no friction."""
    robot = robot_of(tmp_path, wheel_xml(joint='frictionloss="0.05"'))
    assert robot.bounds("coulomb_friction", "torque", "hub")[0] == -0.05
    v = spin(robot, 2.0, 0.0, 100, settings_of(robot, {("coulomb_friction", None, "torque"): -0.05}))
    np.testing.assert_allclose(v, 2.0, atol=1e-9)


def test_sag_grows_over_the_run(tmp_path: Path) -> None:
    """Forces after each step, by the equation with the clock of that step."""
    robot = robot_of(tmp_path, wheel_xml())
    drive = Drive(DT, 10, np.full((1, 110, 1), 0.3), None, np.array([4.0]))
    start = {"position.hub": np.zeros(1), "velocity.hub": np.zeros(1)}
    settings = settings_of(robot, {("voltage_sag", None, "rate"): 0.05})
    out = robot.replay(start, drive, settings, ("output.hub",))["output.hub"][0]
    clock = 4.0 + DT * (np.arange(100) + 0.5)
    np.testing.assert_allclose(out[:-1], 0.3 * (1.0 - 0.05 * clock), atol=1e-12)


def test_literal_steps_are_the_robots(tmp_path: Path) -> None:
    """The literal way of these tests itself, in closed form: a wheel under a constant torque."""
    model = mujoco.MjModel.from_xml_string(wheel_xml())
    start = {"position.hub": np.zeros(1), "velocity.hub": np.zeros(1)}
    v = literal(model, start, np.full((50, 1), 0.1), 0)[1][:, 0]
    np.testing.assert_allclose(v, 0.1 / INERTIA * DT * np.arange(51), atol=1e-12)
