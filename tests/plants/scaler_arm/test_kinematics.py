"""The arm's kinematics: the loop closes to rounding, every library agrees, the inverse is the inverse."""

from __future__ import annotations

import casadi
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from postures import HIGH, LOW, anywhere, literal_frames, point

from plants.scaler_arm.kinematics.five_bar import LEAST_SINE, margin, passive_rates
from plants.scaler_arm.kinematics.forward import (
    chain,
    columns,
    forward_kinematics,
    jacobian,
    passive_angles,
    posture,
    task_velocity,
    tool_point,
    velocity,
    velocity_by_jacobian,
)
from plants.scaler_arm.kinematics.geometry import HOME, SCALER
from plants.scaler_arm.kinematics.inverse import Unreachable, angles_of, inverse_kinematics
from residual_mpc.effects.ops import NUMPY, casadi_ops, jax_ops

ROUNDING = 1e-14  # m: a few units in the last place of half a metre, through a dozen operations
EPS = 1e-6


def test_the_loop_closes_to_rounding_and_the_tool_is_where_the_table_says() -> None:
    q = anywhere(500)
    tool, frame = forward_kinematics(q)
    for row, passive in enumerate(passive_angles(q)):
        links = literal_frames(q[row], passive)
        gap = point(links["b"], SCALER.on_b) - point(links["e"], SCALER.on_e)
        assert np.abs(gap).max() < ROUNDING
        np.testing.assert_allclose(tool[row], point(links["gripper"], SCALER.tool), rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(frame[row], links["gripper"][:3, :3], rtol=0, atol=1e-14)


def test_at_zero_angles_the_published_loop_is_closed() -> None:
    """The figures of the source are rounded to 1e-5: so far off may the passive joints be."""
    np.testing.assert_allclose(passive_angles(np.zeros(6)), 0.0, atol=2e-5)


def test_the_limits_keep_the_linkage_off_its_singularities() -> None:
    a, f = np.meshgrid(np.linspace(LOW[1], HIGH[1], 60), np.linspace(LOW[2], HIGH[2], 60))
    assert np.sqrt(margin(NUMPY, chain().bar, a, f)).min() > LEAST_SINE
    q = np.zeros((a.size, 6))
    q[:, 1], q[:, 2] = a.ravel(), f.ravel()
    passive = passive_angles(q)
    assert np.abs(passive).max() < 1.4  # no rod turns over
    centre = posture(NUMPY, chain(), list(q.T)).wrist_centre
    assert centre[0].min() > 0.01  # the wrist stays outside the shoulder's axis


def test_beyond_the_singularity_it_clamps_and_says_so() -> None:
    """Links a and f crossed until their ends coincide: finite numbers, finite slopes, and a margin below 0."""
    bar = chain().bar
    lean = np.arcsin(0.5 * (bar.pivot_a[1] - bar.pivot_f[1]) / bar.crank_a)
    q = np.array([0.0, 0.5 * np.pi - lean, lean, 0.0, 0.0, 0.0])
    assert margin(NUMPY, bar, q[1], q[2]) < 0
    assert np.isfinite(forward_kinematics(q)[0]).all() and np.isfinite(jacobian(q)).all()
    x = casadi.SX.sym("x", 6)
    tool = casadi.vertcat(*tool_point(casadi_ops(), chain(), casadi.vertsplit(x)))
    slope = casadi.Function("slope", [x], [casadi.jacobian(tool, x)])
    assert np.isfinite(np.asarray(slope(q))).all()


def test_the_jacobian_is_the_slope_of_the_kinematics() -> None:
    q = anywhere(200, seed=1)
    came = jacobian(q)
    _, frame = forward_kinematics(q)
    for i in range(6):
        step = np.eye(6)[i] * EPS
        (ahead, turned), (behind, back) = forward_kinematics(q + step), forward_kinematics(q - step)
        np.testing.assert_allclose(came[:, :3, i], (ahead - behind) / (2 * EPS), atol=2e-9)
        spin = (turned - back) / (2 * EPS) @ frame.swapaxes(-1, -2)
        np.testing.assert_allclose(
            came[:, 3:, i], np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=-1), atol=2e-9
        )


def test_passive_rates_are_the_slope_of_the_passive_angles() -> None:
    q, rates = anywhere(200, seed=2), np.random.default_rng(3).standard_normal((200, 6))
    came = np.stack(passive_rates(NUMPY, chain().bar, q[:, 1], q[:, 2], rates[:, 1], rates[:, 2]), axis=-1)
    wanted = (passive_angles(q + EPS * rates) - passive_angles(q - EPS * rates)) / (2 * EPS)
    np.testing.assert_allclose(came, wanted, atol=2e-8)


def test_one_source_serves_numpy_jax_and_casadi() -> None:
    q, rates = anywhere(50, seed=4), np.random.default_rng(5).standard_normal((50, 6))
    x, v = casadi.SX.sym("x", 6), casadi.SX.sym("v", 6)
    parts, speeds = casadi.vertsplit(x), casadi.vertsplit(v)
    point_sx = casadi.vertcat(*tool_point(casadi_ops(), chain(), parts))
    ahead_sx = casadi.vertcat(*task_velocity(casadi_ops(), chain(), parts, speeds, 0.01))
    symbolic = casadi.Function("f", [x, v], [point_sx, ahead_sx, casadi.jacobian(point_sx, x)])
    with jax.enable_x64(True):
        point_jax = np.stack(jax.jit(lambda x: tool_point(jax_ops(), chain(), list(x)))(jnp.array(q.T)), axis=-1)
        slope_jax = jax.jacfwd(lambda x: jnp.stack(tool_point(jax_ops(), chain(), list(x))))(jnp.array(q[0]))
    wanted, by_hand = forward_kinematics(q)[0], jacobian(q)[:, :3]
    np.testing.assert_allclose(point_jax, wanted, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(slope_jax, by_hand[0], rtol=0, atol=1e-13)
    for row in range(len(q)):
        point_ca, ahead_ca, slope_ca = (np.asarray(y) for y in symbolic(q[row], rates[row]))
        np.testing.assert_allclose(point_ca.ravel(), wanted[row], rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(ahead_ca.ravel(), velocity(q, rates, 0.01)[row], rtol=0, atol=1e-11)
        np.testing.assert_allclose(slope_ca, by_hand[row], rtol=0, atol=1e-12)  # automatic against by hand


def test_the_inverse_is_the_inverse() -> None:
    q = anywhere(2000, seed=6)
    np.testing.assert_allclose(inverse_kinematics(*forward_kinematics(q)), q, rtol=0, atol=1e-9)


def test_the_inverse_in_casadi_is_the_same() -> None:
    q = anywhere(6, seed=7)
    tool, frame = forward_kinematics(q)
    for row in range(len(q)):
        axes = tuple(tuple(casadi.DM(float(x)) for x in frame[row, :, j]) for j in range(3))
        found = angles_of(casadi_ops(), chain(), tuple(casadi.DM(float(x)) for x in tool[row]), axes)  # type: ignore[arg-type]
        np.testing.assert_allclose([float(x) for x in found], q[row], rtol=0, atol=1e-9)


def test_inverse_and_geometric_jacobian_in_jax_and_casadi_are_the_same() -> None:
    q = anywhere(20, seed=12)
    tool, frame = forward_kinematics(q)
    by_hand = jacobian(q)

    def inverse(tool: jnp.ndarray, frame: jnp.ndarray) -> jnp.ndarray:
        axes = tuple(tuple(frame[:, i, j] for i in range(3)) for j in range(3))
        return jnp.stack(angles_of(jax_ops(), chain(), tuple(tool.T), axes), axis=-1)  # type: ignore[arg-type]

    def slopes(x: jnp.ndarray) -> jnp.ndarray:
        found = columns(jax_ops(), chain(), list(x))
        return jnp.stack([jnp.stack([*v, *w]) for v, w in found], axis=-1)

    with jax.enable_x64(True):
        np.testing.assert_allclose(jax.jit(inverse)(tool, frame), q, rtol=0, atol=1e-9)
        np.testing.assert_allclose(jax.vmap(slopes)(jnp.array(q)), by_hand, rtol=0, atol=1e-13)
    x = casadi.SX.sym("x", 6)
    found = columns(casadi_ops(), chain(), casadi.vertsplit(x))
    symbolic = casadi.Function("jacobian", [x], [casadi.horzcat(*(casadi.vertcat(*v, *w) for v, w in found))])
    for row in range(len(q)):
        np.testing.assert_allclose(np.asarray(symbolic(q[row])), by_hand[row], rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("moved", "said"),
    [((0.5, 0.0, 0.0), "out of reach"), ((0.0, 0.0, 0.12), "allowed range"), ((-0.3, 0.2, 0.0), "shoulder")],
)
def test_a_pose_that_cannot_be_taken_is_named(moved: tuple[float, float, float], said: str) -> None:
    tool, frame = forward_kinematics(np.array(HOME))
    with pytest.raises(Unreachable, match=said) as fault:
        inverse_kinematics(np.stack([tool, tool + moved]), np.stack([frame, frame]))
    assert fault.value.index == (1,)


def test_fk_prop_becomes_the_jacobian_as_the_step_shrinks() -> None:
    """A difference forward in time: of first order in the step."""
    q, rates = anywhere(100, seed=8), np.random.default_rng(9).standard_normal((100, 6))
    exact = velocity_by_jacobian(q, rates)
    np.testing.assert_allclose(exact, np.einsum("nij,nj->ni", jacobian(q)[:, :3], rates), atol=1e-12)
    off = [np.sqrt(np.mean((velocity(q, rates, dt) - exact) ** 2)) for dt in (0.02, 0.01, 0.005)]
    assert 1.9 < off[0] / off[1] < 2.1 and 1.9 < off[1] / off[2] < 2.1


def test_constants_may_stand_for_arrays() -> None:
    """Six plain numbers, as a caller at a prompt gives them."""
    found = columns(NUMPY, chain(), HOME)
    assert np.shape(found[0][0][0]) == ()
    np.testing.assert_allclose(found[2][0], jacobian(np.array(HOME))[:3, 2], atol=1e-15)


def test_far_beyond_the_limits_links_stay_rigid() -> None:
    """Any angles at all: the tool's frame stays a rotation, and the loop is closed wherever it can be."""
    q = np.random.default_rng(10).uniform(-np.pi, np.pi, (2000, 6))
    _, frame = forward_kinematics(q)
    np.testing.assert_allclose(frame.swapaxes(-1, -2) @ frame, np.broadcast_to(np.eye(3), frame.shape), atol=1e-12)
    assert np.isfinite(jacobian(q)).all()
    can = np.flatnonzero(margin(NUMPY, chain().bar, q[:, 1], q[:, 2]) > 1e-3)[:300]
    assert len(can) == 300
    for row, passive in zip(can, passive_angles(q[can]), strict=True):
        links = literal_frames(q[row], passive)
        assert np.abs(point(links["b"], SCALER.on_b) - point(links["e"], SCALER.on_e)).max() < 1e-12
