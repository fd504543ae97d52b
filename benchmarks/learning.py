"""What one update of the residual's filter costs, beside two general libraries: `python -m benchmarks.learning`.

Horizon 20, three outputs (60 measurements), float64, one thread; milliseconds of the process, so that what else the
machine does is not counted. The two libraries are needed by this benchmark alone:
`pip install filterpy dynamax`. Each is given the network vectorised over the horizon, so that what is compared is the
filter; dynamax maps it over the sigma points in compiled code, filterpy calls it point by point in a loop of its own.
"""

# ruff: noqa: E402 (the threads have to be set before numpy loads)
from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before numpy and scipy load theirs: two threads make nets of this size slower
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
os.environ["JAX_ENABLE_X64"] = "1"

from collections.abc import Callable
from dataclasses import dataclass
from time import process_time

import click
import numpy as np

from residual_mpc.learning.filter import ekf, ukf
from residual_mpc.learning.filter.kalman import Belief, FilterSettings, Measurement, initial_belief
from residual_mpc.learning.filter.window import Window
from residual_mpc.learning.filter.workspace import Workspace
from residual_mpc.learning.network.mlp import Mlp, forward, initial_weights

SIZES = ((10, 10), (20, 20), (40, 40))  # 203, 603 and 2003 weights
HORIZON = 20
SETTINGS = FilterSettings()


@dataclass(frozen=True)
class Case:
    """One update: a net at HORIZON instants, references, and a belief that has seen some data."""

    window: Window
    measured: Measurement
    belief: Belief


@click.command()
@click.option("--updates", type=click.IntRange(min=3), default=200, show_default=True, help="Of the smallest net.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
def learning(updates: int, seed: int) -> None:
    """Print the milliseconds of an update, median and 99th percentile, by method and size."""
    click.echo("| weights | method | median ms | p99 ms | times the UKF here |")
    click.echo("| --- | --- | --- | --- | --- |")
    for hidden in SIZES:
        case = make(hidden, np.random.default_rng(seed))
        size = case.window.net.size
        count = max(3, updates * 203**2 // size**2)
        workspace = Workspace()
        methods: dict[str, Callable[[], object]] = {
            "UKF": lambda case=case, workspace=workspace: ukf.update(
                case.belief, case.window, case.measured, SETTINGS, workspace=workspace
            ),
            "EKF": lambda case=case: ekf.update(case.belief, case.window, case.measured, SETTINGS),
        }
        if hidden == SIZES[0]:
            methods |= others(case)
        ours = 0.0
        for name, call in methods.items():
            ms = timed(call, count if name in ("UKF", "EKF") else max(5, count // 20))
            ours = ours or float(np.median(ms))
            middle = float(np.median(ms))
            click.echo(f"| {size} | {name} | {middle:.2f} | {np.quantile(ms, 0.99):.2f} | {middle / ours:.1f} |")


def make(hidden: tuple[int, ...], rng: np.random.Generator) -> Case:
    net = Mlp(5, hidden, 3)
    window = Window(net, rng.standard_normal((HORIZON, 5)), np.zeros(3 * HORIZON), np.ones(3))
    belief = initial_belief(initial_weights(net, rng) + 0.1 * rng.standard_normal(net.size), 0.1)
    for _ in range(3):  # a covariance that is full
        seen = Window(net, rng.standard_normal((HORIZON, 5)), window.offset, window.scale)
        measured = Measurement(rng.standard_normal(3 * HORIZON), np.full(3 * HORIZON, 0.1))
        belief, _ = ekf.update(belief, seen, measured, SETTINGS)
    return Case(window, Measurement(rng.standard_normal(3 * HORIZON), np.full(3 * HORIZON, 0.1)), belief)


def timed(call: Callable[[], object], count: int) -> np.ndarray:
    """(count,) ms, after two calls that warm up."""
    call(), call()
    out = []
    for _ in range(count):
        begun = process_time()
        call()
        out.append(1e3 * (process_time() - begun))
    return np.array(out)


def others(case: Case) -> dict[str, Callable[[], object]]:
    """The libraries that are installed; those that are not are named on stderr."""
    found: dict[str, Callable[[], object]] = {}
    for name, build in (("filterpy", of_filterpy), ("dynamax", of_dynamax)):
        try:
            found[f"{name} UKF"] = build(case)
        except ImportError as error:
            click.echo(f"{name} is left out ({error}): pip install {name}", err=True)
    return found


def of_filterpy(case: Case) -> Callable[[], object]:
    """Predict and update of filterpy's UKF on the same belief."""
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    size, m = case.window.net.size, 3 * HORIZON
    net, z = case.window.net, case.window.z
    points = MerweScaledSigmaPoints(size, alpha=0.1, beta=2.0, kappa=0.0)
    f = UnscentedKalmanFilter(
        size, m, 1.0, lambda theta: forward(net, theta, z).T.reshape(-1), lambda theta, dt: theta, points
    )
    f.Q, f.R = SETTINGS.process * np.eye(size), np.diag(case.measured.noise)

    def call() -> None:
        f.x, f.P = case.belief.mean.copy(), case.belief.covariance.copy()
        f.predict()
        f.update(case.measured.reference)

    return call


def of_dynamax(case: Case) -> Callable[[], object]:
    """One step of dynamax's UKF, compiled, on the same belief."""
    import jax
    import jax.numpy as jnp
    from dynamax.nonlinear_gaussian_ssm import ParamsNLGSSM, UKFHyperParams, unscented_kalman_filter

    net, z = case.window.net, jnp.asarray(case.window.z)

    def emission(theta):  # type: ignore[no-untyped-def]
        a, at, widths = z, 0, net.widths
        for i, (n, k) in enumerate(zip(widths, widths[1:], strict=False)):
            a = a @ theta[at : at + n * k].reshape(k, n).T + theta[at + n * k : at + (n + 1) * k]
            a = a if i == len(widths) - 2 else jnp.maximum(net.slope * a, a)
            at += (n + 1) * k
        return a.T.reshape(-1)

    params = ParamsNLGSSM(
        jnp.asarray(case.belief.mean),
        jnp.asarray(case.belief.covariance),
        lambda theta: theta,
        SETTINGS.process * jnp.eye(net.size),
        emission,
        jnp.diag(jnp.asarray(case.measured.noise)),
    )
    seen = jnp.asarray(case.measured.reference)[None]
    step = jax.jit(lambda y: unscented_kalman_filter(params, y, UKFHyperParams(0.1, 2, 0)).filtered_means)
    return lambda: step(seen).block_until_ready()


if __name__ == "__main__":
    learning()
