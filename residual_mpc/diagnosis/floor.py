"""The noise floor: the gap of a perfect model under the sensor noise, start-state error included, by simulation."""

import numpy as np

from residual_mpc.diagnosis.dataset import Dataset, Signal
from residual_mpc.diagnosis.local_fit import local_fit
from residual_mpc.diagnosis.replay import predict
from residual_mpc.logs.signals import fresh_samples
from residual_mpc.models.settings import Settings

DRAWS = 3


def noise_errors(data: Dataset, settings: Settings, rng: np.random.Generator, draws: int = DRAWS) -> np.ndarray:
    """(draws, W, M, C): what measured - predicted would be if the model (settings, one row) were perfect.

    Each draw gives every signal fresh sensor noise, quantised and repeated as in the log, fits the start states
    through it, and replays from there.
    """
    clean = predict(data, settings)[0]
    out = np.empty((draws, *data.y.shape))
    for d in range(draws):
        noise = {key: draw_noise(data, key[1], s, rng) for key, s in data.signals.items()}
        moved = predict(data, settings, start_errors(data, noise))[0]
        seen = np.full(data.y.shape, np.nan)
        for (i, c), n in noise.items():
            k = data.channels.index(c)
            t = data.signals[i, c].t
            for w in np.flatnonzero(data.run == i):
                good = np.isfinite(data.y[w, :, k])
                at = np.searchsorted(t, data.t[w, good] + data.start[w] - 1e-9)
                seen[w, good, k] = n[np.minimum(at, len(n) - 1)]
        out[d] = seen - (moved - clean)
    return out


def draw_noise(data: Dataset, channel: str, signal: Signal, rng: np.random.Generator) -> np.ndarray:
    """(n,) channel unit: white noise of the channel's sigma, its quantisation, and the error of repeated samples."""
    k = data.channels.index(channel)
    sigma, step = data.sigma[k], data.steps[k]
    n = len(signal.y)
    analog = np.sqrt(max(sigma**2 - step**2 / 12.0, 0.0)) * rng.standard_normal(n)
    if step > 0:
        true = signal.y + rng.uniform(-0.5, 0.5, n) * step
        noise = np.round((true + analog) / step) * step - true
    else:
        noise = analog
    fresh = fresh_samples(signal.y)
    if fresh.all() or fresh.sum() < 2:
        return noise
    last = np.maximum.accumulate(np.where(fresh, np.arange(n), 0))
    between = np.interp(signal.t, signal.t[fresh], signal.y[fresh])
    return np.asarray(noise[last] + signal.y[last] - between)


def start_errors(data: Dataset, noise: dict[tuple[int, str], np.ndarray]) -> dict[str, np.ndarray]:
    """Errors of the start states (W,) by channel that a noise on the signals causes."""
    out: dict[str, np.ndarray] = {}
    for block in data.blocks:
        for state in block.robot.states:
            position = np.zeros(data.count)
            rate = np.zeros(data.count)
            for i in np.unique(data.run[block.where]):
                mine = np.flatnonzero(data.run == i)
                for channel in (state.position, state.velocity):
                    signal = data.signals.get((int(i), channel)) if channel else None
                    if signal is None:
                        continue
                    fit = local_fit(signal.t, data.start[mine])
                    if channel == state.position:
                        position[mine] = np.nan_to_num(fit.value(noise[int(i), channel]))
                        rate[mine] = np.nan_to_num(fit.slope(noise[int(i), channel]))
                    else:
                        assert channel is not None
                        rate[mine] = np.nan_to_num(fit.value(noise[int(i), channel]))
            out[state.position] = out.get(state.position, 0.0) + position
            if state.velocity is not None:
                out[state.velocity] = out.get(state.velocity, 0.0) + rate
    return out
