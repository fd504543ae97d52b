"""The filters: against a literal transcription, against the Kalman filter, and under garbage."""

from dataclasses import dataclass

import numpy as np
import pytest
from oracles import ukf_literal

from residual_mpc.learning.filter import ekf, ukf
from residual_mpc.learning.filter.kalman import Belief, FilterSettings, Measurement, initial_belief
from residual_mpc.learning.filter.sigma_points import SigmaWeights
from residual_mpc.learning.filter.window import Window
from residual_mpc.learning.network.mlp import Mlp, initial_weights

PLAIN = FilterSettings(process=1e-4, huber=np.inf)
CHOICES = (
    SigmaWeights(),
    SigmaWeights(reach=2.5),
    SigmaWeights(reach=1.7, curved=True),
    SigmaWeights(reach=1.3, curved=True, centre=0.7),
)


@dataclass(frozen=True)
class Linear:
    """x_pred = h @ theta."""

    h: np.ndarray

    def around(self, theta, moves):
        return self.h @ theta, 2.0 * moves @ self.h.T

    def linear(self, theta):
        return self.h @ theta, self.h


def positive(size: int, rng: np.random.Generator) -> np.ndarray:
    a = rng.standard_normal((size, 2 * size))
    return a @ a.T / (2 * size)


def window(rng: np.random.Generator, readout: bool = False) -> tuple[Window, Belief, Measurement]:
    net = Mlp(5, (10, 10), 3)
    m = 25 if readout else 60
    through = rng.standard_normal((m, 60)) if readout else None
    w = Window(net, rng.standard_normal((20, 5)), rng.standard_normal(m), np.array([0.5, 1.0, 2.0]), through)
    mean = initial_weights(net, rng) + 0.1 * rng.standard_normal(net.size)
    return w, Belief(mean, 0.05 * positive(net.size, rng)), Measurement(rng.standard_normal(m), positive(m, rng))


@pytest.mark.parametrize("weights", CHOICES)
@pytest.mark.parametrize("readout", [False, True])
def test_an_update_is_the_papers_to_1e_10(weights, readout):
    w, belief, measured = window(np.random.default_rng(0), readout)

    def predict(theta):
        out = np.array([w.scale * ukf_literal.network(theta, z, 10, 3) for z in w.z]).T.reshape(-1)
        return w.offset + (out if w.readout is None else w.readout @ out)

    size = len(belief.mean)
    w_a0, w_ai = weights.mean_weights(size)
    wanted, p = ukf_literal.update(
        belief.mean, belief.covariance, predict, measured.reference, PLAIN.process * np.eye(size), measured.noise,
        weights.reach, w_a0, w_ai, weights.centre, weights.covariance_weight,
    )  # fmt: skip
    after, info = ukf.update(belief, w, measured, PLAIN, weights)
    assert info.used and info.held_back == 0
    np.testing.assert_allclose(after.mean, wanted, rtol=0, atol=1e-10)
    np.testing.assert_allclose(after.covariance, p, rtol=0, atol=1e-10)


@pytest.mark.parametrize("update", [ukf.update, lambda *a: ukf.update(*a, SigmaWeights(2.0, True, 0.5)), ekf.update])
def test_on_a_linear_problem_it_is_the_kalman_filter(update):
    rng = np.random.default_rng(1)
    belief = Belief(rng.standard_normal(12), positive(12, rng))
    mean, p = belief.mean, belief.covariance
    for _ in range(30):
        h, r, y = rng.standard_normal((4, 12)), positive(4, rng), rng.standard_normal(4)
        belief, _ = update(belief, Linear(h), Measurement(y, r), PLAIN)
        p = p + PLAIN.process * np.eye(12)
        k = p @ h.T @ np.linalg.inv(h @ p @ h.T + r)
        mean, p = mean + k @ (y - h @ mean), (np.eye(12) - k @ h) @ p
        np.testing.assert_allclose(belief.mean, mean, rtol=0, atol=1e-10)
        np.testing.assert_allclose(belief.covariance, p, rtol=0, atol=1e-10)


def test_a_small_reach_gives_the_jacobians_update():
    w, belief, measured = window(np.random.default_rng(2))
    close = SigmaWeights(reach=1e-5)
    a, _ = ukf.update(belief, w, measured, PLAIN, close)
    b, _ = ekf.update(belief, w, measured, PLAIN)
    np.testing.assert_allclose(a.mean, b.mean, atol=1e-5)
    np.testing.assert_allclose(a.covariance, b.covariance, atol=1e-5)


@pytest.mark.parametrize("filtered", [ukf, ekf])
def test_missing_samples_count_for_nothing(filtered):
    w, belief, measured = window(np.random.default_rng(3), readout=True)
    gone = np.zeros(25, dtype=bool)
    gone[[0, 7, 24]] = True
    holes = Measurement(np.where(gone, np.nan, measured.reference), measured.noise)
    less = Window(w.net, w.z, w.offset[~gone], w.scale, w.readout[~gone])
    rest = Measurement(measured.reference[~gone], measured.noise[np.ix_(~gone, ~gone)])
    a, info = filtered.update(belief, w, holes, PLAIN)
    b, _ = filtered.update(belief, less, rest, PLAIN)
    np.testing.assert_allclose(a.mean, b.mean, atol=1e-12)
    assert np.isnan(info.innovation[gone]).all() and np.isfinite(info.innovation[~gone]).all()


@pytest.mark.parametrize("filtered", [ukf, ekf])
def test_a_window_without_a_sample_leaves_the_weights(filtered):
    w, belief, measured = window(np.random.default_rng(3))
    nothing = Measurement(np.full(60, np.nan), measured.noise)
    after, info = filtered.update(belief, w, nothing, PLAIN)
    assert not info.used and np.array_equal(after.mean, belief.mean)
    assert np.allclose(after.covariance, belief.covariance + PLAIN.process * np.eye(len(belief.mean)))


@pytest.mark.parametrize("filtered", [ukf, ekf])
def test_a_spikes_pull_stops_growing(filtered):
    w, belief, measured = window(np.random.default_rng(4))
    moved = []
    for size in (1e3, 1e6):
        spiked = measured.reference.copy()
        spiked[5] += size
        after, info = filtered.update(belief, w, Measurement(spiked, measured.noise), FilterSettings(1e-4, 3.0))
        moved.append(after.mean)
        assert info.held_back >= 1
    free, _ = filtered.update(belief, w, Measurement(spiked, measured.noise), PLAIN)
    assert np.abs(moved[1] - moved[0]).max() < 1e-2 < 1e2 < np.abs(free.mean - belief.mean).max()


def test_a_planted_network_is_learned():
    """2 minutes at 20 Hz of noisy outputs of another network of the same shape."""
    rng = np.random.default_rng(5)
    net = Mlp(5, (10, 10), 3)
    truth = initial_weights(net, rng) + 0.3 * rng.standard_normal(net.size)
    belief = initial_belief(initial_weights(net, rng), 0.1)
    errors = []
    for _ in range(120):
        z = rng.standard_normal((20, 5))
        w = Window(net, z, np.zeros(60), np.ones(3))
        y = w.predict(truth)
        errors.append(np.mean((y - w.predict(belief.mean)) ** 2))
        noisy = Measurement(y + 0.05 * rng.standard_normal(60), np.full(60, 0.05**2))
        belief, _ = ukf.update(belief, w, noisy)
    assert np.mean(errors[-10:]) < 0.05 * np.mean(errors[:3])


@pytest.mark.slow
@pytest.mark.parametrize("huber", [3.0, np.inf])
def test_the_covariance_stays_positive_under_garbage(huber):
    """10^5 updates of a small net with inputs and references over 16 decades, missing and infinite ones among them."""
    rng = np.random.default_rng(6)
    net = Mlp(3, (4, 4), 2)
    belief = initial_belief(initial_weights(net, rng), 0.1)
    settings = FilterSettings(1e-9, huber)
    used = 0
    for k in range(100_000):
        z = rng.standard_normal((3, 3)) * 10.0 ** rng.uniform(-8, 8)
        y = rng.standard_normal(6) * 10.0 ** rng.uniform(-8, 8)
        y[rng.random(6) < 0.1] = np.nan
        y[rng.random(6) < 0.01] = np.inf
        noise = np.full(6, 10.0 ** rng.uniform(-12, 4))
        belief, info = ukf.update(belief, Window(net, z, np.zeros(6), np.ones(2)), Measurement(y, noise), settings)
        used += info.used
        if k % 100 == 0:
            assert np.array_equal(belief.covariance, belief.covariance.T)
            assert np.isfinite(belief.mean).all() and np.linalg.eigvalsh(belief.covariance)[0] > 0.0
    assert used > 50_000
