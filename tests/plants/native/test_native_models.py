"""Which models have native programs, and that any chain of joints moves as in MuJoCo."""

from __future__ import annotations

from gc import collect
from unittest.mock import patch
from weakref import ref

import mujoco
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mujoco.batch import Batch
from oracles.arms import SERVOS, arm_xml
from oracles.own_arms import UR5E, panda

from plants.mujoco_robot.native import arms
from plants.mujoco_robot.native.arm import chain_of
from plants.mujoco_robot.native.arms import NativeArm, Rolled, native_arm
from plants.mujoco_robot.native.compiled import Compiled
from plants.mujoco_robot.native.eligible import _compared_bounded, _tried, agrees, alike, eligible
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot

CURVED = '<equality><joint joint1="j1" joint2="j2" polycoef="0 1 0.5 0 0"/></equality>'
CONTROL = int(mujoco.mjtState.mjSTATE_CTRL)


def tree(rng: np.random.Generator, bodies: int, coupled: bool = False) -> str:
    """A tree of turned bodies with off-centre masses; each slides, turns, does both, or is welded. coupled: two joints,
    in any branches, follow one another, one stays where it is, and a tendon with limits pulls on two."""
    specs: list[list[int]] = [[] for _ in range(bodies)]
    for b in range(1, bodies):
        specs[int(rng.integers(0, b))].append(b)

    def three(size: float) -> str:
        return " ".join(f"{x:.4f}" for x in size * rng.uniform(-1.0, 1.0, 3))

    joints: list[str] = []

    def body(b: int) -> str:
        made = ""
        for kind in (("hinge",), ("slide",), ("hinge", "hinge"), ("slide", "hinge"), ())[int(rng.integers(0, 5))] or (
            ("hinge",) if b == 0 else ()
        ):
            name = f"j{len(joints)}"
            joints.append(name)
            spring = f'stiffness="{rng.uniform(0, 5):.3f}" springref="{rng.uniform(-1, 1):.3f}"'
            ref = f'ref="{rng.uniform(-0.3, 0.3):.3f}" actuatorfrcrange="-{rng.uniform(2, 20):.2f} 9"'
            ref += f' limited="{str(bool(rng.integers(0, 2))).lower()}" range="-{rng.uniform(20, 60):.1f} 40"'
            made += (
                f'<joint name="{name}" type="{kind}" axis="{three(1.0)}" pos="{three(0.1)}" {spring} {ref}'
                f' damping="{rng.uniform(0.05, 1):.3f}" armature="{rng.uniform(0.01, 0.1):.3f}"/>'
            )
        inner = "".join(body(c) for c in specs[b])
        return (
            f'<body pos="{three(0.3)}" euler="{three(90.0)}">{made}'
            f'<geom type="box" size="0.05 0.03 0.08" pos="{three(0.1)}" euler="{three(90.0)}" mass="0.7"/>'
            f"{inner}</body>"
        )

    world = body(0)
    motors = "".join(
        f'<position joint="{j}" kp="8" kv="0.5" gear="{1 + i % 2}" forcerange="-6 6"/>' for i, j in enumerate(joints)
    )
    between = ""
    if coupled and len(joints) > 2:
        a, b, c = rng.choice(joints, 3, replace=False)
        between = (
            f'<equality><joint joint1="{a}" joint2="{b}" polycoef="0.1 {rng.uniform(-2.0, 2.0):.3f} 0 0 0"/>'
            f'<joint joint1="{c}" polycoef="-0.05 0 0 0 0" solref="0.01 1" solimp="0.8 0.9 0.1 0.3 2"/></equality>'
            f'<tendon><fixed limited="true" range="-0.3 0.4" stiffness="3" damping="{rng.uniform(0.1, 1.0):.3f}">'
            f'<joint joint="{b}" coef="0.5"/><joint joint="{c}" coef="-1.5"/></fixed></tendon>'
        )
    return (
        '<mujoco><option timestep="0.002" integrator="implicitfast" gravity="1 -2 -9"/>'
        '<default><geom contype="0" conaffinity="0"/></default>'
        f"<worldbody>{world}</worldbody><actuator>{motors}</actuator>{between}</mujoco>"
    )


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    st.integers(0, 10**6), st.integers(1, 7), st.booleans(), st.booleans(),
    st.sampled_from(["implicitfast", "Euler", "RK4"]), st.booleans(),
)  # fmt: skip
def test_any_tree_of_joints_moves_as_in_mujoco(
    seed: int, bodies: int, rubs: bool, stops: bool, integrator: str, coupled: bool
) -> None:
    xml = tree(np.random.default_rng(seed), bodies, coupled).replace('"implicitfast"', f'"{integrator}"')
    model = mujoco.MjModel.from_xml_string(xml)
    stops |= bool(model.jnt_limited.any())
    assert eligible(model)
    rubbing = tuple(range(model.ntendon)) if rubs else ()
    program = Compiled(chain_of(model, rubs, stops, rubbing))
    if coupled:  # random couplings of light joints may throw MuJoCo itself off, at any size of the motion
        assume(_compared_bounded(_tried(model, rubs, stops, rubbing), program, False) is not None)
    assert agrees(model, program, rubs, stops, rubbing)


LIGHT_LINK = """
<mujoco><option timestep="0.002"/><default><geom contype="0" conaffinity="0"/><joint armature="0.03"/></default>
  <worldbody><body pos="0 0 1">
    <joint name="motor" axis="0 1 0" damping="0.6"/><geom size="0.01" mass="0.001"/>
    <body><joint name="gear" axis="0 1 0"/><geom size="0.01" pos="0.03 0 0" mass="0.001"/></body>
  </body></worldbody>
  <actuator><position joint="motor" kp="900" forcerange="-3 3"/></actuator>
  <tendon><fixed name="play" limited="true" range="-0.01 0.01"><joint joint="gear" coef="1"/></fixed>
    <fixed name="both"><joint joint="motor" coef="1"/><joint joint="gear" coef="1"/></fixed></tendon>
</mujoco>"""


@pytest.mark.parametrize("rubbing", [(), (1,)])
def test_a_light_link_behind_a_heavy_rotor_is_tried_in_motions_that_stay_bounded(rubbing: tuple[int, ...]) -> None:
    """As a gear is split: the added joint has no rotor, though its dof_M0 still counts the defaults' one. Damping in
    proportion to that would throw the link off, and no motion could be compared."""
    model = mujoco.MjModel.from_xml_string(LIGHT_LINK)
    model.dof_armature[1] = 0.0
    rotor, link = 0.03 + 0.4 * 1e-7, 1e-3 * (0.03**2 + 0.4 * 0.01**2)  # kg m^2; spheres of 1 cm
    tried, carried = _tried(model, True, True, rubbing), np.array([rotor * link / (rotor + link), link])
    assert (tried.tendon_damping > 0.0).all()
    assert (tried.tendon_damping * model.opt.timestep < 0.01 * carried * (1.0 + 1e-6)).all()  # unstable from 2 on
    assert agrees(model, Compiled(chain_of(model, True, True, rubbing)), True, True, rubbing)


def test_friction_of_the_model_that_no_row_has_is_not_tried() -> None:
    """Friction that sits behind the gears leaves the motors without any."""
    rubbing_motor = LIGHT_LINK.replace('damping="0.6"', 'damping="0.6" frictionloss="0.03" limited="true" range="-1 1"')
    model = mujoco.MjModel.from_xml_string(rubbing_motor)
    assert model.dof_frictionloss[0] > 0.0
    assert agrees(model, Compiled(chain_of(model, False, False, (1,))), False, False, (1,))


def test_an_arm_far_from_the_origin_loses_no_digits() -> None:
    model = mujoco.MjModel.from_xml_string(arm_xml().replace('pos="0 0 1"', 'pos="300 -200 40"'))
    assert agrees(model, Compiled(chain_of(model, True, True)), True, True)


@pytest.mark.parametrize("xml", [UR5E, panda(), arm_xml()], ids=["ur5e", "panda", "two joints"])
def test_the_arms_of_the_docs_have_programs(xml: str) -> None:
    model = mujoco.MjModel.from_xml_string(xml)
    rubs, stops = bool((model.dof_frictionloss > 0.0).any()), bool(model.jnt_limited.any())
    assert eligible(model) and agrees(model, Compiled(chain_of(model, rubs, stops)), rubs, stops)


@pytest.mark.parametrize(
    ("what", "by"),
    [
        ("a fully implicit step", ('integrator="implicitfast"', 'integrator="implicit"')),
        ("a fluid", ("<option", '<option density="1.2" viscosity="0.00002"')),
        ("a body that floats", ("<worldbody>", '<worldbody><body><freejoint/><geom size="0.1" mass="1"/></body>')),
        ("contacts", ('contype="0" conaffinity="0"', 'contype="1" conaffinity="1"')),
        ("gravity compensation", ('<body name="lower"', '<body name="lower" gravcomp="1"')),
        ("a filter", ('kv="1.5" gear="2"', 'kv="1.5" gear="2" timeconst="0.1"')),
        ("a curved coupling", ("</worldbody>", f"</worldbody>{CURVED}")),
        ("a limit of mixed signs", ('range="-90 90"', 'range="-90 90" solreflimit="-100 1"')),
        ("a curved limit", ('range="-90 90"', 'range="-90 90" solimplimit="0.9 0.95 0.001 0.5 3"')),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)  # fmt: skip
def test_what_programs_do_not_know_is_left_to_mujoco(what: str, by: tuple[str, str]) -> None:
    xml = arm_xml(SERVOS)
    assert eligible(mujoco.MjModel.from_xml_string(xml))
    changed = xml.replace(*by)
    assert changed != xml
    assert not eligible(mujoco.MjModel.from_xml_string(changed))


def rolled(model: mujoco.MjModel, native: NativeArm) -> tuple[np.ndarray, Rolled | None]:
    """Positions (rows, K, n) of MuJoCo's, and of the programs."""
    rng, rows, steps = np.random.default_rng(2), 11, 60
    u = rng.uniform(-1.0, 1.0, (rows, steps, model.nu))
    batch = Batch(model, rows, nthread=1)
    batch.reset()
    q = 0.3 * rng.normal(size=(rows, model.nq))
    batch.bind("qpos")[:] = q
    found = native.rollout(batch, u, (0,), 1, lambda k: None)
    np.testing.assert_array_equal(batch.bind("qpos"), q)
    return batch.rollout(steps, u, CONTROL, ("qpos",))["qpos"], found


def test_a_program_that_disagrees_is_not_used() -> None:
    model = mujoco.MjModel.from_xml_string(arm_xml())
    _, found = rolled(model, NativeArm(model))
    assert found is not None
    with patch.object(arms, "agrees", lambda *_: False):
        assert rolled(model, NativeArm(model))[1] is None


def test_the_check_sees_a_wrong_program() -> None:
    """One that was made for other gears, joints or stops does not pass."""
    model = mujoco.MjModel.from_xml_string(arm_xml())
    assert agrees(model, Compiled(chain_of(model, True, True)), True, True)
    for change in ("actuator_gear", "jnt_axis", "body_quat"):
        other = mujoco.MjModel.from_xml_string(arm_xml())
        getattr(other, change)[-1] = np.roll(getattr(other, change)[-1], 1) + 0.1
        assert not agrees(model, Compiled(chain_of(other, True, True)), True, True)
    assert not agrees(model, Compiled(chain_of(model, True, False)), True, True)


def test_both_translations_give_the_same_bits() -> None:
    model = mujoco.MjModel.from_xml_string(arm_xml())
    native = NativeArm(model)
    _, quick = rolled(model, native)
    for program in native._plain.values():
        assert program is not None
        program._spent = 2.0 * program._worth
    _, better = rolled(model, native)
    assert all(program is not None and program._better for program in native._plain.values())
    assert quick is not None and better is not None
    np.testing.assert_array_equal(quick.positions, better.positions)
    np.testing.assert_array_equal(quick.velocities, better.velocities)


def test_rows_whose_solver_does_not_converge_are_marked() -> None:
    xml = arm_xml().replace('frictionloss="0.02"', 'frictionloss="0.3"')
    model = mujoco.MjModel.from_xml_string(xml)
    by_mujoco, found = rolled(model, NativeArm(model))
    assert found is not None and found.exact.all()
    np.testing.assert_allclose(found.positions[:, 1:], by_mujoco, atol=1e-6)
    with (
        patch("plants.mujoco_robot.native.step.MOST", 2),
        patch.object(arms, "compiled", Compiled),
        patch.object(arms, "agrees", lambda *_: True),
    ):
        _, impatient = rolled(model, NativeArm(model))
    assert impatient is not None
    assert 0 < impatient.exact.sum() < len(impatient.exact)
    np.testing.assert_array_equal(impatient.positions[impatient.exact], found.positions[impatient.exact])


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_joint_at_the_end_of_its_torque_has_no_servos_damping(sign: float) -> None:
    """Under commands that saturate its range and such as do not, which the check has to draw."""
    servo = '<position name="j2" joint="j2" kp="60" kv="3"/>'
    xml = arm_xml(servo).replace('damping="0.05"', 'damping="0.05" actuatorfrcrange="-90 90"')
    model = mujoco.MjModel.from_xml_string(xml)
    assert eligible(model) and agrees(model, Compiled(chain_of(model, True, True)), True, True)
    rows, steps = 3, 80
    batch = Batch(model, rows, nthread=1)
    batch.reset()
    u = np.full((rows, steps, 1), sign) * np.array([0.5, 3.0, 6.0])[:, None, None]
    found = NativeArm(model).rollout(batch, u, (0,), 1, lambda k: None)
    assert found is not None
    np.testing.assert_allclose(found.positions[:, 1:], batch.rollout(steps, u, CONTROL, ("qpos",))["qpos"], atol=1e-6)


def test_models_that_differ_in_more_than_the_rows_numbers_are_left_to_mujoco() -> None:
    one, other = (mujoco.MjModel.from_xml_string(arm_xml()) for _ in range(2))
    assert alike([one, other], ("body_mass", "geom_pos", "dof_M0", "actuator_gainprm"))
    for field in ("body_quat", "jnt_type", "actuator_biastype", "tendon_armature", "wrap_prm", "jnt_margin"):
        assert not alike([one, other], ("body_mass", field))
    other.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    assert not alike([one, other], ())


def test_a_robot_that_is_gone_takes_its_programs_along() -> None:
    model = mujoco.MjModel.from_xml_string(arm_xml())
    robot = CompiledRobot("arm", model, (2, np.zeros(3)), "motor", "motor")
    assert native_arm(robot) is not None and robot in arms._ARMS
    gone = ref(robot)
    del robot
    collect()
    assert gone() is None


def test_without_a_compiler_mujoco_replays() -> None:
    model = mujoco.MjModel.from_xml_string(arm_xml())
    robot = CompiledRobot("arm", model, (2, np.zeros(3)), "motor", "motor")
    for error in (ImportError("no llvmlite"), OSError("a library is missing"), RuntimeError("unknown processor")):
        arms._compiles.cache_clear()
        with patch("plants.mujoco_robot.native.compiled.engine_of", side_effect=error):
            assert native_arm(robot) is None
        arms._ARMS.pop(robot)
    arms._compiles.cache_clear()
    assert native_arm(robot) is not None
