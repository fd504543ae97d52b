"""The paper's network (its equation labelled nn): fully connected, leaky ReLU, flat weights.

delta(z) = y_out s(y_lay s(y_in z + y_in0) + y_lay0) + y_out0 has 203 parameters with 5 inputs and 213 with 6 (10 nodes
a layer, 3 outputs). The paper's text says 198 and 209; its equation cannot have these, and the equation is built here.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

PAPER_HIDDEN = (10, 10)


@dataclass(frozen=True)
class Mlp:
    """Layer sizes, and the slope of the leaky ReLU max(slope b, b) on all layers but the last."""

    inputs: int
    hidden: tuple[int, ...] = PAPER_HIDDEN
    outputs: int = 3
    slope: float = 0.01

    def __post_init__(self) -> None:
        if min(self.inputs, self.outputs, *self.hidden) < 1:
            raise ValueError(f"layer sizes must be >= 1, got {self.widths}")
        if not 0.0 <= self.slope <= 1.0:
            raise ValueError(f"slope must be between 0 and 1 for max(slope b, b) to be a leaky ReLU, got {self.slope}")

    @cached_property
    def widths(self) -> tuple[int, ...]:
        """Nodes a layer, from the inputs to the outputs."""
        return (self.inputs, *self.hidden, self.outputs)

    @cached_property
    def size(self) -> int:
        """Number of weights and biases."""
        return sum((a + 1) * b for a, b in pairwise(self.widths))


def layers(net: Mlp, theta: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Views (W (..., out, in), b (..., out)) of flat weights theta (..., size), input layer first.

    Raises ValueError where theta does not belong to the net.
    """
    if theta.shape[-1] != net.size:
        raise ValueError(f"theta must have {net.size} entries for this network, got {theta.shape[-1]}")
    out, at = [], 0
    for a, b in pairwise(net.widths):
        weight = theta[..., at : at + a * b].reshape(*theta.shape[:-1], b, a)
        out.append((weight, theta[..., at + a * b : at + (a + 1) * b]))
        at += (a + 1) * b
    return out


def leaky(b: np.ndarray, slope: float) -> np.ndarray:
    """max(slope b, b), the paper's activation."""
    return np.asarray(np.maximum(slope * b, b))


def forward(net: Mlp, theta: np.ndarray, z: np.ndarray) -> np.ndarray:
    """delta (..., outputs) of inputs z (..., inputs) under weights theta (..., size), leading axes broadcast."""
    a = np.asarray(z, dtype=np.float64)
    parts = layers(net, np.asarray(theta, dtype=np.float64))
    for i, (weight, bias) in enumerate(parts):
        if theta.ndim == 1:
            a = a @ weight.T + bias
        else:
            a = np.matmul(weight, a[..., None])[..., 0] + bias
        if i < len(parts) - 1:
            a = leaky(a, net.slope)
    return a


def jacobian(net: Mlp, theta: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """delta (N, outputs) and its exact d delta / d theta (N, outputs, size) at z (N, inputs), theta (size,).

    At a kink the slope of the positive side is taken.
    """
    parts = layers(net, theta)
    inputs, masks = [np.asarray(z, dtype=np.float64)], []
    for i, (weight, bias) in enumerate(parts):
        b = inputs[-1] @ weight.T + bias
        if i < len(parts) - 1:
            masks.append(np.where(b >= 0.0, 1.0, net.slope))
            b = leaky(b, net.slope)
        inputs.append(b)
    n = len(z)
    out = np.empty((n, net.outputs, net.size))
    back = np.broadcast_to(np.eye(net.outputs), (n, net.outputs, net.outputs))  # d delta / d b of the layer at hand
    at = net.size
    for i in range(len(parts) - 1, -1, -1):
        weight = parts[i][0]
        b, a = weight.shape
        at -= (a + 1) * b
        out[:, :, at : at + a * b] = (back[:, :, :, None] * inputs[i][:, None, None, :]).reshape(n, net.outputs, -1)
        out[:, :, at + a * b : at + (a + 1) * b] = back
        if i:
            back = (back @ weight) * masks[i - 1][:, None, :]
    return inputs[-1], out


def input_slope(net: Mlp, theta: np.ndarray, z: np.ndarray) -> np.ndarray:
    """d delta / d z (N, outputs, inputs) at scaled inputs z (N, inputs), theta (size,); at a kink as in `jacobian`."""
    a = np.asarray(z, dtype=np.float64)
    slope = np.broadcast_to(np.eye(net.inputs), (len(a), net.inputs, net.inputs))
    parts = layers(net, theta)
    for i, (weight, bias) in enumerate(parts):
        a, slope = a @ weight.T + bias, weight @ slope
        if i < len(parts) - 1:
            slope = slope * np.where(a >= 0.0, 1.0, net.slope)[:, :, None]
            a = leaky(a, net.slope)
    return np.asarray(slope)


def initial_weights(net: Mlp, rng: np.random.Generator) -> np.ndarray:
    """theta (size,) for scaled inputs: He's spread in the hidden layers, zero in the last, so that delta begins at 0.

    An untrained residual that already moves the model would make it worse before it has seen anything.
    """
    theta = np.zeros(net.size)
    parts = layers(net, theta)
    for weight, bias in parts[:-1]:
        weight[...] = rng.standard_normal(weight.shape) * np.sqrt(2.0 / weight.shape[1])
        bias[...] = 0.1 * rng.standard_normal(bias.shape)
    return theta
