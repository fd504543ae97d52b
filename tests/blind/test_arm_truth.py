"""The arm's truth: close to the nominal model without an effect, and frictions that hold as promised."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from plants.blind_families.arm.effects import ArmSensor
from plants.blind_families.arm.model import Arm, compiled, draw_arm, mjcf
from plants.blind_families.arm.motions import multisine
from plants.blind_families.arm.runs import ReferenceMotion, play, read
from plants.blind_families.arm.surroundings import Surroundings
from plants.blind_families.arm.truth import STEP, Stepper, ideal
from residual_mpc.blind.families import make_case


def one_joint(**more) -> Arm:
    """A yawing link that gravity does not move: the torque is what the actuator gives."""
    a = np.ones(1)
    given = {
        "axes": ("z",),
        "length": 0.3 * a,
        "mass": a,
        "radius": 0.03 * a,
        "armature": 0.05 * a,
        "damping": 0 * a,
        "kind": "torque",
        "kp": a,
        "kv": a,
        "home": 0 * a,
    }
    return Arm(**{**given, **more})


def pushed(truth, torque, seconds, rise=0.0):
    """Angle (rad) and speed after a torque from rest, constant once it rose for ``rise`` seconds."""
    stepper = Stepper(truth, np.zeros((1, 1)), np.zeros((1, 1)), np.full((1, 1), torque), np.zeros(1))
    for i in range(round(seconds / STEP)):
        now = torque * min(1.0, i * STEP / rise) if rise else torque
        stepper.step(np.full((1, 1), now), np.ones((1, 1)))
    return float(stepper.q[0, 0]), float(stepper.v[0, 0])


@pytest.mark.parametrize("seed", [1, 3, 5])
def test_without_an_effect_the_nominal_model_is_closer_than_an_encoder_sees(seed):
    rng = np.random.default_rng(seed)
    arm = draw_arm(rng)
    n = len(arm.axes)
    t = np.round(np.arange(0, 3.0001, 0.01) / STEP) * STEP
    reference = (arm.home + multisine(t, n, rng))[None]
    happened = play(ideal(arm), ReferenceMotion(t, reference, np.ones_like(reference), 0.0))
    assert happened is not None
    sensor = ArmSensor(np.zeros(n), np.zeros(n), np.zeros(n))
    seen = happened.seen(t, sensor)[0]
    speed = happened.speed(t, sensor)[0]
    model = mujoco.MjModel.from_xml_string(mjcf(arm))
    data = mujoco.MjData(model)
    errors = []
    for begin in (0, 100):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = seen[begin], speed[begin]
        for k in range(begin, begin + 100):
            data.ctrl[:] = happened.command[0, k]
            for _ in range(round(0.01 / model.opt.timestep)):
                mujoco.mj_step(model, data)
            errors.append(data.qpos - seen[k + 1])
    assert np.sqrt(np.mean(np.square(errors))) < 0.8e-3  # rad: the least noise that is drawn


def test_dry_friction_holds_below_its_level_and_takes_that_much_above():
    truth = replace(ideal(one_joint()), static=np.full(1, 0.2), kinetic=np.full(1, 0.2))
    held, _ = pushed(truth, 0.15, 1.0, rise=0.5)
    assert 1e-4 < abs(held) < 1e-3  # bristles bend
    _, speed = pushed(truth, 0.5, 0.5)
    inertia = 1.0 / pushed(ideal(one_joint()), 1.0, 1.0)[1]
    assert speed == pytest.approx((0.5 - 0.2) * 0.5 / inertia, rel=0.02)


def test_stribeck_friction_breaks_away_at_its_static_level_and_then_lets_go():
    truth = replace(ideal(one_joint()), static=np.full(1, 0.3), kinetic=np.full(1, 0.1), stribeck=np.full(1, 0.1))
    assert abs(pushed(truth, 0.27, 1.0, rise=0.5)[0]) < 2e-3
    inertia = 1.0 / pushed(ideal(one_joint()), 1.0, 1.0)[1]
    early, late = pushed(truth, 0.5, 0.4)[1], pushed(truth, 0.5, 0.8)[1]
    assert (late - early) * inertia / 0.4 == pytest.approx(0.4, rel=0.03)


def test_load_dependent_friction_is_a_share_of_the_torque():
    truth = replace(ideal(one_joint()), load=np.full(1, 0.3))
    inertia = 1.0 / pushed(ideal(one_joint()), 1.0, 1.0)[1]
    assert pushed(truth, 1.0, 0.5)[1] * inertia / 0.5 == pytest.approx(0.7, rel=0.02)


def test_a_delay_off_the_grid_loses_its_time():
    truth = replace(ideal(one_joint()), delay=np.full(1, 0.0123))
    stepper = Stepper(truth, np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1))
    for _ in range(round(0.5 / STEP)):
        stepper.step(np.ones((1, 1)), np.ones((1, 1)))
    full = pushed(ideal(one_joint()), 1.0, 0.5)[1]
    assert float(stepper.v[0, 0]) == pytest.approx(full * (0.5 - 0.0123) / 0.5, rel=1e-3)


def test_an_actuator_that_is_off_gives_nothing():
    stepper = Stepper(ideal(one_joint()), np.zeros((1, 1)), np.zeros((1, 1)), np.ones((1, 1)), np.zeros(1))
    for _ in range(100):
        stepper.step(np.ones((1, 1)), np.zeros((1, 1)))
    assert float(stepper.q[0, 0]) == 0.0


def test_added_masses_and_armature_are_in_the_compiled_bodies():
    arm = draw_arm(np.random.default_rng(4))
    n = len(arm.axes)
    changed = replace(ideal(arm), payload=0.2, link_mass=np.eye(n)[0] * 0.1, armature=np.eye(n)[1] * 0.03)
    plain, loaded = compiled(ideal(arm), arm), compiled(changed, arm)
    assert loaded.body_mass.sum() - plain.body_mass.sum() == pytest.approx(0.3)
    assert (loaded.dof_armature - plain.dof_armature)[1] == pytest.approx(0.03)
    shifted = compiled(replace(ideal(arm), link_com=np.eye(n)[0] * 0.05), arm)
    assert (shifted.body_ipos - plain.body_ipos)[1, 0] == pytest.approx(0.05)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_arm_and_runs(tmp_path):
    answers = [make_case("arm", "single", 2, tmp_path / name) for name in "ab"]
    assert answers[0] == answers[1]
    a, b = (sorted((tmp_path / n / "case").iterdir()) for n in "ab")
    assert [p.read_bytes() for p in a] == [p.read_bytes() for p in b]


def test_a_link_waits_until_its_motor_has_crossed_the_play():
    arm = one_joint()
    loose, torque, seconds = replace(ideal(arm), play=np.full(1, 0.04)), 0.5, 0.05
    crossing = np.sqrt(0.04 * arm.armature[0] / torque)  # s: half the play under the rotor's own acceleration
    assert abs(pushed(loose, torque, 0.9 * crossing)[0]) == 0.0
    assert pushed(loose, torque, crossing + seconds)[0] > 1e-3
    together = pushed(ideal(arm), torque, 1.0)[1]
    assert pushed(loose, torque, 1.0)[1] == pytest.approx(together, rel=0.05)  # what both carry is the same in the end


def test_a_spring_rings_at_its_own_frequency_and_carries_the_link():
    soft = replace(ideal(one_joint()), stiffness=np.full(1, 20.0), wound=np.full(1, 10.0))
    stepper = Stepper(soft, np.zeros((1, 1)), np.zeros((1, 1)), np.full((1, 1), 0.5), np.zeros(1))
    wound = []
    for _ in range(round(4.0 / STEP)):
        stepper.step(np.full((1, 1), 0.5), np.ones((1, 1)))
        wound.append(float(stepper.rotors.angle[0, 0] - stepper.q[0, 0]))
    rotor, link = stepper.rotors.law.rotor[0], stepper.rotors.law.link[0]
    carried = 0.5 * link / (rotor + link) / 20.0  # rad, once it rings no more
    assert wound[-1] == pytest.approx(carried, rel=0.02)
    rising = [i for i in range(1, len(wound)) if wound[i - 1] < carried <= wound[i]]
    period = 2 * np.pi * np.sqrt(rotor * link / (rotor + link) / 20.0)
    assert (rising[1] - rising[0]) * STEP == pytest.approx(period, rel=0.02)


def test_a_longer_link_holds_the_next_joint_farther_out():
    arm = draw_arm(np.random.default_rng(4))
    plain, longer = (compiled(replace(ideal(arm), longer=x * np.eye(len(arm.axes))[0]), arm) for x in (0.0, 0.07))
    np.testing.assert_allclose((longer.body_pos - plain.body_pos)[2], [0.07, 0.0, 0.0], atol=1e-12)
    assert np.abs(np.delete(longer.body_pos - plain.body_pos, 2, axis=0)).max() == 0.0
    np.testing.assert_array_equal(longer.body_inertia, plain.body_inertia)


def test_a_long_tool_weighs_on_the_joints_beyond_its_site():
    arm = draw_arm(np.random.default_rng(4))
    short, long = (compiled(replace(ideal(arm), payload=0.4, ahead=x), arm) for x in (0.0, 0.1))
    bare = compiled(ideal(arm), arm)
    moments = [m.body_mass[-1] * m.body_ipos[-1, 0] for m in (bare, short, long)]
    assert moments[1] - moments[0] == pytest.approx(0.4 * arm.length[-1], rel=1e-6)
    assert moments[2] - moments[1] == pytest.approx(0.4 * 0.1, rel=1e-6)


def test_a_ripple_is_a_flattened_wave_with_the_stated_first_harmonic():
    beside = Surroundings(ripple=0.3 * np.ones(1), cycles=7.5 * np.ones(1), phase=0.4 * np.ones(1))
    q = np.linspace(0.0, 2 * 2 * np.pi / 7.5, 4001)[:-1, None]
    pull = beside.pull(q, 0 * q)[:, 0]
    wave = np.sin(7.5 * q[:, 0] + 0.4)
    assert 2 * np.mean(pull * wave) == pytest.approx(0.3, rel=1e-6)
    assert 0.1 < np.std(pull - 0.3 * wave) / np.std(pull) < 0.3  # the candidate's law is another one


def test_an_integral_part_carries_the_load_and_forgets_when_off():
    """A weight on a lever of 0.5 m: without an integral part it sags, with one it ends where it is told."""
    a, one = np.ones(1), np.ones((1, 1))
    truth = ideal(one_joint(axes=("y",), kind="position", kp=30 * a, kv=6 * a, length=0.5 * a))
    ends = []
    for gain in (0.0, 2.0):
        told = replace(truth, beside=Surroundings(integral=gain * np.ones(1)))
        stepper = Stepper(told, 0.0 * one, 0.0 * one, 0.0 * one, np.zeros(1))
        begun = stepper.trim.copy()
        for _ in range(round(4.0 / STEP)):
            stepper.step(0.5 * one, one)
        ends.append(float(stepper.q[0, 0]))
        if gain:
            assert abs(begun[0, 0]) > 0.05
            for _ in range(round(0.3 / STEP)):
                stepper.step(0.5 * one, 0.0 * one)
            assert abs(stepper.trim[0, 0]) < 0.01 * abs(begun[0, 0])
    assert abs(ends[0] - 0.5) > 0.05 and ends[1] == pytest.approx(0.5, abs=0.01)


def test_encoders_behind_a_filter_lag_by_its_constant_and_a_worn_scale_is_uneven():
    t = STEP * np.arange(4001)
    q = (0.4 * t)[None, :, None] * np.ones((1, 1, 2)) - 0.3  # rad, at 0.4 rad/s
    late = read(q, ArmSensor(np.zeros(2), np.zeros(2), np.zeros(2), lag=np.array([0.0, 0.08])))
    np.testing.assert_array_equal(late[:, :, 0], q[:, :, 0])
    assert late[0, 0, 1] == pytest.approx(q[0, 0, 1])  # at rest before
    assert q[0, -1, 1] - late[0, -1, 1] == pytest.approx(0.4 * 0.08, rel=0.01)
    worn = read(q, ArmSensor(np.zeros(2), np.zeros(2), np.zeros(2), scale=np.array([1.1, 1.0])))
    np.testing.assert_array_equal(worn[:, :, 1], q[:, :, 1])
    ratio = worn[0, [0, -1], 0] / q[0, [0, -1], 0]
    assert 1.09 < ratio[0] < 1.1 < ratio[1] < 1.11
