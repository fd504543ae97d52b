"""Every effect on an arm: its compiled steps are MuJoCo's, called one by one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from oracles.arms import SERVOS, arm_xml, random_drive, random_start, robot_of

from plants.mujoco_robot import MujocoRobot
from plants.mujoco_robot.native.arms import native_arm
from plants.mujoco_robot.native.compiled import compiled
from plants.mujoco_robot.simulation import compiled_steps, gear_start, replay
from plants.mujoco_robot.simulation.one_step import OneStep
from residual_mpc.effects.effect import Effect
from residual_mpc.effects.laws import curve_shape, kind_of
from residual_mpc.effects.library import BY_NAME, HOSTED
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings

ROWS, STEPS = 5, 120
TORQUES = '<motor name="j1" joint="j1" gear="2"/><motor name="j2" joint="j2"/>'
EXACT = '<option tolerance="0" ls_tolerance="1e-6"/>'  # MuJoCo's solver otherwise stops 1e-8 too early
# the sites of robots that drive
WHEELS = ("pair", "pair command", "rolling", "roundness", "rim", "side", "drift", "rate")
# what acts between the sensors and the ground; `output` is of wheels without inertia
HERE = tuple(e for e in HOSTED if e.port != "sensor" and e.place not in (*WHEELS, "output"))


def arm(folder: Path, actuators: str = SERVOS, integrator: str = "implicitfast", **keys: str) -> MujocoRobot:
    xml = arm_xml(actuators, integrator).replace("<default>", EXACT + "<default>")
    return robot_of(folder, xml, **keys)


def numbers(robot: MujocoRobot, effect: Effect, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Parameters (ROWS, slots), the first row at their null values."""
    slots, out = robot.slots(effect.name), {}
    kind = kind_of(effect.name)
    for p in effect.parameters:
        size = robot.reference(p.reference, None) if p.reference in ("inertia", "mass", "length") else 1.0
        away = 0.0 if np.isinf(p.null) else p.null
        probe = max(p.probes, key=lambda x: abs(x - away)) * size if p.probes else p.null
        bounds = [robot.bounds(effect.name, p.name, s) for s in slots]
        share = rng.uniform(0.3, 1.0, (ROWS, len(slots)))
        drawn = p.null + (probe - p.null) * share if np.isfinite(p.null) else probe * share
        if kind is not None and kind.shape == "curve" and p.shape:
            knots = curve_shape([-0.4, 0.1, 0.6])
            drawn = np.full_like(drawn, knots[p.name]) if p.name in knots else drawn
        out[p.name] = np.clip(drawn, *np.array(bounds).T) if slots else drawn
        out[p.name][0] = p.null if not p.shape else out[p.name][0]
    return out


def assert_same(robot: MujocoRobot, drive: Drive, settings: Settings, within: float = 1e-9) -> None:
    start = random_start(robot, ROWS)
    wanted = (*robot.channels, *(f"output.{a}" for a in robot.actuators))
    for channels in (robot.channels, wanted):
        natively = robot.replay(start, drive, settings, channels)
        with (
            patch.object(replay, "native_arm", lambda robot: None),
            patch.object(compiled_steps, "native_arm", lambda robot: None),
        ):
            by_mujoco = robot.replay(start, drive, settings, channels)
        for channel, nodes in by_mujoco.items():
            scale = within * (1.0 + np.abs(nodes))
            off = np.abs(natively[channel] - nodes)
            assert np.isfinite(nodes).all()
            assert (off <= scale).all(), (channel, off.max())


@pytest.mark.parametrize("effect", HERE, ids=lambda e: e.name)
@pytest.mark.parametrize("actuators", [SERVOS, TORQUES], ids=["servos", "torques"])
def test_an_effect_is_what_it_is_in_mujoco(tmp_path: Path, actuators: str, effect: Effect) -> None:
    robot = arm(tmp_path, actuators)
    if not robot.slots(effect.name):  # what servos alone have
        assert effect.place in ("servo", "position gain") and actuators == TORQUES
        return
    rng = np.random.default_rng(3)
    drive = replace(random_drive(robot, ROWS, STEPS), clock=rng.uniform(0.0, 20.0, ROWS))
    assert_same(robot, drive, Settings(ROWS, {effect.name: numbers(robot, effect, rng)}))


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
@pytest.mark.parametrize("feedback", ["motor", "link"])
def test_all_that_changes_between_steps_together(tmp_path: Path, feedback: str, integrator: str) -> None:
    """Beside play and a soft gear, with servos that see the motor or the link, and actuators that are switched off."""
    robot = arm(tmp_path, SERVOS, integrator, servo_feedback=feedback)
    rng = np.random.default_rng(4)
    names = ("voltage_sag", "torque_speed_limit", "saturation", "dead_zone", "stribeck_friction", "gear_efficiency",
             "load_dependent_friction", "servo_integral", "torque_ripple", "actuator_gain", "joint_compliance",
             "command_delay", "payload", "end_stop", "position_gain")  # fmt: skip
    found = {e.name: numbers(robot, e, rng) for e in HERE if e.name in names and robot.slots(e.name)}
    drive = random_drive(robot, ROWS, STEPS)
    on = np.repeat(rng.uniform(0.0, 1.0, (ROWS, STEPS // 30, 2)) > 0.3, 30, axis=1).astype(float)
    settings = Settings(ROWS, found)
    assert_same(robot, drive, settings, 1e-8)
    assert_same(robot, replace(drive, enabled=on), settings, 1e-8)


@pytest.mark.parametrize("friction", [(), ("coulomb_friction",), ("coulomb_friction", "stribeck_friction")])
@pytest.mark.parametrize("gear", ["backlash", "joint_compliance"])
def test_friction_behind_a_gear(tmp_path: Path, gear: str, friction: tuple[str, ...]) -> None:
    """The model's and the added one, of which all or a part acts on the link, with play or on a spring."""
    robot = arm(tmp_path)
    rng = np.random.default_rng(5)
    found = {e.name: numbers(robot, e, rng) for e in HERE if e.name in (gear, *friction)}
    found[gear]["damping_behind"][1:, :] = rng.uniform(0.3, 1.0, (ROWS - 1, 2))
    assert_same(robot, random_drive(robot, ROWS, STEPS), Settings(ROWS, found), 1e-8)


def test_limits_beyond_those_of_the_model_with_a_supply_that_sags(tmp_path: Path) -> None:
    """Of 2 N m in the model, from half of that to twice as much, with an integrator that the limits clamp."""
    robot = arm(tmp_path, SERVOS.replace('kv="1.5"', 'kv="1.5" forcerange="-2 1.6"').replace("-3 3", "-2 2"))
    limit = np.tile(np.linspace(1.0, 4.0, ROWS)[:, None], (1, 2))
    found = {"saturation": {"limit": limit}, "voltage_sag": {"rate": np.full((ROWS, 2), 0.1)}}
    drive = random_drive(robot, ROWS, STEPS)
    assert_same(robot, drive, Settings(ROWS, found), 1e-8)
    found["servo_integral"] = {"gain": np.full((ROWS, 2), 2.0)}
    assert_same(robot, drive, Settings(ROWS, found), 1e-8)


def test_a_row_is_the_same_in_any_company(tmp_path: Path) -> None:
    """To the last bit: other rows decide what a program contains, not what it makes of this one."""
    robot = arm(tmp_path)
    rng = np.random.default_rng(5)
    drive, start = random_drive(robot, ROWS, STEPS), random_start(robot, ROWS)
    alone = robot.replay(start, drive, Settings(ROWS), robot.channels)
    for name in ("stribeck_friction", "voltage_sag", "joint_compliance", "torque_ripple"):
        effect = next(e for e in HERE if e.name == name)
        beside = robot.replay(start, drive, Settings(ROWS, {name: numbers(robot, effect, rng)}), robot.channels)
        for channel, nodes in alone.items():
            np.testing.assert_array_equal(beside[channel][0], nodes[0])
            assert not np.array_equal(beside[channel][1:], nodes[1:])


def test_so_is_a_row_with_a_soft_gear_and_commands_before_its_start(tmp_path: Path) -> None:
    """Among rows whose start takes more and fewer steps to find."""
    robot = arm(tmp_path)
    rng = np.random.default_rng(9)
    found = {e.name: numbers(robot, e, rng) for e in HERE if e.name in ("joint_compliance", "torque_ripple")}
    found["joint_compliance"]["stiffness"][1:] = np.geomspace(3.0, 300.0, ROWS - 1)[:, None]
    more = int(0.8 / 0.002)
    drive = random_drive(robot, ROWS, 20)
    drive = replace(drive, lead=more, command=rng.uniform(-0.4, 0.4, (ROWS, more + 20, 2)).cumsum(axis=1) * 0.02)
    start = random_start(robot, ROWS)
    whole = robot.replay(start, drive, Settings(ROWS, found), robot.channels)
    for row in range(ROWS):
        at = np.array([row])
        one = replace(drive, command=drive.command[at], clock=drive.clock[at])
        alone = robot.replay({k: v[at] for k, v in start.items()}, one, Settings(ROWS, found).take(at), robot.channels)
        for channel, nodes in alone.items():
            np.testing.assert_array_equal(whole[channel][row], nodes[0])


def test_nothing_is_left_to_mujoco(tmp_path: Path) -> None:
    """The programs do all of it: otherwise the comparisons above compare MuJoCo with itself."""
    robot = arm(tmp_path)
    rng, drive, start = np.random.default_rng(6), random_drive(robot, ROWS, 40), random_start(robot, ROWS)
    with (
        patch.object(replay, "_step_by_step", side_effect=AssertionError("stepped one by one")),
        patch.object(replay, "_by_mujoco", side_effect=AssertionError("rolled out by MuJoCo")),
    ):
        for effect in HERE:
            if robot.slots(effect.name):
                robot.replay(start, drive, Settings(ROWS, {effect.name: numbers(robot, effect, rng)}), robot.channels)


@pytest.mark.parametrize("change", ["longer step", "half step", "tuned", "other settings"])
def test_so_is_a_robot_that_was_changed(tmp_path: Path, change: str) -> None:
    robot = arm(tmp_path)
    rng, drive = np.random.default_rng(7), random_drive(robot, ROWS, STEPS)
    found = {
        e.name: numbers(robot, e, rng) for e in HERE if e.name in ("stribeck_friction", "payload", "actuator_gain")
    }
    tuned: dict[str, np.ndarray] = {}
    if change == "longer step":
        longer = robot.with_longer_step(3)
        assert longer is not None
        robot, drive = longer, replace(drive, dt=3.0 * drive.dt, lead=drive.lead // 3, command=drive.command[:, ::3])
    elif change == "half step":
        half = robot.with_half_step()
        assert half is not None
        robot = half
    elif change == "tuned":
        names = ("joint.j1.damping", "joint.j2.frictionloss", "joint.j2.armature", "actuator.j1.kp", "body.lower.mass")
        nominal = robot.nominal()
        tuned = {name: nominal[name] * rng.uniform(0.5, 1.5, ROWS) for name in names}
    else:
        (tmp_path / "heavy").mkdir()
        heavy = robot_of(tmp_path / "heavy", arm_xml().replace("<default>", EXACT + "<default>").replace("0.8", "1.1"))
        merged = robot.merged([heavy])
        assert merged is not None and "body_mass" in merged.differing
        robot, drive = merged, replace(drive, setting=rng.integers(0, 2, ROWS))
    assert native_arm(robot) is not None
    assert_same(robot, drive, Settings(ROWS, found, tuned))


def test_settings_that_differ_in_what_a_program_holds_go_to_mujoco(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    (tmp_path / "turned").mkdir()
    turned = robot_of(
        tmp_path / "turned",
        arm_xml().replace("<default>", EXACT + "<default>").replace('axis="0 1 0"', 'axis="0 1 0.1"'),
    )
    merged = robot.merged([turned])
    assert merged is not None
    assert native_arm(merged) is None


@pytest.mark.parametrize("law", ["torque_ripple", "torque_offset", "actuator_gain"])
@pytest.mark.parametrize("feedback", ["motor", "link"])
def test_the_commands_before_a_window_lead_to_the_same_start(tmp_path: Path, feedback: str, law: str) -> None:
    """Of an arm with a soft gear: what `begin` replays before it, and not what it makes of that."""
    robot = arm(tmp_path, SERVOS, servo_feedback=feedback)
    rng = np.random.default_rng(8)
    found = {e.name: numbers(robot, e, rng) for e in HERE if e.name in ("joint_compliance", law)}
    found["joint_compliance"]["damping_ratio"][1:] = 0.5  # servos that see the link swing up behind a gear with less
    drive = random_drive(robot, ROWS, 20)
    more = int(0.8 / drive.dt)
    drive = replace(drive, lead=more, command=rng.uniform(-0.4, 0.4, (ROWS, 1, 2)).repeat(more + 20, axis=1))
    drive.command[:, : more // 2] *= 0.5
    ends = []

    def led(*where: object) -> None:
        lead(*where)
        batch = where[0]
        ends.append((batch.bind("qpos").copy(), batch.bind("qvel").copy()))  # type: ignore[attr-defined]

    lead = gear_start._lead
    for native in (native_arm, lambda robot: None):
        with (
            patch.object(gear_start, "_lead", led),
            patch.object(compiled_steps, "native_arm", native),
            patch.object(replay, "native_arm", native),
        ):
            robot.replay(random_start(robot, ROWS), drive, Settings(ROWS, found), robot.channels)
    assert len(ends) % 2 == 0 and ends
    for natively, by_mujoco in zip(ends[: len(ends) // 2], ends[len(ends) // 2 :], strict=True):
        for a, b in zip(natively, by_mujoco, strict=True):
            assert np.abs(b).max() < 30.0  # rad, rad/s: nothing has swung up
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-8)


def test_mujoco_steps_those_rows_alone_that_a_program_leaves(tmp_path: Path) -> None:
    """Programs whose search for sticking joints is cut short leave some rows; each row is still MuJoCo's."""
    robot = arm(tmp_path)
    rng, effect = np.random.default_rng(3), BY_NAME["stribeck_friction"]
    drive = replace(random_drive(robot, ROWS, STEPS), clock=rng.uniform(0.0, 20.0, ROWS))
    left: list[np.ndarray | None] = []

    def counted(*args: Any) -> OneStep:
        step = OneStep(*args)
        left.append(step.rows)
        return step

    compiled.cache_clear()
    try:
        with (
            patch("plants.mujoco_robot.native.step.MOST", 2),
            patch("plants.mujoco_robot.native.arms.agrees", lambda *_: True),
            patch.object(replay, "OneStep", counted),
        ):
            assert_same(robot, drive, Settings(ROWS, {effect.name: numbers(robot, effect, rng)}))
    finally:
        compiled.cache_clear()
    some = [rows for rows in left if rows is not None]
    assert some and all(0 < len(rows) < ROWS for rows in some)
