"""Learning while driving: the paper's UKF on the last second of the loop, its weights given to filter and controller.

Every `horizon` samples the poses measured since are held against what the model predicts from the belief at their
beginning; the update needs no stop and no compiling, for weights are parameters of the model. What was learned is
handed over only while it predicts seconds that it has not seen better than the model it began with: a dead time, say,
is nothing that such a network can follow, and weights that try would drive worse than none.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.closed_loop.estimator import Filter
from residual_mpc.closed_loop.stacks import WindowPrediction, stack_of
from residual_mpc.learning.filter import ukf
from residual_mpc.learning.filter.guarded_update import guarded_update
from residual_mpc.learning.filter.kalman import Belief, FilterSettings, Measurement
from residual_mpc.learning.filter.window import Window


@dataclass(frozen=True)
class OnlineSettings:
    """horizon: samples in an update, and between updates. variance: of each weight before any data. noise: of the
    positions, 1-sigma, m, m, rad (an arm's tool: m); other: what the network cannot follow, as noise on them, same
    units. halvings: of an update that makes its own window worse when that is driven anew, before it is left out.
    memory: of the mean of unseen errors, a window; better: share of the first model's that the learned one has to stay
    below.
    """

    horizon: int = 20
    variance: float = 0.03
    noise: tuple[float, ...] = (0.002, 0.002, 0.006)
    other: tuple[float, ...] = (0.004, 0.004, 0.02)
    kalman: FilterSettings = FilterSettings(process=1e-6)
    halvings: int = 3
    memory: float = 0.7
    better: float = 0.5


SHORTENED = FilterSettings(process=0.0)  # a shortened update keeps the covariance as it was

Row = tuple[np.ndarray, np.ndarray, np.ndarray]  # belief (nx,), command (nu,), measured poses (ny,)


class OnlineLearner:
    """A leaf with one episode's memory: call it once a sample; see `residual_mpc.closed_loop.loop.Learner`."""

    def __init__(self, estimator: Filter, settings: OnlineSettings) -> None:
        self._stack = stack_of(estimator.model)
        residual = estimator.model.residual
        assert residual is not None  # or there would be no stack
        self._filter, self._settings, self._residual = estimator, settings, residual
        self._belief: Belief = ukf.init(residual.theta, settings.variance)
        self._rows: list[Row] = []
        self._first = estimator.p
        self._unseen = np.zeros(2)  # mean costs of windows not seen yet: of the first model, of the learned one
        self.updates = 0

    def __call__(self, x: np.ndarray, command: np.ndarray, pose: np.ndarray) -> np.ndarray | None:
        """New parameters (np,), or None while the window is not full."""
        self._rows.append((x, command, pose))
        if len(self._rows) <= self._settings.horizon:
            return None
        rows, self._rows = self._rows, self._rows[-1:]
        return self.learn(rows)

    def learn(self, rows: Sequence[Row]) -> np.ndarray | None:
        """One window, `horizon` + 1 samples in a row: new parameters (np,), or None where it says nothing."""
        window, measured = self._window(rows, self._driven(self._filter, rows))
        before = self._belief
        after, info = ukf.update(before, window, measured, self._settings.kalman)
        if not info.used:
            return None
        sigma = np.sqrt(np.diag(measured.noise))
        cost = self._cost(self._filter, rows, measured, sigma)
        blank = self._cost(self._filter.with_parameters(self._first), rows, measured, sigma)
        self._unseen = self._settings.memory * self._unseen + (1.0 - self._settings.memory) * np.array([blank, cost])
        good = bool(self._unseen[1] < self._settings.better * self._unseen[0])

        def accepts(theta: np.ndarray) -> bool:
            moved = self._filter.with_parameters(self._parameters(theta))
            return self._cost(moved, rows, measured, sigma) <= cost

        self._belief, share = guarded_update(before, after, accepts, self._settings.halvings, SHORTENED)
        if share > 0.0:
            theta = before.mean + share * (after.mean - before.mean)
            self._filter = self._filter.with_parameters(self._parameters(theta))
            self.updates += 1
        return self._filter.p if good else self._first

    @property
    def parameters(self) -> np.ndarray:
        """(np,) what was learned so far, good or not."""
        return self._filter.p

    def cost(self, rows: Sequence[Row], p: np.ndarray) -> float:
        """Robust squares, in sigma, of what parameters p (np,) leave of a window, learned from or not."""
        filter_ = self._filter.with_parameters(p)
        _, measured = self._window(rows, self._driven(filter_, rows))
        return self._cost(filter_, rows, measured, np.sqrt(np.diag(measured.noise)))

    def _parameters(self, theta: np.ndarray) -> np.ndarray:
        p = self._filter.p.copy()
        p[len(p) - len(theta) :] = theta
        return p

    def _driven(self, filter_: Filter, rows: Sequence[Row]) -> WindowPrediction:
        believed, commands = (np.array([row[i] for row in rows[:-1]]) for i in (0, 1))
        return self._stack.driven(filter_.drive, believed, commands)

    def _cost(self, filter_: Filter, rows: Sequence[Row], measured: Measurement, sigma: np.ndarray) -> float:
        """Robust squares of what the window leaves, so that one spike decides nothing."""
        at = self._driven(filter_, rows).positions
        if not np.isfinite(at).all():
            return np.inf
        e = (measured.reference - at[1:].T.ravel()) / sigma
        return float(np.nansum(np.minimum(e * e, 3.0 * np.abs(e))))

    def _window(self, rows: Sequence[Row], driven: WindowPrediction) -> tuple[Window, Measurement]:
        r, n, s = self._residual, self._settings.horizon, self._settings
        at = driven.positions
        scaled = r.scaled(driven.z)
        readout = self._stack.readout(at)
        bare = Window(r.net, scaled, np.zeros(3 * n), r.output_scale, readout)
        offset = at[1:].T.ravel() - bare.predict(self._belief.mean)
        y = self._stack.measured(np.array([row[2] for row in rows[1:]]), at[1:])
        sigma = np.sqrt(np.square(s.noise) + np.square(s.other))
        start = self._stack.from_start(at) * np.array(s.noise)
        noise = np.diag(np.repeat(sigma**2, n)) + start @ start.T
        return Window(r.net, scaled, offset, r.output_scale, readout), Measurement(y.T.ravel(), noise)
