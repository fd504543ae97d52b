"""Learners of a residual from the same samples: the filters, Adam, a Gaussian process; for `benchmarks.learners`.

Each takes scaled inputs z (n, inputs) and errors y (n, outputs) of the model, both of order one, NaN where missing, and
gives a function from inputs to residuals. Adam chooses its step among RATES on the last fifth of the samples.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from residual_mpc.learning.network.mlp import Mlp, forward, initial_weights, jacobian
from residual_mpc.learning.stream.samples import Samples
from residual_mpc.learning.stream.updates import StreamSettings, learn_stream

RATES = (1e-3, 3e-3, 1e-2)
BATCH = 100  # samples in a gradient
EPOCHS = 40
HORIZON = 20  # samples that an online learner gets at a time
FIRST = 0.01  # weight of the last layer at the start, so that the gradient of the others is not zero
MOST = 400  # samples that a Gaussian process is given: its cost is cubic
Model = Callable[[np.ndarray], np.ndarray]
Learner = Callable[[np.ndarray, np.ndarray, np.random.Generator], Model]


def by_filter(settings: StreamSettings) -> Learner:
    """The product's own, on the stream of samples."""

    def learn(z: np.ndarray, y: np.ndarray, rng: np.random.Generator) -> Model:
        n, o = y.shape
        names = (tuple(f"z{i}" for i in range(z.shape[1])), tuple(f"y{i}" for i in range(o)))
        samples = Samples(np.arange(n) * 0.05, z, np.zeros((n, o)), y, 0.05)
        return learn_stream(samples, names, "task", "benchmark", settings, rng).residual

    return learn


@dataclass(frozen=True)
class Adam:
    """Gradient descent (Kingma and Ba, algorithm 1) on the same network. huber: errors from which the loss grows with
    their size; inf: squares. online: in the order of the stream, eleven steps for every HORIZON new samples, ten of
    them on old ones, as many as the filter makes; else EPOCHS times through all."""

    huber: float = np.inf
    online: bool = False

    def __call__(self, z: np.ndarray, y: np.ndarray, rng: np.random.Generator) -> Model:
        good = np.isfinite(y).all(axis=1)
        z, y = z[good], y[good]
        net = Mlp(z.shape[1], (10, 10), y.shape[1])
        first = initial_weights(net, rng)
        first[first == 0.0] = FIRST * rng.standard_normal(int((first == 0.0).sum()))
        cut = len(z) * 4 // 5
        seeds = rng.integers(2**31, size=2)
        best, least = RATES[0], np.inf
        for rate in RATES:
            theta = self._descend(net, first, z[:cut], y[:cut], rate, np.random.default_rng(seeds[0]))
            loss = float(np.median(np.abs(forward(net, theta, z[cut:]) - y[cut:])))
            if loss < least:
                best, least = rate, loss
        theta = self._descend(net, first, z, y, best, np.random.default_rng(seeds[1]))
        return lambda x: forward(net, theta, x)

    def _descend(
        self, net: Mlp, theta: np.ndarray, z: np.ndarray, y: np.ndarray, rate: float, rng: np.random.Generator
    ) -> np.ndarray:
        m, v = np.zeros(net.size), np.zeros(net.size)
        for k, rows in enumerate(self._order(len(z), rng), start=1):
            out, slope = jacobian(net, theta, z[rows])
            e = np.clip(out - y[rows], -self.huber, self.huber)
            g = np.einsum("no,nol->l", e, slope) / len(rows)
            m, v = 0.9 * m + 0.1 * g, 0.999 * v + 0.001 * g * g
            theta = theta - rate * (m / (1 - 0.9**k)) / (np.sqrt(v / (1 - 0.999**k)) + 1e-8)
        return theta

    def _order(self, n: int, rng: np.random.Generator) -> list[np.ndarray]:
        if not self.online:
            return [rows for _ in range(EPOCHS) for rows in np.array_split(rng.permutation(n), max(1, n // BATCH))]
        out = []
        for k in range(n // HORIZON):
            out.append(np.arange(k * HORIZON, (k + 1) * HORIZON))
            out += [HORIZON * j + np.arange(HORIZON) for j in rng.integers(k + 1, size=min(10, k))]
        return out


def gaussian_process(z: np.ndarray, y: np.ndarray, rng: np.random.Generator) -> Model:
    """A squared exponential with a length for each input, and white noise; by marginal likelihood."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    good = np.flatnonzero(np.isfinite(y).all(axis=1))
    some = np.sort(rng.permutation(good)[:MOST])
    models = []
    for k in range(y.shape[1]):
        kernel = ConstantKernel(1.0, (1e-3, 1e3)) * RBF(np.ones(z.shape[1]), (1e-1, 1e3)) + WhiteKernel(
            0.1, (1e-6, 1e2)
        )
        models.append(GaussianProcessRegressor(kernel).fit(z[some], y[some, k]))
    return lambda x: np.stack([m.predict(x) for m in models], axis=1)


def nothing(z: np.ndarray, y: np.ndarray, rng: np.random.Generator) -> Model:
    """The model alone."""
    return lambda x: np.zeros((len(x), y.shape[1]))
