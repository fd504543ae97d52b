"""The paper's learning law on a stream of velocities: one update after every `stride` samples, over the last N.

Explicit memory: `begin(first samples) -> Learning`, `step(settings, learning, new samples) -> (Learning, Step)`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np

from residual_mpc.learning.batch.window_linearisation import cost_of
from residual_mpc.learning.filter import ekf, ukf
from residual_mpc.learning.filter.guarded_update import guarded_update
from residual_mpc.learning.filter.kalman import Belief, Measurement, UpdateInfo, initial_belief
from residual_mpc.learning.filter.window import Window
from residual_mpc.learning.filter.workspace import Workspace
from residual_mpc.learning.network.mlp import Mlp, initial_weights
from residual_mpc.learning.network.residual import Residual
from residual_mpc.learning.stream.samples import (
    Memory,
    Prediction,
    Samples,
    feedback_growth,
    h2_norms,
    initial_memory,
    predict,
    response,
)
from residual_mpc.learning.stream.settings import StreamSettings

LIMIT = 6.0  # input scales
SURPRISE, CHANGED = 6.0, 2  # times the error of late, windows in a row
TOLD = 0.1  # of the residual's own size squared, below which no error is a surprise
LOOKED_BACK = 10  # windows
STABLE = 0.9  # largest factor by which what feeds back may live on from sample to sample: a lag of ten samples
NORMAL = 0.455  # median square of a normal number


@dataclass(frozen=True, eq=False)
class PastWindow:
    """A window that was learned from, the memory before it, and what the network saw (N, inputs)."""

    window: Samples
    memory: Memory
    z: np.ndarray


@dataclass(frozen=True, eq=False)
class LearnerState:
    """Between two updates. residual: with the weights at hand. fixed: what is not learned, added to it. tail: samples
    of the window that stay in the next one, and the memory before them. error (outputs,): mean square of late. past:
    what may be learned from again. surprised: windows in a row that were far worse than of late."""

    residual: Residual
    fixed: tuple[Residual, ...]
    belief: Belief
    tail: Samples
    memory: Memory
    error: np.ndarray
    past: tuple[PastWindow, ...] = ()
    updates: int = 0
    surprised: int = 0
    workspace: Workspace = field(default_factory=Workspace)

    @property
    def all(self) -> tuple[Residual, ...]:
        return (*self.fixed, self.residual)


@dataclass(frozen=True, eq=False)
class StreamStep:
    """What one update saw: velocity (n, outputs) predicted of the new samples before it, h2 (n,) their H2 norms; ms of
    the filter; info None where it was left out."""

    velocity: np.ndarray
    h2: np.ndarray
    update_ms: float
    info: UpdateInfo | None


def initial_state(
    seen: Samples,
    names: tuple[tuple[str, ...], tuple[str, ...]],
    form: str,
    robot: str,
    settings: StreamSettings,
    rng: np.random.Generator,
    fixed: Sequence[Residual] = (),
) -> LearnerState:
    """A residual of zero whose scales are those of the samples `seen`; names: of inputs and outputs."""
    o = seen.model.shape[1]
    at = predict(tuple(fixed), seen, initial_memory(seen))
    off = seen.reference - at.velocity
    size = np.sqrt(np.nanmedian(off**2, axis=0) / NORMAL)
    size = np.where(np.isfinite(size), size, 0.0)
    size = np.maximum(size, 1e-6 * (1.0 + size.max(initial=0.0)))
    mean, spread = at.z.mean(axis=0), at.z.std(axis=0)
    if seen.fed_back:  # what is fed back moves by what is learned as well
        spread[:o] = np.hypot(spread[:o], size)
    spread = np.where(spread > 1e-6 * (1.0 + np.abs(at.z).max(axis=0)), spread, 1.0)  # a constant says nothing
    net = Mlp(at.z.shape[1], settings.hidden, o)
    theta = initial_weights(net, rng)
    residual = Residual(net, theta, *names, mean, spread, size, form, seen.step, robot, LIMIT)
    return LearnerState(
        residual, tuple(fixed), initial_belief(theta, settings.variance), seen.take(slice(0, 0)), at.before[-1], size**2
    )


def step(
    settings: StreamSettings, learning: LearnerState, new: Samples, rng: np.random.Generator
) -> tuple[LearnerState, StreamStep]:
    """Predict the new samples, then update over the last N. What was predicted had not been learned from."""
    window = learning.tail.then(new)
    at = predict(learning.all, window, learning.memory, settings.low_pass)
    n = len(new)
    h2 = h2_norms(new, at.velocity[-n:])
    now = _mean_square(learning.error, window.reference - at.velocity)
    error = learning.error + (np.minimum(now, 9.0 * learning.error) - learning.error) / settings.memory
    before = learning.error
    keep = min(len(window), settings.horizon - settings.new)
    tail, memory = window.take(slice(len(window) - keep, None)), at.before[len(window) - keep]
    learning = replace(learning, tail=tail, memory=memory, error=error)
    if len(window) < settings.horizon:
        return learning, StreamStep(at.velocity[-n:], h2, 0.0, None)
    learning = _surprised(settings, learning, float(np.mean(now / (before + TOLD * learning.residual.output_scale**2))))
    learning, info, ms = _learned(settings, learning, window, at.before[0])
    old = learning.past
    for k in rng.integers(len(old), size=min(settings.replays, len(old))) if old else ():
        learning, _, _ = _learned(settings, learning, old[k].window, old[k].memory)
    learning = replace(learning, past=(*old, PastWindow(window, at.before[0], at.z))[-settings.kept :])
    return learning, StreamStep(at.velocity[-n:], h2, ms, info)


def _learned(
    settings: StreamSettings, learning: LearnerState, window: Samples, memory: Memory
) -> tuple[LearnerState, UpdateInfo, float]:
    at = predict(learning.all, window, memory, settings.low_pass)
    belief, info, ms = _update(settings, learning, window, at, memory)
    residual = learning.residual.with_theta(belief.mean)
    return replace(learning, residual=residual, belief=belief, updates=learning.updates + 1), info, ms


def _update(
    settings: StreamSettings, learning: LearnerState, window: Samples, at: Prediction, memory: Memory
) -> tuple[Belief, UpdateInfo, float]:
    """The Kalman update over the window, halved while it makes the window itself worse."""
    r, o = learning.residual, window.model.shape[1]
    cost = np.repeat(np.ones(o) if settings.costs is None else np.array(settings.costs), len(window))
    through = response(learning.all, window, at, settings.low_pass)
    own = r(at.z).T.reshape(-1)
    stacked = cost * at.velocity.T.reshape(-1)
    readout = np.diag(cost) if through is None else cost[:, None] * through
    bare = stacked - readout @ own
    filtered = Window(r.net, r.scaled(at.z), bare, r.output_scale, readout, learning.workspace)
    if through is None and settings.costs is None:
        filtered = replace(filtered, readout=None)
    noise = np.broadcast_to(np.asarray(settings.noise) ** 2, (o,)) + settings.goal**2 * learning.error
    measured = Measurement(cost * window.reference.T.reshape(-1), np.repeat(noise, len(window)))
    begun = perf_counter()
    after, info = _filter(settings, learning)(learning.belief, filtered, measured)
    ms = 1e3 * (perf_counter() - begun)
    return _no_worse(settings, learning, window, at, memory, measured, stacked, cost, after), info, ms


def _filter(settings: StreamSettings, learning: LearnerState) -> Callable[..., tuple[Belief, UpdateInfo]]:
    if settings.method == "ekf":
        return lambda b, w, m: ekf.update(b, w, m, settings.kalman)
    return lambda b, w, m: ukf.update(b, w, m, settings.kalman, workspace=learning.workspace)


def _no_worse(
    settings: StreamSettings,
    learning: LearnerState,
    window: Samples,
    at: Prediction,
    memory: Memory,
    measured: Measurement,
    predicted: np.ndarray,
    cost: np.ndarray,
    after: Belief,
) -> Belief:
    """The update, shortened until the window is explained no worse and what feeds back dies away; motion that hardly
    changes would leave any feedback open."""
    good = np.isfinite(measured.reference)
    seen = Measurement(measured.reference[good], np.diag(measured.noise[good]))
    first = cost_of(seen, predicted[good])
    known = np.concatenate([p.z for p in learning.past[:: max(1, len(learning.past) // LOOKED_BACK)]] or [at.z])

    def accepts(theta: np.ndarray) -> bool:
        tried = (*learning.fixed, learning.residual.with_theta(theta))
        velocity = predict(tried, window, memory, settings.low_pass).velocity
        fair = cost_of(seen, (cost * velocity.T.reshape(-1))[good]) <= first
        return fair and (not window.fed_back or feedback_growth(tried, known, window.model.shape[1]) <= STABLE)

    return guarded_update(learning.belief, after, accepts, settings.halvings, settings.kalman)[0]


def _mean_square(before: np.ndarray, error: np.ndarray) -> np.ndarray:
    """(outputs,) of a window's errors (n, outputs), by their median; `before` where nothing was seen."""
    seen = np.isfinite(error).any(axis=0)
    with np.errstate(invalid="ignore"):
        return np.where(seen, np.nanmedian(np.where(seen, error, 0.0) ** 2, axis=0) / NORMAL, before)


def _surprised(settings: StreamSettings, learning: LearnerState, surprise: float) -> LearnerState:
    """A robot that has changed: what was seen before is forgotten, and every weight may move again.

    surprise: a window's mean square error over that of late (and what is small in any case). One such window is a slip;
    CHANGED in a row are another robot.
    """
    count = learning.surprised + 1 if surprise > SURPRISE and learning.past else 0
    if count < CHANGED:
        return replace(learning, surprised=count)
    p = learning.belief.covariance + settings.variance * np.eye(len(learning.belief.mean))
    return replace(learning, belief=Belief(learning.belief.mean, p), past=(), surprised=0)


@dataclass(frozen=True, eq=False)
class StreamResult:
    """A whole stream gone through. residual: the last weights; fixed: what it was learned on top of; velocity (n,
    outputs) and h2 (n,): predicted at each sample before it was learned from; update_ms (k,) of the filter, each of
    the updates on new samples; updates: all of them."""

    residual: Residual
    fixed: tuple[Residual, ...]
    velocity: np.ndarray
    h2: np.ndarray
    update_ms: np.ndarray
    updates: int


def learn_stream(
    samples: Samples,
    names: tuple[tuple[str, ...], tuple[str, ...]],
    form: str,
    robot: str,
    settings: StreamSettings,
    rng: np.random.Generator,
    fixed: Sequence[Residual] = (),
) -> StreamResult:
    """Sample after sample, as they would come in. Raises ValueError where they end before the first update."""
    at = max(2, round(settings.watch / samples.step))
    if len(samples) < at + settings.horizon:
        raise ValueError(
            f"at least {at} samples to set the scales and {settings.horizon} to learn from are needed, "
            f"got {len(samples)}: record for longer"
        )
    head = samples.take(slice(0, at))
    learning = initial_state(head, names, form, robot, settings, rng, fixed)
    first = predict(learning.all, head, initial_memory(head), settings.low_pass)
    velocity, h2, ms = [first.velocity], [h2_norms(head, first.velocity)], []
    while at < len(samples):
        new = samples.take(slice(at, at + settings.new))
        learning, done = step(settings, learning, new, rng)
        velocity.append(done.velocity)
        h2.append(done.h2)
        if done.info is not None:
            ms.append(done.update_ms)
        at += settings.new
    return StreamResult(
        learning.residual, learning.fixed, np.concatenate(velocity), np.concatenate(h2), np.array(ms), learning.updates
    )
