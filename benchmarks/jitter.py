"""What a learning worker does to the timing of a robot's loop: `python -m benchmarks.jitter`.

A loop of 50 Hz that plans for a millisecond, pushes its samples and reads the newest weights, in turns with a learning
worker and without one. How late each turn of the loop begins depends on the machine and on what else it
does: read the two rows against each other.
"""

import time

import click
import numpy as np

from residual_mpc.learning.network.mlp import Mlp, initial_weights
from residual_mpc.learning.network.residual import Residual
from residual_mpc.learning.stream.samples import Samples
from residual_mpc.learning.stream.settings import StreamSettings
from residual_mpc.learning.stream.updates import initial_state
from residual_mpc.learning.stream.worker import Worker

PERIOD, PLAN = 0.02, 0.001  # s: of the loop, and what it computes in each
NAMES = (("model.x", "model.y", "model.theta", "command.left", "command.right"), ("x", "y", "theta"))
SETTINGS = StreamSettings()


@click.command()
@click.option("--seconds", type=click.FloatRange(2.0, 600.0), default=20.0, show_default=True, help="Of a turn.")
@click.option("--turns", type=click.IntRange(1, 20), default=3, show_default=True)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
def jitter(seconds: float, turns: int, seed: int) -> None:
    """Print how late a loop's turns begin, with a learning worker and without one."""
    rng = np.random.default_rng(seed)
    stream = drawn(round((seconds + 4.0) / PERIOD), rng)
    late: dict[bool, list[np.ndarray]] = {False: [], True: []}
    updates, dropped = 0, 0
    for _ in range(turns):
        late[False].append(driven(None, stream, seconds))
        learning = initial_state(stream.take(slice(0, 100)), NAMES, "paper", "rover", SETTINGS, rng)
        with Worker(learning, SETTINGS) as worker:
            time.sleep(2.0)  # it is there before the loop begins
            late[True].append(driven(worker, stream, seconds))
            tally = worker.tally
            updates, dropped = updates + tally.updates, dropped + tally.dropped
    click.echo("| loop of 50 Hz | begins late, median ms | p99 ms | largest ms |")
    click.echo("| --- | --- | --- | --- |")
    for learned, name in ((False, "alone"), (True, "with a learning worker")):
        ms = 1e3 * np.concatenate(late[learned])
        click.echo(f"| {name} | {np.median(ms):.3f} | {np.quantile(ms, 0.99):.2f} | {ms.max():.1f} |")
    click.echo(f"updates {updates}, windows dropped {dropped}, in {turns * seconds:g} s")


def drawn(n: int, rng: np.random.Generator) -> Samples:
    """n samples of a robot whose model lacks a net of this size."""
    net = Mlp(5, (10, 10), 3)
    lacks = Residual(net, 0.5 * initial_weights(net, rng), *NAMES, np.zeros(5), np.ones(5), np.ones(3), "paper", PERIOD)
    z = rng.standard_normal((n, 5))
    model = z[:, :3].copy()
    noise = 0.01 * rng.standard_normal((n, 3))
    return Samples(PERIOD * np.arange(n), z, model, model + lacks(z) + noise, PERIOD)


def driven(worker: Worker | None, stream: Samples, seconds: float) -> np.ndarray:
    """(turns,) s by which each turn of the loop begins late."""
    begun = time.perf_counter() + PERIOD
    late = []
    for k in range(round(seconds / PERIOD)):
        due = begun + k * PERIOD
        time.sleep(max(due - time.perf_counter(), 0.0))
        late.append(time.perf_counter() - due)
        if worker is not None:
            worker.push(stream.take(slice(100 + k, 101 + k)))
            worker.newest()
        end = time.perf_counter() + PLAN
        while time.perf_counter() < end:
            pass
    return np.array(late)


if __name__ == "__main__":
    jitter()
