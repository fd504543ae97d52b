"""Learning from a stream of velocities: what is predicted, how an output acts on it, and what is learned."""

from dataclasses import replace

import numpy as np
import pytest

from residual_mpc.learning.filter.kalman import FilterSettings
from residual_mpc.learning.network import low_pass
from residual_mpc.learning.network.mlp import Mlp, forward, initial_weights, input_slope
from residual_mpc.learning.network.residual import Residual
from residual_mpc.learning.stream.samples import (
    Samples,
    feedback_growth,
    initial_memory,
    predict,
    reference_outliers,
    response,
)
from residual_mpc.learning.stream.updates import StreamSettings, learn_stream

NAMES = (("a", "b", "c", "d"), ("v", "w"))
QUICK = StreamSettings(hidden=(6, 6), horizon=10, watch=1.0, replays=2)


def residual(seed: int = 0, size: float = 0.3) -> Residual:
    rng = np.random.default_rng(seed)
    net = Mlp(4, (6, 6), 2)
    theta = initial_weights(net, rng) + size * rng.standard_normal(net.size)
    return Residual(net, theta, *NAMES, 0.1 * rng.standard_normal(4), np.full(4, 1.3), np.array([0.2, 0.4]), "task",
                    0.05, "toy", 6.0)  # fmt: skip


def samples(n: int = 400, fed_back: bool = False, seed: int = 1, noise: float = 0.01) -> Samples:
    """References that follow the planted residual."""
    rng = np.random.default_rng(seed)
    z = rng.standard_normal((n, 4))
    model = 0.5 * z[:, 2:] + 1.0
    bare = Samples(0.05 * np.arange(n), z, model, np.zeros((n, 2)), 0.05, fed_back)
    true = predict([residual(7)], bare, initial_memory(bare)).velocity
    return replace(bare, reference=true + noise * rng.standard_normal((n, 2)))


def test_the_slope_by_the_inputs_is_the_central_difference():
    r, z = residual(), np.random.default_rng(2).standard_normal((5, 4))
    slope, h = input_slope(r.net, r.theta, z), 1e-6
    moved = [(forward(r.net, r.theta, z + h * e) - forward(r.net, r.theta, z - h * e)) / (2 * h) for e in np.eye(4)]
    np.testing.assert_allclose(slope, np.stack(moved, axis=-1), atol=1e-7)


def test_the_filter_is_the_low_pass():
    s, r = samples(30), residual()
    at = predict([r], s, initial_memory(s), 0.2)
    state = low_pass.init(2)
    for k in range(30):
        out, state = low_pass.step(state, r(s.z[k]), 0.05, 0.2)
        np.testing.assert_allclose(at.velocity[k], s.model[k] + out, atol=1e-12)


@pytest.mark.parametrize("fed_back", [False, True])
@pytest.mark.parametrize("time_constant", [0.0, 0.2])
def test_the_response_is_what_a_pushed_output_does(fed_back, time_constant):
    s = samples(8, fed_back)
    r = residual()
    at = predict([r], s, initial_memory(s), time_constant)
    through = response([r], s, at, time_constant)
    through = np.eye(16) if through is None else through
    h = 1e-6
    for o in range(2):
        for j in range(8):
            moved = []
            for sign in (1, -1):
                bump = np.zeros(2)
                bump[o] = sign * h
                velocity, memory = [], initial_memory(s)
                for k in range(8):  # the equation written out, with one output pushed
                    z = s.z[k].copy()
                    if fed_back:
                        z[:2] = memory.velocity
                    d = r(z) + (bump if k == j else 0.0)
                    share = 1.0 if time_constant == 0.0 else 1.0 - np.exp(-0.05 / time_constant)
                    d = memory.delta + share * (d - memory.delta)
                    memory = type(memory)(s.model[k] + d, d)
                    velocity.append(memory.velocity)
                moved.append(np.array(velocity).T.reshape(-1))
            np.testing.assert_allclose(through[:, o * 8 + j], (moved[0] - moved[1]) / (2 * h), atol=1e-6)


@pytest.mark.parametrize("fed_back", [False, True])
@pytest.mark.parametrize("method", ["ukf", "ekf"])
def test_a_planted_residual_is_learned(fed_back, method):
    done = learn_stream(
        samples(fed_back=fed_back), NAMES, "task", "toy", replace(QUICK, method=method), np.random.default_rng(0)
    )
    fresh = samples(100, fed_back, seed=9)
    off = [np.linalg.norm(fresh.reference - predict(r, fresh, initial_memory(fresh)).velocity, axis=1).mean()
           for r in ((), (done.residual,))]  # fmt: skip
    assert off[1] < 0.5 * off[0]
    assert done.h2[-100:].mean() < 0.5 * done.h2[:100].mean()


def test_what_stands_still_is_added_and_left_alone():
    """On top of the planted residual there is nothing left to learn."""
    done = learn_stream(samples(), NAMES, "task", "toy", QUICK, np.random.default_rng(0), (residual(7),))
    assert np.array_equal(done.fixed[0].theta, residual(7).theta)
    assert done.h2[20:].mean() < 1.3 * done.h2[:20].mean() < 0.05


def test_a_sample_is_predicted_before_it_is_learned_from():
    """What comes later changes nothing about what was predicted earlier."""
    s = samples(120)
    spoilt = replace(s, reference=np.where(np.arange(120)[:, None] >= 80, s.reference + 1.0, s.reference))
    a, b = (learn_stream(x, NAMES, "task", "toy", QUICK, np.random.default_rng(0)) for x in (s, spoilt))
    assert np.array_equal(a.velocity[:90], b.velocity[:90]) and not np.array_equal(a.velocity[90:], b.velocity[90:])


def test_without_replays_each_sample_counts_once():
    done = learn_stream(samples(120), NAMES, "task", "toy", replace(QUICK, replays=0), np.random.default_rng(0))
    assert done.updates == 10 == len(done.update_ms)  # (120 - 20) / 10


def test_a_cost_turns_the_learning_towards_its_component():
    """A net too small for both components, told that one of them counts."""
    s = samples(300)
    small = replace(QUICK, hidden=(1, 1), replays=5)
    errors = []
    for costs in ((10.0, 0.1), (0.1, 10.0)):
        done = learn_stream(s, NAMES, "task", "toy", replace(small, costs=costs), np.random.default_rng(0))
        at = predict([done.residual], s, initial_memory(s)).velocity
        errors.append(np.abs(s.reference - at).mean(axis=0))
    assert errors[0][0] < errors[1][0] and errors[1][1] < errors[0][1]


def test_missing_samples_and_spikes_are_borne():
    s = samples()
    rng = np.random.default_rng(3)
    y = s.reference.copy()
    y[rng.random(400) < 0.1] = np.nan
    y[rng.random(400) < 0.03] += 5.0
    done = learn_stream(replace(s, reference=y), NAMES, "task", "toy", QUICK, np.random.default_rng(0))
    at = predict([done.residual], s, initial_memory(s)).velocity
    alone = np.abs(s.reference - s.model).mean()
    assert np.isfinite(done.residual.theta).all() and np.abs(s.reference - at).mean() < 0.7 * alone


def test_spikes_are_found_in_the_reference_alone():
    s = samples(200)
    t = s.t[:, None]
    y = np.hstack([np.sin(0.3 * t), np.cos(0.3 * t)]) + 0.01 * np.random.default_rng(0).standard_normal((200, 2))
    y[[20, 90]] += 0.5
    y[150] = np.nan
    assert np.flatnonzero(reference_outliers(replace(s, reference=y))).tolist() == [20, 90]


def test_feedback_is_kept_from_running_away():
    """Motion that hardly changes leaves any feedback open; what is learned dies away all the same."""
    s = samples(300, fed_back=True)
    still = replace(s, z=np.ones_like(s.z), model=np.ones_like(s.model), reference=s.reference * 0.0 + 1.5)
    done = learn_stream(still, NAMES, "task", "toy", replace(QUICK, kalman=FilterSettings(1e-3)),
                        np.random.default_rng(0))  # fmt: skip
    at = predict([done.residual], still, initial_memory(still))
    assert feedback_growth([done.residual], at.z, 2) <= 0.9 + 0.05
    assert np.abs(at.velocity - 1.5)[-50:].max() < 0.1


@pytest.mark.parametrize("spoil", [{"horizon": 1}, {"stride": 30}, {"costs": (1.0, 0.0)}, {"method": "adam"}])
def test_settings_check_themselves(spoil):
    with pytest.raises(ValueError, match="must be"):
        StreamSettings(**spoil)


def test_a_stream_too_short_says_what_is_wanted():
    with pytest.raises(ValueError, match="record for longer"):
        learn_stream(samples(25), NAMES, "task", "toy", QUICK, np.random.default_rng(0))
