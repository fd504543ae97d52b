"""What the network predicts over the receding horizon, stacked: the function of the weights that the filters see."""

from dataclasses import dataclass, field

import numpy as np

from residual_mpc.learning.filter.workspace import Workspace
from residual_mpc.learning.network.mlp import Mlp, forward, jacobian, layers, leaky


@dataclass(frozen=True, eq=False)
class Window:
    """x_pred(theta) = offset + readout @ stacked network outputs over N instants.

    Stacked as the paper stacks them: the first component over the whole horizon, then the second, and so on. z (N,
    inputs) scaled inputs; offset (m,) what the model predicts without the residual; scale (outputs,) from the network's
    unit to the output's, cost weights included; readout (m, outputs * N) takes outputs to what is measured, such as the
    sums by which velocities become positions; None measures the outputs themselves. workspace: see Workspace.
    """

    net: Mlp
    z: np.ndarray
    offset: np.ndarray
    scale: np.ndarray
    readout: np.ndarray | None = None
    workspace: Workspace = field(default_factory=Workspace)

    def predict(self, theta: np.ndarray) -> np.ndarray:
        """x_pred (m,)."""
        return self.offset + self._measured(forward(self.net, theta, self.z).T.reshape(1, -1))[0]

    def linear(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x_pred (m,) and its exact Jacobian (m, L)."""
        out, slope = jacobian(self.net, theta, self.z)
        h = self._measured(slope.transpose(2, 1, 0).reshape(len(theta), -1)).T
        return self.offset + self._measured(out.T.reshape(1, -1))[0], np.ascontiguousarray(h)

    def around(self, theta: np.ndarray, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x_pred (m,), and its first and second differences (L + K, m) at theta + and - each row of moves (L, L), see
        `around`. They lie in `workspace` and hold until the next call."""
        centre, differences = around(self.net, theta, moves, self.z, self.workspace)
        flat = differences.reshape(len(differences), -1)
        scale = np.repeat(self.scale, len(self.z))
        if self.readout is None:
            flat *= scale
        else:
            measured = self.workspace.array(-1, "measured", (len(flat), len(self.readout)))
            flat = np.matmul(flat, (self.readout * scale).T, out=measured)
        return self.offset + self._measured(centre.reshape(1, -1))[0], flat

    def _measured(self, out: np.ndarray) -> np.ndarray:
        """(rows, m) from stacked network outputs (rows, outputs * N)."""
        scale = np.repeat(self.scale, len(self.z))
        return np.asarray(out * scale if self.readout is None else out @ (self.readout * scale).T)


def around(
    net: Mlp, theta: np.ndarray, moves: np.ndarray, z: np.ndarray, workspace: Workspace
) -> tuple[np.ndarray, np.ndarray]:
    """The network x (o, N) at z (N, inputs) under theta (L,), and its central differences (L + K, o, N) under theta +
    and - each row of moves: first x+ - x- for all L rows, then x+ + x- - 2 x for the K rows before the last layer's,
    after which there are none.

    moves (L, L) is upper triangular (the transpose of a Cholesky factor): row j moves weight j and later ones, thus
    nothing in the layers before the one that holds weight j. Those are evaluated once, for the mean, and the rows of
    one layer share the product with what comes out of them. The differences lie in `workspace`, until the next call.
    """
    parts, n, at = layers(net, theta), len(z), 0
    a = np.ascontiguousarray(z.T)  # (nodes, N) of the mean
    moved = np.empty((2, 0, net.inputs, n))  # the same under + and - of the rows j < at
    for i, (weight, bias) in enumerate(parts):
        out, into = weight.shape
        split, end, last = at + weight.size, at + weight.size + out, i == len(parts) - 1
        mean = weight @ a + bias[:, None]
        # rows whose earlier layers are the mean's: what they add
        fresh = workspace.array(i, "fresh", (end - at, out, n))
        np.matmul(moves[at:end, at:split].reshape(-1, out, into), a, out=fresh)
        fresh += moves[at:end, split:end, None]
        new = workspace.array(i, "new", (2, at if last else end, out, n))
        if at:  # rows that have moved an earlier layer
            own = workspace.array(i, "own", (2, at, end - at))
            np.add(theta[at:end], moves[:at, at:end], out=own[0])
            np.subtract(theta[at:end], moves[:at, at:end], out=own[1])
            np.matmul(own[..., : weight.size].reshape(2, at, out, into), moved, out=new[:, :at])
            if not last:
                new[:, :at] += own[..., weight.size :, None]
        if last:
            break
        np.add(mean, fresh, out=new[0, at:])
        np.subtract(mean, fresh, out=new[1, at:])
        low = np.multiply(new, net.slope, out=workspace.array(i, "low", new.shape))
        moved = np.maximum(low, new, out=low)
        a, at = leaky(mean, net.slope), end
    differences = workspace.array(0, "differences", (net.size + at, net.outputs, n))
    first, second = differences[: net.size], differences[net.size :]
    np.subtract(new[0], new[1], out=first[:at])
    first[:at] += 2.0 * moves[:at, split:, None]
    np.multiply(2.0, fresh, out=first[at:])
    np.add(new[0], new[1], out=second)
    second -= 2.0 * (mean - bias[:, None])
    return mean, differences
