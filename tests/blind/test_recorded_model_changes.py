"""What the model loses, the robot has gained: the edited model with the change put back moves as the original does."""

import mujoco
import numpy as np
import pytest
from recorded_robots import ARM, GEOMETRY, arm, rover

from residual_mpc.blind.recorded.kinds.body import CARRIED, LENGTH, LINK
from residual_mpc.blind.recorded.kinds.drive import RADIUS, TRACK
from residual_mpc.blind.recorded.kinds.joint import DAMPING, DRY, FORCE, ROTOR, STIFFNESS
from residual_mpc.blind.recorded.kinds.library import carried_by
from residual_mpc.blind.recorded.mjcf import parse
from residual_mpc.errors import BadInput

RNG = np.random.default_rng(0)
SPHERE = """<mujoco><worldbody><body name="arm"><joint name="shaft" axis="0 1 0"/>
<geom type="sphere" size="0.02" pos="0 0 -0.1" mass="0.49" contype="0" conaffinity="0"/>
<site name="tip" pos="0 0 -0.1"/>
</body></worldbody><actuator><motor name="servo" joint="shaft"/></actuator></mujoco>"""


def edited(kind, target, sizes, model=ARM):
    return kind.apply(arm(model), target, sizes, RNG).settings[0].model


def with_body(text, parent, at, mass):
    """The model with a small heavy body welded on, by MuJoCo's own editor."""
    spec = mujoco.MjSpec.from_string(text)
    body = spec.body(parent).add_body(pos=at)
    body.mass, body.ipos, body.inertia, body.explicitinertial = mass, [0, 0, 0], [1e-12] * 3, True
    return spec.compile()


def swung(model, torque=None, seconds=1.0):
    """Positions over a motion from rest; torque(velocity): applied at the joints besides."""
    data, out = mujoco.MjData(model), []
    for k in range(round(seconds / model.opt.timestep)):
        t = k * model.opt.timestep
        data.ctrl[:] = [np.sin(7 * t), 0.8 * np.cos(5 * t)][: model.nu]
        if torque is not None:
            data.qfrc_applied[:] = torque(data.qvel)
        mujoco.mj_step(model, data)
        out.append(data.qpos.copy())
    return np.array(out)


ORIGINAL = mujoco.MjModel.from_xml_string(ARM)


@pytest.mark.parametrize("mass", [0.1, 0.002])
def test_a_payload_that_the_model_lacks(mass):
    whole = with_body(edited(CARRIED, None, {"mass": mass}), "lower", [0, 0, -0.2], mass)
    np.testing.assert_allclose(swung(whole), swung(ORIGINAL), atol=1e-8)


def test_a_payload_that_the_model_is_given():
    given = mujoco.MjModel.from_xml_string(edited(CARRIED, None, {"mass": -0.2}))
    np.testing.assert_allclose(swung(given), swung(with_body(ARM, "lower", [0, 0, -0.2], 0.2)), atol=1e-8)
    assert np.abs(swung(given) - swung(ORIGINAL)).max() > 0.01


def test_a_body_whose_mass_is_that_of_a_sphere():
    whole = with_body(edited(CARRIED, None, {"mass": 0.15}, SPHERE), "arm", [0, 0, -0.1], 0.15)
    np.testing.assert_allclose(swung(whole), swung(mujoco.MjModel.from_xml_string(SPHERE)), atol=1e-8)


def test_the_mass_of_a_link():
    at = ORIGINAL.body("upper").ipos
    whole = with_body(edited(LINK, "upper", {"mass": 0.3}), "upper", at, 0.3)
    np.testing.assert_allclose(swung(whole), swung(ORIGINAL), atol=1e-8)


def test_the_length_of_a_link_by_the_equations_of_a_double_pendulum():
    model = mujoco.MjModel.from_xml_string(edited(LENGTH, "upper", {"offset": 0.04}))
    data = mujoco.MjData(model)
    data.qpos[1] = 0.7
    mujoco.mj_forward(model, data)
    found = np.zeros((2, 2))
    mujoco.mj_fullM(model, data, found)
    m2, c2, length = 0.5, 0.12, 0.3 - 0.04
    # coupling of a planar double pendulum: I2 + m2 (c2^2 + L c2 cos q2), the rest as it was
    own = ORIGINAL.body("lower").inertia
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, ORIGINAL.body("lower").iquat)
    about = (turn.reshape(3, 3) @ np.diag(own) @ turn.reshape(3, 3).T)[1, 1]
    assert found[0, 1] == pytest.approx(about + m2 * (c2**2 + length * c2 * np.cos(0.7)), rel=1e-6)
    np.testing.assert_allclose(model.body_mass, ORIGINAL.body_mass)


@pytest.mark.parametrize("sign", [1, -1])
def test_damping_of_a_joint(sign):
    size = 0.2 * sign
    model = mujoco.MjModel.from_xml_string(edited(DAMPING, "elbow", {"coefficient": size}))
    put_back = swung(model, lambda w: np.array([0.0, -size * w[1]]))
    # the force put back acts a step of 0.5 ms late
    np.testing.assert_allclose(put_back, swung(ORIGINAL), atol=2e-3)
    assert np.abs(swung(model) - swung(ORIGINAL)).max() > 0.02


def test_dry_friction_of_a_joint_in_steady_motion():
    def settled(model, extra):
        """The speed that a constant torque reaches against damping and friction, gravity off."""
        model.opt.gravity[:] = 0
        model.actuator_gainprm[0, 0] = model.actuator_biasprm[0, 1:] = 0.0
        data = mujoco.MjData(model)
        for _ in range(8000):
            data.qfrc_applied[:] = [0.0, 0.9 + extra]
            mujoco.mj_step(model, data)
        return data.qvel[1]

    model = mujoco.MjModel.from_xml_string(edited(DRY, "elbow", {"torque": -0.25}))
    # what the model was given in friction takes as much torque to overcome
    original = settled(mujoco.MjModel.from_xml_string(ARM), 0.0)
    assert settled(model, 0.25) == pytest.approx(original, rel=1e-3)


def test_a_rotor():
    model = mujoco.MjModel.from_xml_string(edited(ROTOR, "shoulder", {"inertia": 0.015}))
    masses = []
    for m in (model, ORIGINAL):
        data, full = mujoco.MjData(m), np.zeros((2, 2))
        mujoco.mj_forward(m, data)
        mujoco.mj_fullM(m, data, full)
        masses.append(full)
    np.testing.assert_allclose(masses[1] - masses[0], np.diag([0.015, 0.0]), atol=1e-12)
    with pytest.raises(BadInput, match="to lose"):
        edited(ROTOR, "shoulder", {"inertia": 0.03})


@pytest.mark.parametrize("target", [None, "m1", "m2"])
def test_the_gain_of_an_actuator_weighs_its_law_and_leaves_its_limit(target):
    limited = ARM.replace('gear="2"', 'gear="2" forcerange="-0.5 0.5"')
    model = mujoco.MjModel.from_xml_string(edited(FORCE, target, {"gain": 1.25}, limited))
    g1, g2 = (1.25 if target in (None, a) else 1.0 for a in ("m1", "m2"))
    rng = np.random.default_rng(2)
    for _ in range(20):
        q, w, u = rng.uniform(-0.2, 0.2, 2), rng.uniform(-1, 1, 2), rng.uniform(-1, 1, 2)
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], data.ctrl[:] = q, w, u
        mujoco.mj_forward(model, data)
        servo = np.clip((30 * (u[0] - q[0]) - 1.2 * w[0]) / g1, -4, 4)
        motor = 2 * np.clip(u[1] / g2, -0.5, 0.5)
        np.testing.assert_allclose(data.qfrc_actuator, [servo, motor], atol=1e-12)


def test_the_stiffness_of_a_servo_leaves_its_damping_and_its_limit():
    model = mujoco.MjModel.from_xml_string(edited(STIFFNESS, "m1", {"gain": 1.5}))
    data = mujoco.MjData(model)
    for q, w, u in ((0.1, 0.5, 0.15), (-0.2, -1.0, -0.1), (0.0, 0.0, 1.0)):
        data.qpos[0], data.qvel[0], data.ctrl[0] = q, w, u
        mujoco.mj_forward(model, data)
        assert data.actuator_force[0] == pytest.approx(np.clip(30 / 1.5 * (u - q) - 1.2 * w, -4, 4))


def test_the_geometry_of_a_rover():
    assert RADIUS.apply(rover(), None, {"scale": 1.25}, RNG).settings[0].parameters == {
        **GEOMETRY, "wheel_radius": pytest.approx(0.08),
    }  # fmt: skip
    assert TRACK.apply(rover(), None, {"scale": 0.8}, RNG).settings[0].parameters == {
        **GEOMETRY, "track_width": pytest.approx(0.625),
    }  # fmt: skip


def test_every_drawn_change_of_a_model_compiles():
    half, rng = arm(), np.random.default_rng(3)
    for kind, targets in carried_by(half):
        for target in targets:
            for strength in (0.02, 0.5, 0.98):
                changed = kind.apply(half, target, kind.size(half, target, strength, rng), rng)
                mujoco.MjModel.from_xml_string(changed.settings[0].model)


def test_defaults_come_from_the_classes_of_an_element():
    model = parse(ARM)
    shoulder = model.joint("shoulder")
    assert model.number(shoulder, "armature", 0.0) == 0.02 and model.number(shoulder, "damping", 0.0) == 0.3
    np.testing.assert_array_equal(model.numbers(model.actuator("m1"), "forcerange", ()), [-4, 4])
    assert model.number(model.actuator("m2"), "kp", 1.0) == 1.0


@pytest.mark.parametrize(
    ("text", "why"),
    [("<mujoco", "not valid XML"), ("<robot/>", "must be MJCF"), ("<mujoco><include file='a'/></mujoco>", "includes")],
)
def test_models_that_cannot_be_edited(text, why):
    with pytest.raises(BadInput, match=why):
        parse(text)
