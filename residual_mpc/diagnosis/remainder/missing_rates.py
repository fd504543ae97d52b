"""What is left as the response to missing rates: channel by channel, at a few instants of each window.

A rate (or acceleration) that the model lacks shows in a window as its integral, or as the model's own response to a
kick of that rate, so nothing noisy is differentiated: what may cause the remainder goes through the same response.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.diagnosis.predict.replay import predict_moved
from residual_mpc.diagnosis.remainder.settings import RemainderSettings
from residual_mpc.models.settings import Settings

POSE = ("pose.x", "pose.y", "pose.theta")


@dataclass(frozen=True, eq=False)
class MissingRate:
    """One component of what is left, over W windows of M samples, at I instants.

    name: a channel, or "forward", "sideways" and "yaw" of a planar pose, in the robot's frame. unit: of the missing
    rate. error (W, I) measured - predicted, in sizes of the motion; noise: the mean square of a perfect model's.
    response (W, I, M): times a rate (W, M) that the model lacked, the error that it makes. used (W,) bool.
    """

    name: str
    unit: str
    error: np.ndarray
    noise: float
    response: np.ndarray
    used: np.ndarray

    @property
    def beyond(self) -> float:
        """The sum of squares beyond the noise."""
        return max(float(np.sum(self.error[self.used] ** 2)) - self.noise * self.error[self.used].size, 0.0)


def missed_of(
    data: Dataset,
    scales: Scales,
    settings: Settings,
    predicted: np.ndarray,
    error: np.ndarray,
    floors: np.ndarray,
    tuning: RemainderSettings,
) -> tuple[MissingRate, ...]:
    """Every component that is compared and moves. predicted, error (W, M, C); floors (draws, W, M, C): errors of a
    perfect model under the noise; settings: one row."""
    out: list[MissingRate] = []
    index = {c: k for k, c in enumerate(data.channels)}
    planar = set(POSE) <= set(index) and bool(data.compared[:, [index[c] for c in POSE]].all())
    if planar:
        out += _planar(data, scales, index, predicted, error, floors, settings=tuning)
    rates = kicks(data, settings, scales, tuning=tuning)
    for k, channel in enumerate(data.channels):
        if scales.still[k] or not data.compared[:, k].any() or (planar and channel in POSE):
            continue
        e = np.where(data.compared[:, None, k], error[..., k], np.nan) / scales.s[k]
        at, used = instants(np.isfinite(e), settings=tuning)
        response, unit = response_of(data, channel, rates, at)
        noise = float(np.nanmean(np.where(np.isfinite(e), floors[..., k] / scales.s[k], np.nan) ** 2))
        shown = np.where(used[:, None], np.take_along_axis(e, at, axis=1), 0.0)
        used = used & np.isfinite(response).all(axis=(1, 2))
        out.append(MissingRate(channel, unit, shown, noise, np.nan_to_num(response) / scales.s[k], used))
    return tuple(out)


def tempered(m: MissingRate, settings: RemainderSettings) -> MissingRate:
    """The same with less weight for windows in which far more is left than in most: one in which a robot fell, or ran
    into something, is not to decide what the rest depends on."""
    size = np.sqrt(np.mean(m.error**2, axis=1))
    most = (
        settings.missing_rates.large * float(np.quantile(size[m.used], settings.missing_rates.usual))
        if m.used.any()
        else 0.0
    )
    weight = np.minimum(1.0, most / np.maximum(size, 1e-30))
    return replace(
        m,
        error=m.error * weight[:, None],
        response=m.response * weight[:, None, None],
        noise=m.noise * float(np.mean(weight[m.used] ** 2)) if m.used.any() else m.noise,
    )


def travelled(pose: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(W, M, 3) way forward and to the left (m) and turn (rad) in the robot's frame since the first sample `seen`
    (W, M); NaN where not seen. pose (W, M, 3): x, y, theta."""
    out = np.full(pose.shape, np.nan)
    for w, keep in enumerate(seen):
        if keep.sum() < 2:
            continue
        px, py, heading = pose[w, keep].T
        middle = 0.5 * (heading[1:] + heading[:-1])
        c, s, dx, dy = np.cos(middle), np.sin(middle), np.diff(px), np.diff(py)
        steps = np.stack([c * dx + s * dy, c * dy - s * dx, np.diff(heading)], axis=1)
        out[w, keep] = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    return out


def _planar(
    data: Dataset,
    scales: Scales,
    index: Mapping[str, int],
    predicted: np.ndarray,
    error: np.ndarray,
    floors: np.ndarray,
    settings: RemainderSettings,
) -> list[MissingRate]:
    """The pose's error, undone of the heading: each of the robot's own three rates is then an integral away."""
    where = [index[c] for c in POSE]
    seen = np.isfinite(error[..., where]).all(axis=2)
    model = travelled(predicted[..., where], seen)
    truth = travelled((predicted + error)[..., where], seen)
    at, used = instants(seen, settings=settings)
    integral = _integral(data.t, at)
    integral = integral - integral.mean(axis=1, keepdims=True)  # the start's own error is no rate
    out = []
    noisy = [travelled((predicted + f)[..., where], seen) - model for f in floors[:4]]
    for k, (name, unit) in enumerate((("forward", "m/s"), ("sideways", "m/s"), ("yaw", "rad/s"))):
        channel = where[2 if k == 2 else 0]
        if scales.still[channel]:
            continue
        size = scales.s[channel]
        e, *n = (_centred(d[..., k], at)[used] / size for d in (truth - model, *noisy))
        shown = np.zeros(at.shape)
        shown[used] = e
        out.append(MissingRate(name, unit, shown, float(np.mean(np.square(n))), integral / size, used))
    return out


def _centred(x: np.ndarray, at: np.ndarray) -> np.ndarray:
    picked = np.take_along_axis(x, at, axis=1)
    return np.asarray(picked - picked.mean(axis=1, keepdims=True))


def instants(seen: np.ndarray, settings: RemainderSettings) -> tuple[np.ndarray, np.ndarray]:
    """(W, I) indices of samples that are seen, evenly spread over each window and without its first; (W,) whether the
    window has enough of them."""
    at = np.zeros((len(seen), settings.missing_rates.instants), dtype=int)
    used = seen.sum(axis=1) >= 4
    for w in np.flatnonzero(used):
        there = np.flatnonzero(seen[w])
        at[w] = there[np.linspace(1, len(there) - 1, settings.missing_rates.instants).round().astype(int)]
    return at, used


def _integral(t: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(W, I, M) by trapezoids from the first sample to each instant; t (W, M) s, NaN where padded."""
    w, m = t.shape
    gap = np.nan_to_num(np.diff(t, axis=1))
    halves = np.zeros((w, m, m))
    k = np.arange(m - 1)
    halves[:, k + 1, k] += 0.5 * gap
    halves[:, k + 1, k + 1] += 0.5 * gap
    return np.asarray(np.take_along_axis(np.cumsum(halves, axis=1), at[:, :, None], axis=1))


def kicks(
    data: Dataset, settings: Settings, scales: Scales, tuning: RemainderSettings
) -> dict[str, tuple[np.ndarray, str]]:
    """For each state's position channel: its response (W, M) to a kick of its start's rate, or of its start where it
    has no rate, per unit of the kick; and the unit of what is then missing."""
    states = [
        s
        for s in dict.fromkeys(s for b in data.blocks for s in b.robot.states)
        if s.position in data.channels and s.position not in POSE
    ]
    sizes = [tuning.missing_rates.kick * scales.s[data.channels.index(s.position)] for s in states]
    starts: list[dict[str, np.ndarray]] = [
        {s.position if s.velocity is None else s.velocity: np.full(data.count, size)}
        for s, size in zip(states, sizes, strict=True)
    ]
    base, *moved = predict_moved(data, settings, [{}, *starts])
    out: dict[str, tuple[np.ndarray, str]] = {}
    for s, size, m in zip(states, sizes, moved, strict=True):
        response = (m - base)[..., data.channels.index(s.position)] / size
        out[s.position] = response, "rad/s" if s.velocity is None else "rad/s^2"
    return out


def response_of(
    data: Dataset, channel: str, rates: Mapping[str, tuple[np.ndarray, str]], at: np.ndarray
) -> tuple[np.ndarray, str]:
    """(W, I, M) of one channel; a channel that is itself a rate answers at once."""
    if channel not in rates:
        now = np.zeros((*at.shape, data.t.shape[1]))
        np.put_along_axis(now, at[:, :, None], 1.0, axis=2)
        return now, "rad/s"
    kick, unit = rates[channel]
    out = np.zeros((*at.shape, data.t.shape[1]))
    for w in range(data.count):
        real = np.flatnonzero(np.isfinite(data.t[w]))
        t = data.t[w, real]
        if len(t) < 4:
            continue
        weight = np.gradient(t)
        late = t[at[w].clip(0, len(t) - 1)][:, None] - t[None, :]
        out[w][:, real] = np.where(late > 0.0, np.interp(late, t - t[0], kick[w, real]), 0.0) * weight
    return out, unit
