"""The SCALER arm as it really is: its model without an effect, its loop closed, its effects where they belong."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from answers import answer

from plants.blind_families.arm.effects import ArmRobot, ArmSensor
from plants.blind_families.arm.motions import multisine, steps
from plants.blind_families.arm.runs import ReferenceMotion, play
from plants.blind_families.arm.setting import Setting
from plants.blind_families.arm.truth import STEP, Stepper, ideal
from plants.blind_families.scaler.effects import PLANTINGS
from plants.blind_families.scaler.family import FAMILY, ScalerBench
from plants.blind_families.scaler.model import CARRIED, FOREARM, ScalerArm, compiled
from plants.blind_families.scaler.setting import inertia_at_home
from plants.blind_families.sensing import Roughness
from plants.scaler_arm.engines.mjcf import mjcf
from plants.scaler_arm.kinematics.forward import jacobian
from plants.scaler_arm.kinematics.geometry import MOTORS
from plants.scaler_arm.robot import build
from residual_mpc.blind.families import make_case
from residual_mpc.blind.make import MakeSettings, _plan
from residual_mpc.blind.score.match import where
from residual_mpc.errors import BadInput
from residual_mpc.models.robot_file import RobotFile

ARM = ScalerArm()
N = len(MOTORS)
PERFECT = ArmSensor(np.zeros(N), np.zeros(N), np.zeros(N))


def commanded(motion, seconds=3.0):
    t = np.round(np.arange(0, seconds + 1e-4, 0.01) / STEP) * STEP
    reference = (ARM.home + 0.7 * motion(t, N, np.random.default_rng(5)))[None]
    return ReferenceMotion(t, reference, np.ones_like(reference), 0.0)


def bench(effects=()):
    one = np.ones(N)
    robot = ArmRobot(ideal(ARM), PERFECT, one, 0.3 * one, 0.4 * one, inertia_at_home(ARM), one, one, -one)
    setting = Setting(robot, commanded(multisine), 5e-4 * one, 0.0, Roughness(), False, 0.01, False, "csv")
    return ScalerBench(setting, effects)


def settled(truth, seconds=1.5):
    """Angles (6,) rad at which the arm comes to rest under its home command."""
    home = ARM.home[None]
    stepper = Stepper(truth, home, 0 * home, home, np.zeros(1))
    for _ in range(round(seconds / STEP)):
        stepper.step(home, np.ones_like(home))
    assert np.abs(stepper.v).max() < 1e-4
    return stepper.q[0]


@pytest.mark.parametrize("motion", [multisine, steps])
def test_without_an_effect_the_model_is_closer_than_an_encoder_sees(motion):
    told = commanded(motion)
    happened = play(ideal(ARM), told)
    assert happened is not None
    seen, speed = happened.seen(told.t, PERFECT)[0], happened.speed(told.t, PERFECT)[0]
    model = mujoco.MjModel.from_xml_string(mjcf())
    data = mujoco.MjData(model)
    rigid = ARM.rigid(ideal(ARM))
    errors = []
    for begin in (0, 100, 200):
        mujoco.mj_resetData(model, data)
        data.qpos[rigid.motors], data.qvel[rigid.motors] = seen[begin], speed[begin]
        rigid.close(data.qpos[None], data.qvel[None])
        for k in range(begin, begin + 100):
            data.ctrl[:] = happened.command[0, k]
            for _ in range(round(0.01 / model.opt.timestep)):
                mujoco.mj_step(model, data)
            errors.append(data.qpos[rigid.motors] - seen[k + 1])
    assert np.sqrt(np.mean(np.square(errors))) < 4e-4  # rad: the least noise that is drawn


def test_the_loop_stays_closed_while_the_arm_moves():
    told = commanded(multisine)
    truth = replace(ideal(ARM), payload=0.15)
    stepper = Stepper(truth, told.reference[:, 0], 0 * told.reference[:, 0], told.reference[:, 0], np.zeros(1))
    model = compiled(truth, ARM)
    data, apart = mujoco.MjData(model), []
    for k in range(len(told.t) - 1):
        for _ in range(round(0.01 / STEP)):
            stepper.step(told.reference[:, k], told.on[:, k])
        data.qpos[:] = stepper.all_q[0]
        mujoco.mj_kinematics(model, data)
        apart.append(np.linalg.norm(data.site("loop_b").xpos - data.site("loop_e").xpos))
    assert max(apart) < 1e-4  # m


def test_added_masses_are_in_the_compiled_bodies():
    mass, com = np.zeros(N), np.zeros(N)
    mass[FOREARM], com[FOREARM] = 0.1, 0.03
    plain = compiled(ideal(ARM), ARM)
    loaded = compiled(replace(ideal(ARM), payload=0.2, link_mass=mass), ARM)
    assert loaded.body_mass.sum() - plain.body_mass.sum() == pytest.approx(0.3)
    moved = compiled(replace(ideal(ARM), link_com=com), ARM)
    shift = moved.body("e").ipos - plain.body("e").ipos
    np.testing.assert_allclose(shift, [0.03, 0, 0], atol=1e-12)
    with pytest.raises(ValueError, match="only link e"):
        compiled(replace(ideal(ARM), link_mass=np.eye(N)[0]), ARM)


def test_a_payload_bends_the_servos_by_its_weight_through_the_jacobian():
    mass = 0.1
    bare, loaded = settled(ideal(ARM)), settled(replace(ideal(ARM), payload=mass))
    expected = jacobian(0.5 * (bare + loaded))[:3].T @ np.array([0, 0, -9.81 * mass]) / ARM.kp
    np.testing.assert_allclose(loaded - bare, expected, atol=3e-5)  # rad


def test_servos_stop_where_the_model_says():
    home = ARM.home[None]
    stepper = Stepper(ideal(ARM), home, 0 * home, home, np.zeros(1))
    stepper.step(home + 0.4, np.ones_like(home))  # 24 N m, were there no stop
    np.testing.assert_allclose(stepper.torque, ARM.arm.servo.torque)


@pytest.mark.parametrize("effect", sorted(PLANTINGS))
def test_every_effect_that_is_drawn_has_a_candidate_where_it_sits(effect):
    robot, drawn = build(RobotFile("scaler_arm", "scaler_arm")), bench((effect,))
    for seed in range(4):
        draw = drawn.draw(effect, np.random.default_rng(seed))
        target, (planted, parameters) = drawn.target(draw), drawn.plant(drawn.robot, draw, 0.2)
        places = robot.slots(effect)
        assert places if target is None else target in places or target.removeprefix("position.") in places
        assert parameters and repr(planted) != repr(drawn.robot)


def test_a_score_knows_the_arm_by_its_motors():
    truth = answer(("coulomb_friction", "f"), family="scaler", notes=bench().notes)
    assert where(truth, "coulomb_friction", None) == frozenset(MOTORS)
    assert where(truth, "sensor_bias", "f") == where(truth, "sensor_bias", "position.f")
    assert CARRIED[FOREARM] in where(truth, "link_mass", "e")


def test_levels_that_the_family_leaves_out_are_not_planned(tmp_path):
    assert "withheld" not in FAMILY.levels
    planned = _plan(MakeSettings(("wheeled", "scaler"), ("single", "withheld"), cases=2))
    assert sorted((family, level) for _, family, level, _ in planned) == [
        *[("scaler", "single")] * 2,
        *[("wheeled", "single")] * 2,
        *[("wheeled", "withheld")] * 2,
    ]
    with pytest.raises(BadInput, match="withheld"):
        MakeSettings(("scaler",), ("withheld",))
    with pytest.raises(BadInput, match="Its levels: single"):
        make_case("scaler", "withheld", 1, tmp_path)
    assert not any(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("level", FAMILY.levels)
def test_every_level_makes_a_case_and_the_same_seed_the_same_one(level, tmp_path):
    answers = [make_case("scaler", level, 2, tmp_path / name) for name in "ab"]
    assert answers[0] == answers[1]
    a, b = (sorted((tmp_path / n / "case").iterdir()) for n in "ab")
    assert len(a) == 5  # robot file and four runs
    assert [p.read_bytes() for p in a] == [p.read_bytes() for p in b]
