"""The network: the paper's equation written out, its count, its derivative; and its record as JSON."""

import json
from dataclasses import replace

import numpy as np
import pytest

from residual_mpc.errors import BadInput
from residual_mpc.learning.network.mlp import Mlp, forward, initial_weights, jacobian, layers
from residual_mpc.learning.network.residual import Residual, from_json, to_json

NET = Mlp(5, (10, 10), 3)


def residual() -> Residual:
    rng = np.random.default_rng(3)
    names = ("velocity.forward", "velocity.sideways", "velocity.yaw", "command.left", "command.right")
    return Residual(NET, rng.standard_normal(NET.size), names, ("forward", "sideways", "yaw"), np.arange(5.0),
                    np.arange(1.0, 6.0), np.array([0.1, 0.2, 0.3]), "body", 0.05, "rover")  # fmt: skip


def test_the_equation_has_203_and_213_parameters():
    assert (NET.size, Mlp(6, (10, 10), 3).size) == (203, 213)


def test_forward_is_the_equation_written_out():
    rng = np.random.default_rng(0)
    theta, z = rng.standard_normal(NET.size), rng.standard_normal(5)
    y_in, y_in0 = theta[:50].reshape(10, 5), theta[50:60]
    y_lay, y_lay0 = theta[60:160].reshape(10, 10), theta[160:170]
    y_out, y_out0 = theta[170:200].reshape(3, 10), theta[200:]
    s = lambda b: np.array([max(0.01 * x, x) for x in b])  # noqa: E731
    wanted = y_out @ s(y_lay @ s(y_in @ z + y_in0) + y_lay0) + y_out0
    np.testing.assert_allclose(forward(NET, theta, z), wanted, atol=1e-13)


def test_leading_axes_broadcast():
    rng = np.random.default_rng(1)
    theta, z = rng.standard_normal((4, 1, NET.size)), rng.standard_normal((7, 5))
    out = forward(NET, theta, z)
    assert out.shape == (4, 7, 3)
    np.testing.assert_allclose(out[2, 5], forward(NET, theta[2, 0], z[5]), atol=1e-13)


def test_jacobian_is_the_central_difference():
    rng = np.random.default_rng(2)
    theta, z = rng.standard_normal(NET.size), rng.standard_normal((6, 5))
    value, slope = jacobian(NET, theta, z)
    np.testing.assert_allclose(value, forward(NET, theta, z), atol=1e-13)
    h = 1e-6
    moved = [forward(NET, theta + h * e, z) - forward(NET, theta - h * e, z) for e in np.eye(NET.size)]
    np.testing.assert_allclose(slope, np.moveaxis(np.array(moved), 0, -1) / (2 * h), atol=1e-7)


def test_untrained_weights_give_no_residual():
    theta = initial_weights(NET, np.random.default_rng(0))
    assert not forward(NET, theta, np.random.default_rng(1).standard_normal((9, 5))).any()
    assert layers(NET, theta)[0][0].any()


def test_record_survives_json_bit_for_bit():
    r = residual()
    z = np.random.default_rng(5).standard_normal((8, 5))
    again = from_json(json.loads(json.dumps(to_json(r))))
    assert np.array_equal(again(z), r(z)) and again.inputs == r.inputs and again.net == r.net


def test_a_switched_off_output_is_zero_and_the_others_stay():
    z = np.random.default_rng(5).standard_normal((8, 5))
    r = residual()
    off = r.without(("sideways",))(z)
    assert not off[:, 1].any() and np.array_equal(off[:, [0, 2]], r(z)[:, [0, 2]])


@pytest.mark.parametrize("spoil", [{"theta": [1.0]}, {"form": "soul"}, {"input_scale": [0.0] * 5}, {"net": 3}])
def test_a_spoilt_record_is_bad_input(spoil):
    with pytest.raises(BadInput, match="model.json"):
        from_json({**to_json(residual()), **spoil}, "model.json")


def test_a_record_checks_itself():
    with pytest.raises(ValueError, match="theta"):
        replace(residual(), theta=np.full(NET.size, np.nan))
