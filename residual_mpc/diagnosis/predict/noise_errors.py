"""The noise floor: the gap of a perfect model under the sensor noise, start-state error included, by simulation."""

import numpy as np

from residual_mpc.diagnosis.data.dataset import Block, Dataset
from residual_mpc.diagnosis.data.local_fit import REACH, local_fit
from residual_mpc.diagnosis.data.noise_model import draw_coloured
from residual_mpc.diagnosis.data.signals import Signal
from residual_mpc.diagnosis.data.window_samples import in_windows
from residual_mpc.diagnosis.predict.replay import earliest, memory_of, predict_moved, run_up
from residual_mpc.effects.effect import Quantity
from residual_mpc.effects.library import changes
from residual_mpc.effects.sensor import low_pass
from residual_mpc.logs.signals import fresh_samples
from residual_mpc.models.sensing import sensor_value
from residual_mpc.models.settings import Settings

TOGETHER = 8  # draws that are replayed at once: bounds the memory


def noise_errors(
    data: Dataset, settings: Settings, rng: np.random.Generator, draws: int, exact: Dataset | None = None
) -> np.ndarray:
    """(draws, W, M, C): what measured - predicted would be if the model (settings, one row) were perfect.

    Each draw gives every signal fresh sensor noise, quantised and repeated as in the log, fits the start states
    through it, and replays from there. exact: the same windows on the steps of the user's model, if `data` has longer
    ones: these do for the difference of two predictions, but a start state from them may be far off near standstill.
    """
    bias = start_bias(data if exact is None else exact, settings)
    fresh = {key: fresh_samples(s.y) for key, s in data.signals.items()}
    out = np.empty((draws, *data.y.shape))
    starts: list[dict[str, np.ndarray]] = []
    for d in range(draws):
        noise = {key: draw_noise(data, key[1], s, fresh[key], rng) for key, s in data.signals.items()}
        starts.append({c: e + bias.get(c, 0.0) for c, e in start_errors(data, settings, noise).items()})
        out[d] = in_windows(data, noise)
    for a in range(0, draws, TOGETHER):
        clean, *moved = predict_moved(data, settings, [{}, *starts[a : a + TOGETHER]])
        for d, one in enumerate(moved, a):
            out[d] -= one - clean
    return out


def start_bias(data: Dataset, settings: Settings) -> dict[str, np.ndarray]:
    """Error of the start states (W,) by channel that the local quadratics make without any noise.

    Where a command jumps between two samples, no quadratic follows the motion. The model's own motion through each
    start, replayed from a quarter second before it, or from the start itself where the run begins there, is sampled as
    the log is, fitted, and compared with itself. Zero where the run begins in between.
    """
    out: dict[str, np.ndarray] = {}
    left = np.zeros(data.count, dtype=bool)
    for block in data.blocks:
        here = settings.of_group(block.group)
        nodes, reaches = run_up(data, block, here, REACH)
        _add_bias(out, data, block, here, nodes, reaches, REACH)
        left[block.where] = ~reaches
    if left.any():
        few, first = data.take(left), dict[str, np.ndarray]()
        for block in few.blocks:
            here = settings.of_group(block.group)
            nodes, reaches = run_up(few, block, here, 0.0)
            _add_bias(first, few, block, here, nodes, reaches, 0.0)
        for channel, bias in first.items():
            out[channel][left] = bias
    return out


def _add_bias(
    out: dict[str, np.ndarray],
    data: Dataset,
    block: Block,
    settings: Settings,
    nodes: dict[str, np.ndarray],
    reaches: np.ndarray,
    sooner: float,
) -> None:
    """See `start_bias`; of the windows (W_block,) bool of a block alone, whose nodes begin `sooner` s before them."""
    begin = earliest(block, settings)[0][:, None] + sooner  # (W_block, 1) s from the first node to the start
    dt, rows = block.drive.dt, np.arange(data.count)[block.where]
    for state in block.robot.states:
        for channel, source, slope in state.sources:
            bias = out.setdefault(channel, np.zeros(data.count))
            for i in np.unique(data.run[rows]):
                signal = data.signals.get((int(i), source))
                mine = np.flatnonzero((data.run[rows] == i) & reaches)
                if signal is None or not len(mine):
                    continue
                fit = local_fit(signal.t, data.start[rows[mine]])
                at = signal.t[fit.index] - data.start[rows[mine], None] + begin[mine]  # (W_i, 5) s on the nodes
                line, lag = nodes[source][mine], _number(block, settings, "reading lag", source, 0.0)
                if lag > 0.0:  # from a memory as of a steady motion before
                    line = low_pass(line, line[:, 0] - lag * (line[:, 1] - line[:, 0]) / dt, lag, dt)
                seen = at_times(line, at, dt)
                weights = fit.slope_weights if slope else fit.value_weights
                if lag > 0.0:
                    weights = weights + lag * (fit.curvature_weights if slope else fit.slope_weights)
                true = at_times(nodes[channel][mine], begin[mine], dt)[:, 0]
                error = np.nan_to_num(np.einsum("qi,qi->q", weights, seen) - true)
                covered = (np.where(fit.value_weights != 0.0, at, 0.0) >= -1e-9).all(axis=1)
                bias[rows[mine]] = np.where(covered, error, 0.0)


def at_times(nodes: np.ndarray, t: np.ndarray, dt: float) -> np.ndarray:
    """(W, n) linear between nodes (W, K) at times t (W, n) s from the first node."""
    place = np.clip(t / dt, 0.0, nodes.shape[1] - 1.001)
    k = place.astype(int)
    low, high = np.take_along_axis(nodes, k, axis=1), np.take_along_axis(nodes, k + 1, axis=1)
    return np.asarray(low + (place - k) * (high - low))


def draw_noise(data: Dataset, channel: str, signal: Signal, fresh: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n,) channel unit: white and coloured noise of the channel, its quantisation, and the error of samples that are
    not fresh (n,) bool but repeated."""
    k = data.channels.index(channel)
    noise_of, step = data.noise[k], data.steps[k]
    n = len(signal.y)
    analog = np.sqrt(max(noise_of.white**2 - step**2 / 12.0, 0.0)) * rng.standard_normal(n)
    if noise_of.coloured:
        analog = analog + draw_coloured(noise_of, signal.t, rng)
    if step > 0:
        true = signal.y + rng.uniform(-0.5, 0.5, n) * step
        noise = np.round((true + analog) / step) * step - true
    else:
        noise = analog
    if fresh.all() or fresh.sum() < 2:
        return noise
    last = np.maximum.accumulate(np.where(fresh, np.arange(n), 0))
    between = np.interp(signal.t, signal.t[fresh], signal.y[fresh])
    return np.asarray(noise[last] + signal.y[last] - between)


def start_errors(data: Dataset, settings: Settings, noise: dict[tuple[int, str], np.ndarray]) -> dict[str, np.ndarray]:
    """Errors of the start states (W,) by channel that a noise on the signals causes under one hypothesis."""
    out: dict[str, np.ndarray] = {}
    for block in data.blocks:
        here, windows = settings.of_group(block.group), np.arange(data.count)[block.where]
        for state in block.robot.states:
            position, rate = np.zeros(data.count), np.zeros(data.count)
            memory = {c: np.zeros(data.count) for c in (state.position, state.velocity) if c}
            for i in np.unique(data.run[windows]):
                mine = windows[data.run[windows] == i]
                for channel in memory:
                    signal = data.signals.get((int(i), channel))
                    if signal is None:
                        continue
                    fit, n = local_fit(signal.t, data.start[mine]), noise[int(i), channel]
                    lag = _number(block, here, "reading lag", channel, 0.0)
                    scale = _number(block, here, "reading scale", channel, 1.0)
                    memory[channel][mine] = np.nan_to_num(fit.value(n)) / scale
                    value = memory[channel][mine]
                    if lag > 0.0:
                        value = value + lag * np.nan_to_num(fit.slope(n)) / scale
                    if channel == state.position:
                        slope = np.nan_to_num(fit.slope(n)) / scale
                        if lag > 0.0:
                            slope = slope + lag * np.nan_to_num(fit.curvature(n)) / scale
                        position[mine], rate[mine] = value, slope
                    else:
                        rate[mine] = value
            out[state.position] = out.get(state.position, 0.0) + position
            if state.velocity is not None:
                out[state.velocity] = out.get(state.velocity, 0.0) + rate
            for channel, error in memory.items():
                if changes(settings.effects, "reading lag") is not None:
                    out[memory_of(channel)] = out.get(memory_of(channel), 0.0) + error
    return out


def _number(block: Block, settings: Settings, quantity: Quantity, channel: str, null: float) -> float:
    """A quantity of a channel's readings under one hypothesis."""
    value = sensor_value(block.robot, settings, quantity, channel)
    return null if value is None else float(value[0])
