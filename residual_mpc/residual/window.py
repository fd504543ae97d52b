"""What the network predicts over the receding horizon, stacked: the function of the weights that the filters see."""

from dataclasses import dataclass, field

import numpy as np

from residual_mpc.residual.mlp import Mlp, forward, jacobian, layers, leaky
from residual_mpc.residual.room import Room


@dataclass(frozen=True, eq=False)
class Window:
    """x_pred(theta) = offset + readout @ stacked network outputs over N instants.

    Stacked as the paper stacks them: the first component over the whole horizon, then the second, and so on. z (N,
    inputs) scaled inputs; offset (m,) what the model predicts without the residual; scale (outputs,) from the network's
    unit to the output's, cost weights included; readout (m, outputs * N) takes outputs to what is measured, such as the
    sums by which velocities become positions; None measures the outputs themselves. room: see Room.
    """

    net: Mlp
    z: np.ndarray
    offset: np.ndarray
    scale: np.ndarray
    readout: np.ndarray | None = None
    room: Room = field(default_factory=Room)

    def predict(self, theta: np.ndarray) -> np.ndarray:
        """x_pred (m,)."""
        return self.offset + self._measured(forward(self.net, theta, self.z).T.reshape(1, -1))[0]

    def linear(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x_pred (m,) and its exact Jacobian (m, L)."""
        out, slope = jacobian(self.net, theta, self.z)
        h = self._measured(slope.transpose(2, 1, 0).reshape(len(theta), -1)).T
        return self.offset + self._measured(out.T.reshape(1, -1))[0], np.ascontiguousarray(h)

    def around(self, theta: np.ndarray, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x_pred (m,), and its change (2, L, m) at theta + and - each row of moves (L, L), upper triangular.

        The change lies in `room` and holds until the next call.
        """
        centre, change = around(self.net, theta, moves, self.z, self.room)
        n = len(theta)
        flat = change.reshape(2 * n, -1)
        if self.readout is None:
            flat *= np.repeat(self.scale, len(self.z))
        else:
            scaled = self.readout * np.repeat(self.scale, len(self.z))
            flat = np.matmul(flat, scaled.T, out=self.room.array(-1, "measured", (2 * n, len(self.readout))))
        return self.offset + self._measured(centre.reshape(1, -1))[0], flat.reshape(2, n, -1)

    def _measured(self, out: np.ndarray) -> np.ndarray:
        """(rows, m) from stacked network outputs (rows, outputs * N)."""
        scale = np.repeat(self.scale, len(self.z))
        return np.asarray(out * scale if self.readout is None else out @ (self.readout * scale).T)


def around(net: Mlp, theta: np.ndarray, moves: np.ndarray, z: np.ndarray, room: Room) -> tuple[np.ndarray, np.ndarray]:
    """The network at z (N, inputs) under theta (L,), (o, N), and its change under theta +- moves[j], (2, L, o, N).

    moves (L, L) is upper triangular (the transpose of a Cholesky factor): row j moves weight j and later ones, thus
    nothing in the layers before the one that holds weight j. Those are evaluated once, for the mean. Within a layer
    the mean's product is shared, and the two signs share the product with the move. The change lies in `room`, until
    the next call.
    """
    parts = layers(net, theta)
    n, at = len(z), 0
    a = np.ascontiguousarray(z.T)  # (nodes, N) of the mean
    moved = np.empty((2, 0, net.inputs, n))  # activations under + and - of the rows j < at
    for i, (weight, bias) in enumerate(parts):
        out, into = weight.shape
        end = at + (into + 1) * out
        w_move = room.array(i, "move", (end, out, into))
        np.copyto(w_move.reshape(end, -1), moves[:end, at : at + into * out])
        b_move = moves[:end, at + into * out : end, None]
        mean = weight @ a + bias[:, None]
        new = room.array(i, "new", (2, end, out, n))
        # rows whose earlier layers are the mean's: one product for all of them, and for both signs
        fresh = room.array(i, "fresh", (end - at, out, n))
        np.matmul(w_move[at:].reshape(-1, into), a, out=fresh.reshape(-1, n))
        fresh += b_move[at:]
        np.add(mean, fresh, out=new[0, at:])
        np.subtract(mean, fresh, out=new[1, at:])
        if at:
            both = room.array(i, "weights", (at, out, into))
            for sign, add in enumerate((np.add, np.subtract)):
                np.matmul(add(weight, w_move[:at], out=both), moved[sign], out=new[sign, :at])
                new[sign, :at] += add(bias[:, None], b_move[:at])
        if i == len(parts) - 1:
            new -= mean
            return mean, new
        a, at = leaky(mean, net.slope), end
        low = np.multiply(new, net.slope, out=room.array(i, "low", new.shape))
        moved = np.maximum(low, new, out=low)
    raise AssertionError("a net has a last layer")
