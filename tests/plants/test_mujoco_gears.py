"""Springs and play between motor and link, against two inertias integrated elsewhere and against another MJCF."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import (
    CHANNELS,
    MIXED,
    SERVOS,
    Hypothesis,
    arm_xml,
    assert_rows_are_themselves,
    random_drive,
    random_start,
    robot_of,
    settings_of,
)
from oracles.two_masses import Gear

from residual_mpc.errors import BadInput
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings

STEP, K, RATIO = 0.0005, 40.0, 0.05  # s, N m/rad, of critical damping


def spring(feedback: str = "motor", sensor: str = "link", ratio: float = RATIO) -> Gear:
    bare = Gear(K, 0.0, feedback=feedback, sensor=sensor)
    link = bare.inertia + bare.mass * bare.length**2
    return replace(bare, damping=2 * ratio * np.sqrt(K * bare.rotor * link / (bare.rotor + link)))


def swing(
    gear: Gear, folder: Path, hypothesis: Hypothesis, step: float = STEP, integrator: str = "implicitfast"
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What is logged over a second of commands that jump, from rest: the truth, the robot's replay, the plain's."""
    rng, hold = np.random.default_rng(0), round(0.1 / step)
    u = np.repeat(rng.uniform(-0.6, 0.6, 10), hold)
    start = gear.at_rest(u[0])
    if gear.play:
        start[0] += np.sign(start[0]) * 0.5 * gear.play  # the motor is ahead of a link that it holds up
        start = gear.driven(start, np.full(round(2.0 / step), u[0]), step)[-1]
    truth = gear.logged(gear.driven(start, u, step))
    keys = {"servo_feedback": gear.feedback, "position_sensor": gear.sensor}
    robot = robot_of(folder, gear.xml % (step, integrator), **keys)
    drive = Drive(step, 1, np.concatenate([u[:1], u])[None, :, None], None, np.zeros(1))
    begin = {"position.shoulder": truth[:1], "velocity.shoulder": np.zeros(1)}
    wanted = ("position.shoulder",)
    settings = settings_of(robot, hypothesis)
    found = [robot.replay(begin, drive, s, wanted)["position.shoulder"][0] for s in (settings, Settings(1))]
    return truth, found[0], found[1]


@pytest.mark.parametrize(
    ("feedback", "sensor", "step", "integrator", "near"),
    [
        ("motor", "link", STEP, "implicitfast", 0.003),
        ("motor", "motor", STEP, "Euler", 0.006),
        ("motor", "link", 4 * STEP, "RK4", 0.003),  # stepped four times as finely once it is split
        ("link", "link", STEP, "implicitfast", 0.02),  # its servo shakes the spring, and each step is late for it
    ],
)
def test_a_spring_makes_two_inertias(
    tmp_path: Path, feedback: str, sensor: str, step: float, integrator: str, near: float
) -> None:
    hypothesis: Hypothesis = {("joint_compliance", None, "stiffness"): K}
    truth, came, plain = swing(spring(feedback, sensor), tmp_path, hypothesis, step, integrator)
    assert np.abs(plain - truth).max() > 0.08
    assert np.abs(came - truth)[: round(0.05 / step)].max() < 1e-6  # a spring that is wound up is not let go
    assert np.abs(came - truth).max() < near


def test_a_spring_may_swing_longer_or_shorter(tmp_path: Path) -> None:
    stiffness = ("joint_compliance", None, "stiffness")
    for ratio, differs in ((0.01, 0.004), (0.4, 0.03)):
        ours: Hypothesis = {stiffness: K, ("joint_compliance", None, "damping_ratio"): ratio}
        truth, came, _ = swing(spring(ratio=ratio), tmp_path, ours)
        usual = swing(spring(ratio=ratio), tmp_path, {stiffness: K})[1]
        assert np.abs(came - truth).max() < 0.0025 and np.abs(usual - truth).max() > differs


@pytest.mark.parametrize("sensor", ["link", "motor"])
def test_play_makes_two_inertias_and_two_stops(tmp_path: Path, sensor: str) -> None:
    gear = Gear(4000.0, 4.0, play=0.08, sensor=sensor)
    truth, came, plain = swing(gear, tmp_path, {("backlash", None, "gap"): 0.08})
    assert np.abs(plain - truth).max() > 0.05 and np.sqrt(np.mean((plain - truth) ** 2)) > 0.03
    assert np.sqrt(np.mean((came - truth) ** 2)) < 0.006


def test_damping_may_act_behind_the_play(tmp_path: Path) -> None:
    """A link that its own bearing slows stays where it is while the motor crosses the play."""
    gear = Gear(4000.0, 4.0, play=0.08, friction=0.4, behind=1.0)
    gap: Hypothesis = {("backlash", None, "gap"): 0.08}
    truth, came, _ = swing(gear, tmp_path, {**gap, ("backlash", None, "damping_behind"): 1.0})
    _, on_the_motor, _ = swing(gear, tmp_path, gap)
    assert np.sqrt(np.mean((came - truth) ** 2)) < 0.006
    assert np.sqrt(np.mean((on_the_motor - truth) ** 2)) > 2.0 * np.sqrt(np.mean((came - truth) ** 2))


def test_dry_friction_may_act_behind_the_play(tmp_path: Path) -> None:
    """A link that its own bearing holds stays where it is while the motor crosses the play."""
    gear = Gear(4000.0, 4.0, play=0.08, dry=0.3, behind=1.0, mass=0.05)
    gap: Hypothesis = {("backlash", None, "gap"): 0.08}
    truth, came, _ = swing(gear, tmp_path, {**gap, ("backlash", None, "damping_behind"): 1.0})
    _, on_the_motor, _ = swing(gear, tmp_path, gap)
    error, other = (np.sqrt(np.mean((x - truth) ** 2)) for x in (came, on_the_motor))
    assert error < 0.006 and other > 3.0 * error


def test_damping_may_act_behind_the_spring(tmp_path: Path) -> None:
    """A link that its own bearing slows winds up the spring."""
    gear = replace(spring(), friction=0.4, behind=1.0)
    stiffness: Hypothesis = {("joint_compliance", None, "stiffness"): K}
    truth, came, _ = swing(gear, tmp_path, {**stiffness, ("joint_compliance", None, "damping_behind"): 1.0})
    _, on_the_motor, _ = swing(gear, tmp_path, stiffness)
    error, other = (np.sqrt(np.mean((x - truth) ** 2)) for x in (came, on_the_motor))
    assert error < 0.003 and other > 2.0 * error


def test_a_spring_behind_play(tmp_path: Path) -> None:
    gear = replace(spring(), play=0.08)
    both: Hypothesis = {("joint_compliance", None, "stiffness"): K, ("backlash", None, "gap"): 0.08}
    truth, came, plain = swing(gear, tmp_path, both)
    assert np.sqrt(np.mean((plain - truth) ** 2)) > 0.05
    assert np.sqrt(np.mean((came - truth) ** 2)) < 0.01


ARM = arm_xml().replace(' frictionloss="0.02" range="-90 90"', "").replace("0.002", str(STEP))


def rotor_apart(stiffness: float) -> mujoco.MjModel:
    """The arm with the second joint's rotor as a body of its own, bound to the link by a tendon."""
    plain, spec = mujoco.MjModel.from_xml_string(ARM), mujoco.MjSpec.from_string(ARM)
    link = spec.joint("j2")
    rotor = spec.body("upper").add_body(name="rotor", pos=spec.body("lower").pos, mass=1e-7, inertia=[1e-9] * 3)
    rotor.explicitinertial = True
    rotor.add_joint(name="rotor", axis=link.axis, armature=0.005, damping=[0.05, 0, 0])
    link.armature, link.damping = 0.0, [0.0, 0.0, 0.0]
    spec.actuator("j2").target = "rotor"
    inertia = float(plain.dof_M0[1] - plain.dof_armature[1])
    damping = 2 * RATIO * np.sqrt(stiffness * 0.005 * inertia / (0.005 + inertia))
    bound = spec.add_tendon(name="gear", stiffness=[stiffness, 0, 0], damping=[damping, 0, 0], springlength=(0.0, 0.0))
    bound.wrap_joint("rotor", -1.0)
    bound.wrap_joint("j2", 1.0)
    return spec.compile()


def test_it_is_the_mjcf_with_the_rotor_as_a_body(tmp_path: Path) -> None:
    """Whatever hangs on the link: in an arm of two joints, from rest."""
    robot, truth = robot_of(tmp_path, ARM), rotor_apart(15.0)
    u = np.repeat(np.random.default_rng(0).uniform(-0.6, 0.6, (8, 2)), 200, axis=0)
    data, q = mujoco.MjData(truth), []
    for k, command in enumerate([*np.repeat(u[:1], 8000, axis=0), *u]):
        data.ctrl[:] = command
        if k >= 8000:
            q.append([data.qpos[truth.joint(j).id] for j in ("j1", "j2")])
        mujoco.mj_step(truth, data)
    wanted = np.array(q)
    start = {f"position.j{i + 1}": wanted[:1, i] for i in (0, 1)} | {f"velocity.j{i}": np.zeros(1) for i in (1, 2)}
    drive = Drive(STEP, 1, np.concatenate([u[:1], u])[None], None, np.zeros(1))
    soft = settings_of(robot, {("joint_compliance", "j2", "stiffness"): 15.0})
    came, plain = (robot.replay(start, drive, s, CHANNELS) for s in (soft, Settings(1)))
    for i, joint in enumerate(("j1", "j2")):
        assert np.abs(plain[f"position.{joint}"][0, :-1] - wanted[:, i]).max() > 0.015
        assert np.abs(came[f"position.{joint}"][0, :-1] - wanted[:, i]).max() < 2e-3


def test_rows_without_them_keep_their_bits(tmp_path: Path) -> None:
    """Beside rows that have them, alone or with what changes between the steps; and such a row is itself alone."""
    robot = robot_of(tmp_path, arm_xml())
    others: list[Hypothesis] = [
        {("joint_compliance", "j1", "stiffness"): 50.0},
        {("backlash", "j2", "gap"): 0.05, ("payload", None, "mass"): 0.1, ("link_length", "upper", "offset"): 0.02},
        {("joint_compliance", None, "stiffness"): 30.0, ("voltage_sag", None, "rate"): 0.05},
        {("backlash", "j1", "gap"): 0.04, ("joint_compliance", "j2", "stiffness"): 20.0},
        {("joint_compliance", "j1", "stiffness"): 25.0, ("stribeck_friction", "j1", "static"): 0.2},
    ]
    assert_rows_are_themselves(robot, [{}, *others, {("voltage_sag", None, "rate"): 0.05}], 100)


@pytest.mark.parametrize("actuators", [SERVOS, MIXED])
def test_stiffer_and_tighter_gears_come_near_to_none(tmp_path: Path, actuators: str) -> None:
    robot = robot_of(tmp_path, arm_xml(actuators))
    drive, start = random_drive(robot, 2, 200), random_start(robot, 2)
    plain = robot.replay(start, drive, Settings(2), CHANNELS)["position.j1"]
    # motor and stop are not integrated as one, which costs a few mrad at steps of 2 ms
    for effect, parameter, values, near in (
        ("joint_compliance", "stiffness", (1e2, 1e3, 1e5), 1e-3),
        ("backlash", "gap", (0.1, 0.01, 1e-4), 6e-3),
    ):
        off = []
        for value in values:
            settings = settings_of(robot, *[{(effect, None, parameter): value}] * 2)
            off.append(np.abs(robot.replay(start, drive, settings, CHANNELS)["position.j1"] - plain).max())
        assert off[0] > 2 * off[1] > 2 * off[2] and off[2] < near, (effect, off)


@pytest.mark.parametrize(
    "default",
    ['<joint limited="true"/>', '<joint stiffness="3" margin="0.01"/>', '<tendon stiffness="5" damping="2"/>'],
)
def test_a_gear_takes_nothing_from_the_models_defaults(tmp_path: Path, default: str) -> None:
    """A joint that has to have a range has none between motor and link; a hard gear is as good as none."""
    xml = arm_xml().replace("<default>", f"<default>{default}")
    robot = robot_of(tmp_path, xml.replace('name="j1" axis', 'name="j1" range="-170 170" axis'))
    drive, start = random_drive(robot, 2, 100), random_start(robot, 2)
    hard = {("joint_compliance", j, "stiffness"): 1e6 for j in ("j1", "j2")}
    came = robot.replay(start, drive, settings_of(robot, hard, hard), CHANNELS)
    wanted = robot.replay(start, drive, settings_of(robot, {}, {}), CHANNELS)
    for channel in ("position.j1", "position.j2"):
        np.testing.assert_allclose(came[channel], wanted[channel], atol=0.01)


def test_a_joints_range_holds_its_link(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml().replace('range="-90 90"', 'range="-20 20"'))
    drive, start = random_drive(robot, 1, 200), {c: np.zeros(1) for c in CHANNELS}
    drive = replace(drive, command=np.full_like(drive.command, 1.5))
    soft = settings_of(robot, {("joint_compliance", "j2", "stiffness"): 8.0})
    link = [robot.replay(start, drive, s, ("position.j2",))["position.j2"][0] for s in (soft, Settings(1))]
    assert np.rad2deg(link[0][-1]) == pytest.approx(np.rad2deg(link[1][-1]), abs=1.0)  # the motor goes on, to 70 deg


def test_the_link_starts_on_the_side_that_gravity_pushes_it_to(tmp_path: Path) -> None:
    """A servo at rest that holds its link up: the link stays where it was logged, and the motor is ahead of it."""
    gear = Gear(K, 0.0)
    robot = robot_of(tmp_path, gear.xml % (0.001, "implicitfast"))
    for command, play in ((0.8, 0.1), (-0.8, 0.1)):
        pull = gear.mass * 9.81 * gear.length
        angle = command * 0.85
        for _ in range(50):  # the servo at angle + play / 2 bears the weight
            angle = command - 0.5 * play * np.sign(command) - pull * np.sin(angle) / gear.kp
        drive = Drive(0.001, 1, np.full((1, 301, 1), command), None, np.zeros(1))
        start = {"position.shoulder": np.array([angle]), "velocity.shoulder": np.zeros(1)}
        loose = settings_of(robot, {("backlash", None, "gap"): play})
        came = robot.replay(start, drive, loose, ("position.shoulder",))["position.shoulder"][0]
        assert np.abs(came - angle).max() < 2e-4


@pytest.mark.parametrize("sensor", ["link", "motor"])
@pytest.mark.parametrize("command", [0.9, -0.6])
def test_a_soft_spring_starts_wound_up_where_its_servo_seems_at_its_limit(
    tmp_path: Path, sensor: str, command: float
) -> None:
    """With motor and link in one place the servo's error would be beyond its limit; wound up, the spring asks for half
    of it."""
    gear = Gear(4.0, 0.0, kp=60.0, sensor=sensor)
    limited = (gear.xml % (0.001, "implicitfast")).replace('kp="60.0"', 'kp="60.0" forcerange="-2 2"')
    assert "forcerange" in limited
    robot = robot_of(tmp_path, limited, position_sensor=sensor)
    angle = gear.logged(gear.at_rest(command)[None])
    start = {"position.shoulder": angle, "velocity.shoulder": np.zeros(1)}
    drive = Drive(0.001, 1, np.full((1, 501, 1), command), None, np.zeros(1))
    soft = settings_of(robot, {("joint_compliance", None, "stiffness"): gear.stiffness})
    came = robot.replay(start, drive, soft, ("position.shoulder",))["position.shoulder"][0]
    assert np.abs(came - angle).max() < 1e-4


def test_half_the_step_begins_a_window_alike(tmp_path: Path) -> None:
    """The commands before a window span the same time, however finely the model is stepped."""
    gear, step, lead = Gear(12.0, 0.0, kp=20.0), 0.001, 700
    robot = robot_of(tmp_path, gear.xml % (step, "implicitfast"))
    half = robot.with_half_step()
    assert half is not None
    u = np.repeat(np.random.default_rng(0).uniform(-0.5, 0.5, 12), 100)
    begun = gear.driven(gear.at_rest(u[0]), u[:lead], step)[-1]
    soft = settings_of(robot, {("joint_compliance", None, "stiffness"): gear.stiffness})
    start = {"position.shoulder": begun[1:2], "velocity.shoulder": begun[3:4]}
    drive = Drive(step, lead, u[None, :, None], None, np.zeros(1))
    wanted = ("position.shoulder",)
    whole, finer = (r.replay(start, drive, soft, wanted)["position.shoulder"][0] for r in (robot, half))
    assert np.abs(finer - whole).max() < 0.005 and np.ptp(whole) > 1.0


def test_a_held_command_before_the_window_has_let_the_robot_come_to_rest(tmp_path: Path) -> None:
    """Before a run's first stamp nothing is known but what was measured then: no swing is made up out of it."""
    gear = Gear(4.0, 0.0, kp=60.0)
    robot = robot_of(tmp_path, gear.xml % (0.001, "implicitfast"))
    rest = gear.at_rest(0.9)
    lead, u = 700, np.repeat([0.9, 0.7], [300, 200])
    truth = gear.logged(gear.driven(rest, u, 0.001))
    command = np.concatenate([np.full(lead, truth[0]), u])[None, :, None]
    start = {"position.shoulder": truth[:1], "velocity.shoulder": np.zeros(1)}
    soft = settings_of(robot, {("joint_compliance", None, "stiffness"): gear.stiffness})
    drive = Drive(0.001, lead, command, None, np.zeros(1))
    came = robot.replay(start, drive, soft, ("position.shoulder",))["position.shoulder"][0]
    assert np.abs(came - truth)[:300].max() < 1e-4


@pytest.mark.parametrize("feedback", ["motor", "link"])
def test_windows_at_rest_and_in_motion_begin_beside_each_other_as_alone(tmp_path: Path, feedback: str) -> None:
    """What led to a window is replayed for those alone whose commands moved."""
    robot = robot_of(tmp_path, spring(feedback).xml % (0.001, "implicitfast"), servo_feedback=feedback)
    lead, held = 700, np.full((1, 900, 1), 0.3)
    moved = 0.3 + 0.2 * np.sin(0.02 * np.arange(900))[None, :, None]
    command, start = np.concatenate([held, moved, held - 0.1]), np.array([0.28, 0.31, 0.19])
    soft = {("joint_compliance", None, "stiffness"): K}

    def replayed(rows: list[int]) -> np.ndarray:
        begun = {"position.shoulder": start[rows], "velocity.shoulder": np.zeros(len(rows))}
        drive = Drive(0.001, lead, command[rows], None, np.zeros(len(rows)))
        settings = settings_of(robot, *[soft] * len(rows))
        return np.asarray(robot.replay(begun, drive, settings, ("position.shoulder",))["position.shoulder"])

    together = replayed([0, 1, 2])
    np.testing.assert_allclose(together, np.concatenate([replayed([k]) for k in range(3)]), rtol=0.0, atol=1e-9)
    assert np.ptp(together, axis=1).min() > 1e-3


@pytest.mark.parametrize("sensor", ["link", "motor"])
def test_a_start_in_motion_is_known_from_the_commands_before(tmp_path: Path, sensor: str) -> None:
    """Windows cut out of a long swing with jumps, in which the spring still rings from the last one."""
    gear, rng, step = spring(sensor=sensor), np.random.default_rng(0), 0.001
    t = 0.02 * np.arange(300)
    u = sum(rng.uniform(0.1, 0.3) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.4, 0.9, 1.7))
    u = np.repeat(u + np.repeat(rng.uniform(-0.3, 0.3, 15), 20), 20)
    states = gear.driven(gear.at_rest(u[0]), u, step)
    robot = robot_of(tmp_path, gear.xml % (step, "implicitfast"), position_sensor=sensor)
    side, at, lead, steps = 1 if sensor == "link" else 0, 1000 + 410 * np.arange(10), 700, 500
    start = {"position.shoulder": states[at, side], "velocity.shoulder": states[at, 2 + side]}
    truth = np.stack([states[a : a + steps + 1, side] for a in at])
    soft = settings_of(robot, *[{("joint_compliance", None, "stiffness"): K}] * len(at))
    off = {}
    for known, midway in ((lead, False), (1, False), (lead, True)):
        command = np.stack([u[a - known : a + steps] for a in at])[:, :, None]
        drive = Drive(step, known, command, None, np.zeros(len(at)), midway=midway)
        came = robot.replay(start, drive, soft, ("position.shoulder",))["position.shoulder"]
        off[known, midway] = np.sqrt(np.mean((came - truth) ** 2))
    assert off[lead, False] < 0.003 and off[lead, False] < 0.6 * off[1, False], off
    assert off[lead, True] == off[1, False]  # by rule alone


def test_a_merged_robots_settings_are_split_alike(tmp_path: Path) -> None:
    xml = arm_xml()
    (tmp_path / "b").mkdir()
    one, other = robot_of(tmp_path, xml), robot_of(tmp_path / "b", xml.replace('kp="20"', 'kp="35"'))
    whole = one.merged([other])
    assert whole is not None
    drive, start = random_drive(one, 2, 100), random_start(one, 2)
    settings = settings_of(one, *[{("joint_compliance", "j2", "stiffness"): 20.0}] * 2)
    came = whole.replay(start, replace(drive, setting=np.array([0, 1])), settings, CHANNELS)
    for row, robot in enumerate((one, other)):
        alone = robot.replay(start, drive, settings, CHANNELS)
        np.testing.assert_array_equal(came["position.j2"][row], alone["position.j2"][row])
    sensed = robot_of(tmp_path, xml, position_sensor="motor")
    assert one.merged([sensed]) is None


def test_who_cannot_have_them(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    assert robot.slots("backlash") == robot.slots("joint_compliance") == ("j1", "j2")
    assert robot.bounds("backlash", "gap", None)[1] < 1.0 and robot.bounds("joint_compliance", "stiffness", "j1")[0] > 0
    two = arm_xml().replace('<joint name="j2"', '<joint name="roll" axis="1 0 0"/><joint name="j2"')
    assert robot_of(tmp_path, two).slots("backlash") == ("j1",)  # the others share a body
    undriven = arm_xml('<motor name="j1" joint="j1"/>')
    assert robot_of(tmp_path, undriven).slots("backlash") == ("j1",)
    closed = arm_xml().replace("<actuator>", '<equality><joint joint1="j1" joint2="j2"/></equality><actuator>')
    try:
        loop = robot_of(tmp_path, closed)
    except BadInput:
        return
    assert loop.slots("backlash") == () == loop.slots("link_length")
