"""Learning beside a loop: in a process of its own, without waiting, through its death, and after the robot changed."""

import os
import signal
import time
from dataclasses import replace

import numpy as np
import pytest

from residual_mpc.learning.network.mlp import Mlp, initial_weights
from residual_mpc.learning.network.residual import Residual
from residual_mpc.learning.stream.samples import Samples, initial_memory, predict
from residual_mpc.learning.stream.settings import StreamSettings
from residual_mpc.learning.stream.updates import initial_state, learn_stream
from residual_mpc.learning.stream.worker import Worker

NAMES = (("a", "b", "c"), ("v", "w"))
QUICK = StreamSettings(hidden=(6, 6), horizon=10, watch=1.0, replays=2)


def samples(n: int, seed: int, robot: int = 0) -> Samples:
    rng = np.random.default_rng(seed)
    net = Mlp(3, (5,), 2)
    drawn = np.random.default_rng(robot)
    theta = initial_weights(net, drawn) + 0.5 * drawn.standard_normal(net.size)
    true = Residual(net, theta, *NAMES, np.zeros(3), np.ones(3), np.ones(2), "task", 0.05)
    z = rng.standard_normal((n, 3))
    model = z[:, :2].copy()
    return Samples(0.05 * np.arange(n), z, model, model + true(z) + 0.01 * rng.standard_normal((n, 2)), 0.05)


def error(residual: Residual, at: Samples) -> float:
    return float(np.abs(at.reference - predict([residual], at, initial_memory(at)).velocity).mean())


def wait(true, seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not true() and time.monotonic() < end:
        time.sleep(0.01)
    assert true()


def fed(worker: Worker, stream: Samples, updates: int) -> None:
    """Push window after window until so many updates are made."""
    for k in range(0, len(stream) - 9, 10):
        if worker.tally.updates >= updates:
            return
        worker.push(stream.take(slice(k, k + 10)))
        time.sleep(0.02)
    wait(lambda: worker.tally.updates >= updates)


def test_a_worker_learns_beside_the_loop_and_through_its_death():
    head, stream, fresh = samples(20, 1), samples(20_000, 2), samples(200, 3)
    learning = initial_state(head, NAMES, "task", "toy", QUICK, np.random.default_rng(0))
    first = error(learning.residual, fresh)
    with Worker(learning, QUICK) as worker:
        assert np.array_equal(worker.newest().theta, learning.residual.theta)
        fed(worker, stream, 25)
        once = error(worker.newest(), fresh)
        assert once < 0.6 * first
        gone = worker.pid
        os.kill(gone, signal.SIGKILL)
        wait(lambda: worker.tally.restarts == 1 and worker.tally.alive)
        assert worker.pid != gone
        assert error(worker.newest(), fresh) == once  # nothing is forgotten
        begun = time.perf_counter()
        worker.push(stream.take(slice(0, 10)))
        worker.newest()
        assert time.perf_counter() - begun < 0.05
        fed(worker, samples(20_000, 4), worker.tally.updates + 25)
        assert error(worker.newest(), fresh) < 1.1 * once
    assert not worker.tally.alive


def test_windows_that_there_is_no_time_for_are_counted():
    learning = initial_state(samples(20, 1), NAMES, "task", "toy", QUICK, np.random.default_rng(0))
    with Worker(learning, QUICK) as worker:
        fed(worker, samples(20_000, 2), 1)
        before = worker.tally
        worker.push(samples(1000, 5))  # a hundred windows at once, more than the ring holds
        wait(lambda: worker.tally.updates > before.updates and worker.tally.dropped - before.dropped > 80)
        assert np.isfinite(worker.newest().theta).all()


@pytest.mark.parametrize("replays", [0, 5])
def test_a_robot_that_changes_in_mid_run_is_followed(replays):
    whole = samples(600, 1, robot=0).then(samples(600, 2, robot=1))
    whole = replace(whole, t=0.05 * np.arange(1200))
    done = learn_stream(whole, NAMES, "task", "toy", replace(QUICK, replays=replays), np.random.default_rng(0))
    before, changed, after = done.h2[500:600].mean(), done.h2[600:620].mean(), done.h2[-100:].mean()
    assert changed > 3.0 * before  # it is felt
    assert after < 1.5 * before + 0.01  # and recovered from
