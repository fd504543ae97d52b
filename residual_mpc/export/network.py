"""The residual's network written out in scalars, for any array library, with its weights as arguments."""

from collections.abc import Mapping, Sequence

import numpy as np

from residual_mpc.effects.ops import Array, Ops, clip
from residual_mpc.errors import BadInput
from residual_mpc.export.soften import smoothed
from residual_mpc.learning.forms.body import BODY, WORLD
from residual_mpc.learning.network.mlp import Mlp
from residual_mpc.learning.network.residual import Residual
from residual_mpc.models.stepping import Correction

# For each form of residual: what it reads, in the order of its inputs, and what it adds to, in the order of its outputs
TASK = ("task.x", "task.y", "task.z")  # m/s, of an arm's tool
ADDS_TO: Mapping[str, tuple[str, ...]] = {"body": BODY, "paper": WORLD, "task": TASK}
JOINT = "joint"  # reads positions, velocities and commands, and adds to the accelerations: its own names say which
READS: Mapping[str, str] = {"body": "last", "paper": "model"}  # its own last velocities; the model's present ones


def network(ops: Ops, net: Mlp, theta: Sequence[Array], z: Sequence[Array], smooth: float) -> list[Array]:
    """The paper's eq. nn on scalars: theta (size,), z (inputs,) -> (outputs,); layout as in learning.network.mlp.

    smooth 0: the exact leaky ReLU max(slope b, b). Otherwise (1 + slope) / 2 b + (1 - slope) / 2 sqrt(b^2 + smooth^2),
    at most (1 - slope) / 2 smooth above it.
    """
    a, at = list(z), 0
    widths = net.widths
    for layer, (rows, columns) in enumerate(zip(widths[1:], widths[:-1], strict=True)):
        out = []
        for i in range(rows):
            total = theta[at + rows * columns + i]
            for j in range(columns):
                total = total + theta[at + i * columns + j] * a[j]
            out.append(total)
        at += (columns + 1) * rows
        a = out if layer == len(widths) - 2 else [_activation(ops, b, net.slope, smooth) for b in out]
    return a


def residual_delta(
    ops: Ops, residual: Residual, theta: Sequence[Array], z: Sequence[Array], smooth: float
) -> list[Array]:
    """delta (outputs,) at inputs z (inputs,), both in physical units, as `Residual` itself has it.

    smooth: see `network`; the limit of the scaled inputs is rounded by the same width.
    """
    scaled = [(v - m) / s for v, m, s in zip(z, residual.input_mean, residual.input_scale, strict=True)]
    if np.isfinite(residual.limit):
        held = ops if smooth == 0.0 else smoothed(ops, smooth)
        scaled = [clip(held, v, -residual.limit, residual.limit) for v in scaled]
    out = network(ops, residual.net, theta, scaled, smooth)
    return [d * s for s, d in zip(residual.output_scale, out, strict=True)]


def correction(ops: Ops, residual: Residual, theta: Sequence[Array], smooth: float) -> Correction:
    """What the residual adds to the step's signals, as a function of them."""
    outputs = corrected(residual)

    def add(signals: Mapping[str, Array]) -> Mapping[str, Array]:
        delta = residual_delta(ops, residual, theta, [signals[name] for name in reads(residual)], smooth)
        return {n: d for n, d, s in zip(outputs, delta, residual.output_scale, strict=True) if s != 0.0}

    return add


def reads(residual: Residual) -> tuple[str, ...]:
    """The step's signals that the residual's inputs are, in their order.

    Raises BadInput for a form that no step can host, or inputs that do not fit it.
    """
    if residual.form not in (*ADDS_TO, JOINT):
        raise BadInput(
            f"a residual of form {residual.form!r} cannot be exported as a step",
            residual.robot,
            f"learn it again in one of the forms {', '.join((*ADDS_TO, JOINT))}",
        )
    if residual.form in ("task", JOINT):  # eq. (fk_prop): the joints' rates alone; of joints what their step states
        return residual.inputs
    last, commands = residual.inputs[:3], residual.inputs[3:]
    if len(last) < 3 or not commands or not all(c.startswith("command.") for c in commands):
        raise BadInput(
            f"inputs must be three velocities and the commands, got {', '.join(residual.inputs)}",
            residual.robot,
            "learn it again with `residual-mpc learn`",
        )
    return (*(f"{READS[residual.form]}.{s}" for s in ADDS_TO[residual.form]), *commands)


def remembered(residual: Residual | None) -> tuple[str, ...]:
    """The signals whose last value the residual reads."""
    return () if residual is None or READS.get(residual.form) != "last" else ADDS_TO[residual.form]


def corrected(residual: Residual | None) -> tuple[str, ...]:
    """The signals that the residual adds to."""
    if residual is None:
        return ()
    return residual.outputs if residual.form == JOINT else ADDS_TO[residual.form]


def _activation(ops: Ops, b: Array, slope: float, smooth: float) -> Array:
    if smooth == 0.0:
        return ops.maximum(slope * b, b)
    return 0.5 * (1.0 + slope) * b + 0.5 * (1.0 - slope) * (b * b + smooth * smooth) ** 0.5
