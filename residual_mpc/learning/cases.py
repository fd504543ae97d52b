"""The paper's three cases as what stands still and what is learned, and the sum of two residuals as one.

sim-to-dyn: x_sim = Dyn + d1. real-to-dyn: x_real = Dyn + d1 + d2, d1 kept only where the paper's condition
(its equation model_constr) holds on the runs. real-to-sim: x_real = sim + d2 + d3, the simulator being the robot at
hand. Each hands its last residual on: the next case begins from it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.learning.network.mlp import Mlp, layers
from residual_mpc.learning.network.residual import Residual

FIRST_CASE = "sim-to-dyn"  # starts without an earlier residual
CASES = (FIRST_CASE, "real-to-dyn", "real-to-sim")
ALIKE = 0.1  # of a step: two models replay on different grids, of which a step is a whole number of steps


@dataclass(frozen=True)
class Condition:
    """Equation model_constr: mean |x_real - Dyn| without the earlier residual, and with it (velocities, H2 norm)."""

    without: float
    with_earlier: float

    @property
    def holds(self) -> bool:
        return self.without > self.with_earlier


def check_compatible(earlier: Residual, blank: Residual, source: str) -> None:
    """Raises BadInput where a residual to begin from is not of the robot, form and step at hand."""
    for what, came, wanted in (
        ("inputs", earlier.inputs, blank.inputs),
        ("outputs", earlier.outputs, blank.outputs),
    ):
        if came != wanted:
            raise BadInput(
                f"the {what} of its residual must be {', '.join(wanted)}, got {', '.join(came)}",
                source,
                f"it was learned on {earlier.robot}: start from a residual of this robot, or without `warm_start`",
            )
    if earlier.form != blank.form or abs(earlier.step - blank.step) > ALIKE * blank.step:
        raise BadInput(
            f"its residual must have form {blank.form} and step {blank.step:g} s, "
            f"got {earlier.form} and {earlier.step:g} s",
            source,
            "learn both residuals with the same `form` and `step`",
        )


def add_residuals(first: Residual, second: Residual) -> Residual:
    """One residual that is the sum of two of the same form and depth: their networks side by side in a wider one.

    Exact where neither holds its inputs back; beyond, the first one's limit is that of both.
    """
    if len(first.net.hidden) != len(second.net.hidden) or first.net.slope != second.net.slope:
        raise ValueError(f"networks must have equal depth and slope, got {first.net} and {second.net}")
    net = Mlp(
        first.net.inputs,
        tuple(a + b for a, b in zip(first.net.hidden, second.net.hidden, strict=True)),
        first.net.outputs,
        first.net.slope,
    )
    scale = np.maximum(first.output_scale, second.output_scale)
    theta = np.zeros(net.size)
    a_parts, b_parts = layers(first.net, first.theta), layers(second.net, second.theta)
    last = len(a_parts) - 1
    for i, (weight, bias) in enumerate(layers(net, theta)):
        (wa, ba), (wb, bb) = a_parts[i], b_parts[i]
        if i == 0:  # the second net's inputs are scaled its own way
            bb = bb + wb @ ((first.input_mean - second.input_mean) / second.input_scale)
            wb = wb * (first.input_scale / second.input_scale)
        if i == last:
            share = [
                np.divide(r.output_scale, scale, out=np.zeros(len(scale)), where=scale > 0) for r in (first, second)
            ]
            weight[:, : wa.shape[1]], weight[:, wa.shape[1] :] = share[0][:, None] * wa, share[1][:, None] * wb
            bias[:] = share[0] * ba + share[1] * bb
        else:
            n, into = wa.shape[0], wa.shape[1]
            weight[:n, :into], bias[:n], bias[n:] = wa, ba, bb
            weight[n:, (0 if i == 0 else into) :] = wb
    return replace(first, net=net, theta=theta, output_scale=scale)


def sum_residuals(residuals: Sequence[Residual]) -> Residual:
    """The sum of one or more residuals as one, of the robot and with the step of the last."""
    out = residuals[0]
    for r in residuals[1:]:
        out = add_residuals(out, r)
    return replace(out, step=residuals[-1].step, robot=residuals[-1].robot)
