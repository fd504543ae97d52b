"""Hypotheses x windows -> predicted samples: start states through the sensor effects, replay, sensors."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Block, Dataset
from residual_mpc.diagnosis.data.local_fit import local_fits
from residual_mpc.diagnosis.data.logged_columns import at_starts
from residual_mpc.diagnosis.predict.readings import LocalValue, Reading, reading_of
from residual_mpc.effects.library import changes, present
from residual_mpc.effects.ops import NUMPY
from residual_mpc.effects.sensor import lateness, low_pass
from residual_mpc.models import optional
from residual_mpc.models.logged_laws import with_columns
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings

ROOM = 8_000_000  # numbers in the commands and channels of one chunk of hypotheses; a replay holds several times that

MEMORY = "memory."  # begins the key of a low-pass filter's memory; without one, it moves with its channel

Start = Mapping[str, np.ndarray]


def predict(data: Dataset, settings: Settings, nudge: Start | None = None) -> np.ndarray:
    """(H, W, M, C): what each hypothesis says the sensors would report at every sample; NaN where padded.

    nudge: added to the start states by channel, (H, W), for the sensitivity to the start.
    """
    h, (w, m), c = settings.rows, data.t.shape, len(data.channels)
    out = np.full((h, w, m, c), np.nan)
    for block in data.blocks:
        here = settings.of_group(block.group)
        first, back = np.arange(h), np.arange(h)
        # hypotheses that differ only in other groups have the same prediction here
        if settings.others and nudge is None:
            first, back = here.distinct()
        steps = block.drive.steps + block.drive.lead
        size = (block.where.stop - block.where.start) * steps * (c + len(block.robot.actuators))
        per = max(1, ROOM // size)
        for a in range(0, len(first), per):
            rows = first[a : a + per]
            part = None if nudge is None else {k: v[rows, block.where] for k, v in nudge.items()}
            found = _predict_block(data, block, here.take(rows), part)
            these = np.flatnonzero((back >= a) & (back < a + per))
            out[these, block.where] = found[back[these] - a]
    return out


def predict_moved(data: Dataset, settings: Settings, nudges: Sequence[Start]) -> np.ndarray:
    """(N, W, M, C): as `predict` for one hypothesis (settings with one row) from N starts, each moved by channel, (W,).
    One batch: few rows cost nearly as much as many."""
    keys = dict.fromkeys(k for nudge in nudges for k in nudge)
    still = np.zeros(data.count)
    stacked = {k: np.stack([nudge.get(k, nudge.get(k.removeprefix(MEMORY), still)) for nudge in nudges]) for k in keys}
    same = np.zeros(len(nudges), dtype=int)
    return predict(data, settings.take(same), stacked)


def start_states(data: Dataset, block: Block, settings: Settings, sooner: float = 0.0) -> dict[str, np.ndarray]:
    """State from which each window is replayed under each hypothesis: position and velocity channels, (H, W_block).

    Positions from the local quadratic's value, else the robot's rest; velocities from the logged velocity's, else from
    the position's slope, else 0; mapped back through the sensor effects. Where measurements arrive late, the reading at
    the window's start shows an earlier state: the replay starts that much earlier (see `earliest`), so that no sample
    lies before it; `sooner` s are added to that.
    """
    early = earliest(block, settings) + sooner
    rest = optional.rest(block.robot)
    out: dict[str, np.ndarray] = {}
    for state in block.robot.states:
        position = reading_of(data, block, settings, state.position)
        found = _local(data, block, state.position, position.stamp(early))
        value = np.where(np.isnan(found.value), rest.get(state.position, 0.0), found.value)
        out[state.position] = position.true(replace(found, value=np.nan_to_num(value)))
        if state.velocity is not None:
            velocity = reading_of(data, block, settings, state.velocity)
            rate = _local(data, block, state.velocity, velocity.stamp(early))
            known = np.isfinite(rate.value)
            out[state.velocity] = np.nan_to_num(np.where(known, velocity.true(rate), position.rate(found)))
    for effect, p in present(settings.effects, "point"):
        assert effect.undo is not None
        out["pose.x"], out["pose.y"] = effect.undo(NUMPY, p, out["pose.x"], out["pose.y"], out["pose.theta"])
    return out


def earliest(block: Block, settings: Settings) -> np.ndarray:
    """(H, W_block) s: how long before each window's start the replay begins: as late as each hypothesis' latest sensor,
    in whole steps. A part of a step would smear the commands' edges over the encoders that are read beside them."""
    dt, zero = block.drive.dt, np.zeros((settings.rows, len(block.drive.clock)))
    delays, skews = (changes(settings.effects, q) for q in ("reading delay", "reading skew"))
    latest = zero if delays is None else zero + delays.max(axis=1)[:, None]
    if skews is not None:
        latest = np.maximum(latest + lateness(skews.max(axis=1)[:, None], block.drive.clock), 0.0)
    return np.asarray(dt * np.ceil(latest / dt - 1e-9))


def beyond(block: Block, settings: Settings) -> float:
    """s: how long after the windows' ends the replay ends, for the hypothesis with the earliest stamps, or with
    commands that act before theirs."""
    skews, delays = (changes(settings.effects, q) for q in ("reading skew", "command delay"))
    early = 0.0 if delays is None else max(0.0, -float(delays.min()))
    if skews is None:
        return early
    ends = block.drive.clock + block.drive.dt * block.drive.steps
    return max(early, -float(lateness(skews.min(axis=1)[:, None], ends).min()))


def _predict_block(data: Dataset, block: Block, settings: Settings, nudge: Start | None) -> np.ndarray:
    """nudge: by channel, (H, W_block)."""
    h, w = settings.rows, block.where.stop - block.where.start
    start = start_states(data, block, settings)
    if nudge is not None:
        start = {k: v + nudge[k] if k in nudge else v for k, v in start.items()}
    each = on_windows(data, block, settings)
    early = earliest(block, settings)
    drive = begin_earlier(block.drive, early, beyond(block, settings))
    wanted = tuple(c for c in data.channels if c in block.robot.channels)
    nodes = block.robot.replay({k: v.reshape(h * w) for k, v in start.items()}, drive, each, wanted)
    t = data.t[block.where]  # (W, M)
    sampled: dict[str, np.ndarray] = {}
    readings = {c: reading_of(data, block, settings, c) for c in wanted}
    for channel in wanted:
        since = _since(t, readings[channel].late(t) - early[:, :, None])  # s from the first node
        sampled[channel] = _interpolate(nodes[channel].reshape(h, w, -1), since, drive.dt)
    posed = "pose.x" in sampled and "pose.theta" in sampled
    for effect, values in present(settings.effects, "point") if posed else ():
        assert effect.step is not None
        p = {k: v[:, :, None] for k, v in values.items()}
        seen = effect.step(NUMPY, p, sampled["pose.x"], sampled["pose.y"], sampled["pose.theta"])
        sampled["pose.x"], sampled["pose.y"] = seen
    for channel in wanted:
        rows = np.flatnonzero(_lags(readings[channel]))
        if len(rows):
            some = {c: y.reshape(h, w, -1)[rows] for c, y in nodes.items()}
            part = None if nudge is None else {k: v[rows] for k, v in nudge.items()}
            slow = _low_passed(data, block, settings.take(rows), channel, some, part)
            since = _since(t, readings[channel].late(t)[rows] - early[rows, :, None])
            sampled[channel][rows] = _interpolate(slow, since, drive.dt)
    out = np.full((h, w, t.shape[1], len(data.channels)), np.nan)
    for k, channel in enumerate(data.channels):
        if channel in sampled:
            out[..., k] = readings[channel].of(sampled[channel])
    return out


def _lags(reading: Reading) -> np.ndarray:
    """(H,) bool"""
    return np.zeros(len(reading.delay), dtype=bool) if reading.lag is None else reading.lag > 0.0


def _low_passed(
    data: Dataset, block: Block, settings: Settings, channel: str, nodes: Mapping[str, np.ndarray], nudge: Start | None
) -> np.ndarray:
    """(H, W, K + 1) a channel behind its low-pass, in true units, from the nodes (H, W, K + 1) of the true channels.

    The memory begins at the reading, or in rest where there is none. The point is mounted on the nodes: before the
    low-pass, and not on the samples.
    """
    reading = reading_of(data, block, settings, channel)
    assert reading.lag is not None
    true, posed = nodes[channel], ("pose.x", "pose.y", "pose.theta")
    if channel in posed[:2] and set(posed) <= set(nodes):
        for effect, values in present(settings.effects, "point"):
            assert effect.step is not None
            p = {k: v[:, :, None] for k, v in values.items()}
            true = effect.step(NUMPY, p, *(nodes[c] for c in posed))[posed.index(channel)]
    memory = reading.memory(_local(data, block, channel, reading.stamp(earliest(block, settings))).value)
    if nudge is not None:
        memory = memory + nudge.get(memory_of(channel), nudge.get(channel, np.zeros_like(memory)))
    memory = np.where(np.isnan(memory), true[:, :, 0], memory)
    return np.stack([low_pass(true[i], memory[i], float(tau), block.drive.dt) for i, tau in enumerate(reading.lag)])


def memory_of(channel: str) -> str:
    """The key under which a nudge moves the memory of a channel's low-pass; without it, that moves with the state."""
    return f"{MEMORY}{channel}"


def begin_earlier(drive: Drive, early: np.ndarray, beyond: float = 0.0) -> Drive:
    """The drive of W windows for H hypotheses, (H * W) rows, each begun `early` (H, W) s sooner, and all of them long
    enough to end `beyond` s after the windows."""
    h = len(early)
    command, enabled = drive.command, drive.enabled
    if enabled is not None and drive.enabled_before is not None:
        enabled = np.concatenate([drive.enabled_before, enabled], axis=1)
    clock = np.tile(drive.clock, h)
    setting = None if drive.setting is None else np.tile(drive.setting, h)
    past = None if drive.past is None else drive.past.take(np.tile(np.arange(len(drive.clock)), h))
    if not early.any() and not beyond:
        again = None if drive.enabled is None else np.tile(drive.enabled, (h, 1, 1))
        angle = None if drive.angle is None else np.tile(drive.angle, (h, 1))
        return Drive(drive.dt, drive.lead, np.tile(command, (h, 1, 1)), again, clock, setting, angle=angle, past=past)
    extra = more_steps(drive, early, beyond)
    step = np.arange(command.shape[1] + extra)
    known = 0 if enabled is None else enabled.shape[1] - drive.steps  # steps before the window of which it is known
    if beyond and drive.command_after is not None:
        command = np.concatenate([command, drive.command_after], axis=1)
        enabled = enabled if drive.enabled_after is None else np.concatenate([enabled, drive.enabled_after], axis=1)
    last = command.shape[1] - 1
    ons = []
    commands = np.empty((h, len(command), len(step), command.shape[2]))
    for out, shifts in zip(commands, early / drive.dt, strict=True):
        shift = shifts[:1] if (shifts == shifts[0]).all() else shifts  # (1,) or (W,) steps
        place = np.clip(step - shift[:, None], 0.0, last)
        low = np.minimum(place.astype(int), max(last - 1, 0))
        part = (place - low)[:, :, None]
        np.multiply(1.0 - part, _picked(command, low), out=out)
        out += part * _picked(command, low + 1)
        if enabled is not None:
            at = step[drive.lead :] - drive.lead - shift[:, None] + known
            ons.append(_picked(enabled, np.round(np.clip(at, 0, enabled.shape[1] - 1)).astype(int)))
    on = None if enabled is None else np.concatenate(ons)
    angle = drive.angle_before(np.round(early / drive.dt).astype(int))  # (H, W, nu)
    angle = None if angle is None else angle.reshape(-1, angle.shape[2])
    clock = clock - early.ravel()
    rows = commands.reshape(-1, *commands.shape[2:])
    return Drive(drive.dt, drive.lead, rows, on, clock, setting, angle=angle, past=past)


def more_steps(drive: Drive, early: np.ndarray, beyond: float) -> int:
    """By which a replay is longer than the windows that begins `early` s (H, W) sooner and ends `beyond` s later."""
    return int(np.ceil((early.max() + beyond) / drive.dt - 1e-9))


def _picked(x: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(W, n, nu) of x (W, N, nu) at (W, n), or at (1, n) for all windows."""
    return np.asarray(x.take(at[0], axis=1) if len(at) == 1 else x[np.arange(len(x))[:, None], at])


def on_windows(data: Dataset, block: Block, settings: Settings) -> Settings:
    """One row for each hypothesis on each window of a block, hypothesis by hypothesis, with the laws of logged columns
    written into the effects that carry them."""
    w = block.where.stop - block.where.start
    each = settings.take(np.repeat(np.arange(settings.rows), w))
    return with_columns(each, lambda column: np.tile(at_starts(data, column, block.where), settings.rows))


def run_up(data: Dataset, block: Block, settings: Settings, sooner: float) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The states of one hypothesis (settings with one row) replayed from `sooner` s before the windows' starts on.

    Returns the nodes of every state's position and velocity channel, (W_block, nodes), the first `sooner` s (plus any
    sensor delay) before the start; and (W_block,) bool, whether the run and its samples reach back that far.
    """
    first = np.array([data.runs[i].t[0] for i in data.run[block.where]])
    early = earliest(block, settings) + sooner
    reaches = data.start[block.where] - early[0] >= first - 1e-9  # (W_block,)
    start = {k: v[0] for k, v in start_states(data, block, settings, sooner).items()}
    drive = begin_earlier(block.drive, early)
    wanted = tuple(c for s in block.robot.states for c in (s.position, s.velocity) if c is not None)
    each = on_windows(data, block, settings)
    nodes = block.robot.replay(start, drive, each, wanted)
    for state in block.robot.states:
        position = reading_of(data, block, settings, state.position)
        value = _local(data, block, state.position, position.stamp(early)).value
        measured = any(c == state.position for _, c in data.signals)
        reaches &= np.isfinite(value[0]) | (not measured)
    return dict(nodes), reaches


def _since(t: np.ndarray, late: np.ndarray) -> np.ndarray:
    """(H, W, M) the sampling times t (W, M) less how late they are, (H, W, M) or (H, W, 1); (1, W, M) where all
    hypotheses have the same."""
    return t - (late[:1] if (late == late[:1]).all() else late)


def _interpolate(nodes: np.ndarray, t: np.ndarray, dt: float) -> np.ndarray:
    """(H, W, M) from nodes (H, W, K + 1) at times t, (H, W, M) or (1, W, M) for all alike, s; straight on beyond both
    ends."""
    h, w, n = nodes.shape
    flat, out = nodes.reshape(h, w * n), np.empty((h, w, t.shape[2]))
    begin = n * np.arange(w)[:, None]  # of each window's nodes
    for of, times in [(slice(None), t[0])] if len(t) == 1 else [(slice(i, i + 1), t[i]) for i in range(h)]:
        missing = np.isnan(times)
        place = np.where(missing, 0.0, times) / dt
        k = np.clip(np.floor(place), 0, n - 2).astype(np.intp)
        at, part = (k + begin).ravel(), (place - k).ravel()
        low = flat[of].take(at, axis=1)
        between = flat[of].take(at + 1, axis=1)
        between -= low
        between *= part
        between += low
        between[:, missing.ravel()] = np.nan
        out[of] = between.reshape(-1, w, t.shape[2])
    return out


def _local(data: Dataset, block: Block, channel: str, shift: np.ndarray) -> LocalValue:
    """A channel near the windows of a block, `shift` (H, W) s after their starts."""
    signal = data.signals.joined(channel)
    if signal is None:
        return LocalValue(*(np.full(shift.shape, np.nan) for _ in range(3)))
    if (shift == shift[:1]).all():  # as in most batches: nothing to sort
        distinct, back = shift[:1], np.zeros(len(shift), dtype=int)
    else:
        distinct, back = np.unique(shift, axis=0, return_inverse=True)
    query = (data.start[block.where][None, :] + distinct).ravel()
    fit = local_fits(signal, np.tile(data.run[block.where], len(distinct)), query)
    found = (fit.value(signal.y), fit.slope(signal.y), fit.curvature(signal.y))
    return LocalValue(*(x.reshape(distinct.shape)[back.ravel()] for x in found))
