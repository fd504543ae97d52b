"""Where the gap lies: by channel, by regime of motion, by moment; shares of the squared gap and lift over a
regime's time.
"""

from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, window_squares
from residual_mpc.diagnosis.data.settings import DataSettings


@dataclass(frozen=True)
class Regime:
    name: str
    share: float
    lift: float


@dataclass(frozen=True)
class Stretch:
    run: str
    start: float
    end: float
    share: float


@dataclass(frozen=True)
class Where:
    channels: tuple[tuple[str, float], ...]
    regimes: tuple[Regime, ...]
    times: tuple[Stretch, ...]


def locate(data: Dataset, scales: Scales, error: np.ndarray, *, settings: DataSettings = DataSettings()) -> Where:
    """error (W, M, C): measured - predicted of the nominal model."""
    total, count = window_squares(data, scales, error)
    used = ~scales.still
    mean = total.sum(axis=0) / np.maximum(count.sum(axis=0), 1)
    shares = np.where(used, mean, 0.0) / max(mean[used].sum(), 1e-30)
    channels = sorted(
        ((c, float(s)) for c, s, u in zip(data.channels, shares, used, strict=True) if u), key=lambda cs: -cs[1]
    )
    return Where(
        tuple(channels), _regimes(data, scales, error, settings=settings), _times(data, total, count, settings=settings)
    )


def _times(data: Dataset, total: np.ndarray, count: np.ndarray, settings: DataSettings) -> tuple[Stretch, ...]:
    each = np.nansum(total / np.maximum(count.sum(axis=0), 1), axis=1)  # (W,) its part of the squared gap
    each = each / max(each.sum(), 1e-30)
    worst = np.argsort(-each)[: settings.where.worst]
    return tuple(
        Stretch(data.runs[data.run[w]].name, float(data.start[w]), float(data.start[w] + data.horizon), float(each[w]))
        for w in worst
    )


def _regimes(data: Dataset, scales: Scales, error: np.ndarray, settings: DataSettings) -> tuple[Regime, ...]:
    """Where the error grows: its change from sample to sample, squared, by what the robot was told to do then."""
    square = (
        np.where(data.compared[:, None, :] & ~scales.still, np.diff(error, axis=1, prepend=0.0) / scales.s, np.nan) ** 2
    )
    noise = 2.0 * (data.sigma / scales.s) ** 2  # what two samples' noise alone would give
    growth = np.maximum(np.nansum(square - noise, axis=2), 0.0)  # (W, M)
    seen = np.isfinite(data.y).any(axis=2)
    out = []
    for name, mask in regime_masks(data, settings=settings).items():
        time = float((mask & seen).sum() / max(seen.sum(), 1))
        share = float(growth[mask & seen].sum() / max(growth[seen].sum(), 1e-30))
        if time > settings.where.least_time:
            out.append(Regime(name, share, share / time))
    return tuple(sorted(out, key=lambda r: -r.lift))


def regime_masks(data: Dataset, *, settings: DataSettings = DataSettings()) -> dict[str, np.ndarray]:
    """Regimes as masks (W, M), from the commands alone, so that every robot has them."""
    shape = data.t.shape
    masks = {
        name: np.zeros(shape, dtype=bool)
        for name in (
            "standstill", "slow", "fast", "command step", "command reversal", "actuator off",
            "large command", "turning left", "turning right", "first third of the run", "last third of the run",
        )
    }  # fmt: skip
    for block in data.blocks:
        rows, drive = block.where, block.drive
        t = np.nan_to_num(data.t[rows])
        at = np.clip((t / drive.dt).astype(int), 0, drive.steps - 1)
        u = drive.command  # (W, lead + K, nu)
        servo = np.array([k == "position" for k in block.robot.command_kinds])
        speed = np.where(servo, _rate(u, drive.dt, settings=settings), u)
        recent = max(1, int(0.25 / drive.dt))

        def sample(x: np.ndarray, at: np.ndarray = at) -> np.ndarray:
            return np.asarray(np.take_along_axis(x, at[..., None], axis=1))

        size = np.quantile(np.abs(speed), 0.95, axis=(0, 1)) + 1e-12
        now = sample(speed[:, drive.lead :])
        fastest = np.max(np.abs(now) / size, axis=2)
        masks["standstill"][rows] = fastest < 0.02
        masks["slow"][rows] = (fastest >= 0.02) & (fastest < 0.35)
        masks["fast"][rows] = fastest > 0.8
        jump = np.abs(np.diff(u, axis=1, prepend=u[:, :1])) > 0.25 * (np.ptp(u, axis=(0, 1)) + 1e-12)
        flip = _reversals(speed, size)
        for name, event in (("command step", jump), ("command reversal", flip)):
            soon = np.cumsum(event, axis=1)
            soon = soon - np.concatenate([np.zeros_like(soon[:, :recent]), soon[:, :-recent]], axis=1) > 0
            masks[name][rows] = sample(soon[:, drive.lead :]).any(axis=2)
        if drive.enabled is not None:
            masks["actuator off"][rows] = sample(drive.enabled < 0.5).any(axis=2)
        big = np.quantile(np.abs(u), 0.9, axis=(0, 1))
        masks["large command"][rows] = (np.abs(sample(u[:, drive.lead :])) >= big - 1e-12).any(axis=2)
        if tuple(block.robot.actuators) == ("left", "right"):
            turn = now[..., 1] - now[..., 0]
            masks["turning left"][rows] = turn > 0.3 * size.max()
            masks["turning right"][rows] = turn < -0.3 * size.max()
        length = np.array([data.runs[i].t[-1] - data.runs[i].t[0] for i in data.run[rows]])
        part = drive.clock / np.maximum(length, 1e-9)
        masks["first third of the run"][rows] = (part < 1 / 3)[:, None]
        masks["last third of the run"][rows] = (part > 2 / 3)[:, None]
    return {name: m for name, m in masks.items() if m.any()}


def _rate(u: np.ndarray, dt: float, settings: DataSettings) -> np.ndarray:
    """(W, K, nu) rate of a held command over a short time, per second: from one hold to the next it is no rate."""
    n = max(1, int(settings.where.smooth / dt))
    ahead = np.concatenate([u[:, n:], np.repeat(u[:, -1:], n, axis=1)], axis=1)
    behind = np.concatenate([np.repeat(u[:, :1], n, axis=1), u[:, :-n]], axis=1)
    return np.asarray((ahead - behind) / (2 * n * dt))


def _reversals(speed: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(W, K, nu) bool: the first step at which a speed has clearly changed its sign."""
    sign = np.where(np.abs(speed) > 0.05 * size, np.sign(speed), 0.0)
    step = np.arange(speed.shape[1])[None, :, None]
    last = np.maximum.accumulate(np.where(sign != 0, step, 0), axis=1)
    held = np.take_along_axis(sign, last, axis=1)
    return np.concatenate([np.zeros_like(held[:, :1], dtype=bool), held[:, 1:] * held[:, :-1] < 0], axis=1)
