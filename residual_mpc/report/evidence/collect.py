"""From a finished diagnosis to what the report draws."""

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import gap_from_squares, window_squares
from residual_mpc.diagnosis.results.records import DiagnosisResult
from residual_mpc.models import optional
from residual_mpc.report.evidence.channel_units import channel_unit
from residual_mpc.report.evidence.evidence import Evidence, Panel, Windows
from residual_mpc.report.evidence.explore import explore
from residual_mpc.report.evidence.run_traces import run_traces
from residual_mpc.report.motion.film import film

PANELS = 6
STRETCH = 8  # windows shown in one panel, at most


def collect(made: DiagnosisResult) -> Evidence:
    """The channels with the largest gap, around the held-out window that shows it best, the gap of every window, and
    the robot in the windows that show most."""
    eye = np.eye(made.data.count)
    before = np.asarray(gap_from_squares(*window_squares(made.data, made.scales, made.before), eye))
    after = np.asarray(gap_from_squares(*window_squares(made.data, made.scales, made.after), eye))
    names = [made.data.runs[i].name for i in made.data.run]
    order = np.lexsort((made.data.start, made.data.run))
    windows = Windows(
        [names[i] for i in order], made.data.start[order], before[order], after[order]
    )
    starts = {run.name: float(run.t[0]) for run in made.data.runs}
    sliding = optional.sliding(made.data.blocks[0].robot)
    return Evidence(
        _panels(made, before, sliding), windows, starts, *film(made), explore(made), run_traces(made, before, after),
        sliding,
    )  # fmt: skip


def _panels(made: DiagnosisResult, per_window: np.ndarray, sliding: frozenset[str]) -> tuple[Panel, ...]:
    data, out = made.data, []
    shares = dict(made.diagnosis.where.channels)
    for channel in sorted(shares, key=lambda c: -shares[c])[:PANELS]:
        k = data.channels.index(channel)
        usable = made.held & np.isfinite(data.y[:, :, k]).any(axis=1)
        if not usable.any():
            continue
        worst = int(np.flatnonzero(usable)[np.nanargmax(per_window[usable])])
        mine = _around(worst, np.flatnonzero(usable & (data.run == data.run[worst])), data)
        out.append(_panel(made, channel, k, mine, channel_unit(channel, sliding)))
    return tuple(out)


def _around(worst: int, windows: np.ndarray, data: Dataset) -> np.ndarray:
    """At most STRETCH of the windows, one after the other in time, with `worst` among them."""
    windows = windows[np.argsort(data.start[windows])]
    breaks = np.flatnonzero(np.diff(data.start[windows]) > 1.5 * data.horizon) + 1
    (mine,) = (part for part in np.split(windows, breaks) if worst in part)
    place = int(np.flatnonzero(mine == worst)[0])
    first = min(max(place - STRETCH // 2, 0), max(len(mine) - STRETCH, 0))
    return np.asarray(mine[first : first + STRETCH])


def _panel(made: DiagnosisResult, channel: str, k: int, windows: np.ndarray, unit: str) -> Panel:
    data = made.data
    pieces: list[np.ndarray] = []
    for w in windows:
        seen = np.isfinite(data.t[w])
        y = data.y[w, seen, k]
        rows = np.stack([data.t[w, seen] + data.start[w], y, y - made.before[w, seen, k], y - made.after[w, seen, k]])
        pieces += [rows, np.array([[rows[0, -1]], [np.nan], [np.nan], [np.nan]])]
    t, measured, before, after = np.concatenate(pieces[:-1], axis=1)
    if not made.diagnosis.causes:
        after = np.full_like(after, np.nan)
    return Panel(made.data.runs[data.run[windows[0]]].name, channel, unit, t, measured, before, after)
