"""The robot of a run in space: measured, as the nominal model predicts it, and as the corrected one does."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from residual_mpc.export.recording.trace import Array, Trace
from residual_mpc.models.drawing import Motion, outline, skeleton
from residual_mpc.report.motion.film import SHAPELESS, UNMEASURED
from residual_mpc.report.motion.top_view import ARROW, LEAST, outlines

SOURCES = ("measured", "nominal", "corrected")
RATE = 25.0  # 1/s: frames
PLANAR = ("pose.x", "pose.y", "pose.theta")


@dataclass(frozen=True, eq=False)
class Scene:
    """at (f,) s from the run's start, window (f,). bodies: source -> (f, S, P, 3) m, the robot as S lines of P points
    at each frame; trails: source -> (f, 3) m, its tool, or its own place where it drives."""

    at: Array
    window: Array
    bodies: Mapping[str, Array]
    trails: Mapping[str, Array]

    def paths(self, source: str) -> list[Array]:
        """The trail window by window, each (n, 3) m; frames that are not finite are left out."""
        parts = (self.trails[source][span(self.window, w)] for w in np.unique(self.window))
        finite = (part[np.isfinite(part).all(axis=1)] for part in parts)
        return [part for part in finite if len(part) > 1]


def span(window: Array, w: int) -> slice:
    """Where a window's samples are, of increasing window numbers (n,)."""
    return slice(*np.searchsorted(window, (w, w + 1)))


def scene(trace: Trace) -> Scene | str:
    """The robot at RATE frames a second in every window of which enough was measured, or why it cannot be drawn.

    A position that nobody measured is drawn where the nominal model predicts it.
    """
    wanted = tuple(s.position for s in trace.robot.states)
    measured = [c for c in wanted if c in trace.channels]
    driving = set(PLANAR) <= set(wanted)
    needed = PLANAR[:2] if driving else ()
    shown = [w for w in range(len(trace.windows.start)) if _drawable(trace, w, needed, measured)]
    if not shown:
        return UNMEASURED
    at, window = _frames(trace, shown)
    motions = [_motion(trace, source, wanted, at, window) for source in SOURCES]
    if driving:
        bodies, trails = _from_above(trace, motions)
    else:
        bones = [skeleton(trace.robot, m) for m in motions]
        found = [b for b in bones if b is not None and b.shape[1] > 0]
        if len(found) < len(SOURCES):
            return SHAPELESS
        bodies, trails = found, [b[:, -1, 1] for b in found]
    return Scene(at, window, dict(zip(SOURCES, bodies, strict=True)), dict(zip(SOURCES, trails, strict=True)))


def _drawable(trace: Trace, window: int, needed: tuple[str, ...], measured: list[str]) -> bool:
    """Whether at least two samples of every needed channel, or else of some position, lie in the window."""
    ends = trace.windows.start[window] - 1e-9, trace.windows.end[window] + 1e-9
    inside = slice(*np.searchsorted(trace.t, ends))
    enough = {c for c in measured if np.isfinite(trace.measured[c][inside]).sum() > 1}
    return set(needed) <= enough and bool(enough)


def _frames(trace: Trace, windows: list[int]) -> tuple[Array, Array]:
    """(f,) s and (f,) windows: equal times from each window's first stamp to its last."""
    at, window = [], []
    for w in windows:
        mine = trace.at[span(trace.window, w)]
        count = max(2, round(float(np.ptp(mine)) * RATE) + 1)
        at.append(np.linspace(mine[0], mine[-1], count))
        window.append(np.full(count, w))
    return np.concatenate(at), np.concatenate(window)


def _motion(trace: Trace, source: str, wanted: tuple[str, ...], at: Array, window: Array) -> Motion:
    """Channel -> (f,), samples joined by straight lines."""
    if source == "measured":
        return {c: _measured(trace, c, at, window) for c in wanted}
    columns = trace.nominal if source == "nominal" else trace.corrected
    return {c: _predicted(trace, columns[c], at, window) for c in wanted}


def _measured(trace: Trace, channel: str, at: Array, window: Array) -> Array:
    if channel not in trace.channels:
        return _predicted(trace, trace.nominal[channel], at, window)
    y = trace.measured[channel]
    good = np.isfinite(y)
    return np.interp(at, trace.t[good], y[good])


def _predicted(trace: Trace, y: Array, at: Array, window: Array) -> Array:
    out = np.empty(len(at))
    for w in np.unique(window):
        frames, rows = span(window, w), span(trace.window, w)
        out[frames] = np.interp(at[frames], trace.at[rows], y[rows])
    return out


def _from_above(trace: Trace, motions: list[Motion]) -> tuple[list[Array], list[Array]]:
    """The outline, closed, with a line from the middle to the front; an arrow for a robot without one."""
    own = outline(trace.robot)
    extent = max(float(np.ptp(motions[0]["pose.x"])), float(np.ptp(motions[0]["pose.y"])), LEAST)
    shape = np.array(ARROW * extent if own is None else own)
    front = np.array([[float(shape[:, 0].max()), 0.0]])
    middle = np.zeros((1, 2))
    closed = np.concatenate([shape, shape[:1]])
    heading = np.concatenate([middle, np.repeat(front, len(closed) - 1, axis=0)])  # as many points as the outline has
    bodies = [np.stack([_flat(outlines(m, line)) for line in (closed, heading)], axis=1) for m in motions]
    return bodies, [_flat(np.stack([m["pose.x"], m["pose.y"]], axis=-1)) for m in motions]


def _flat(points: Array) -> Array:
    """(..., 3) m on the ground, from (..., 2) m."""
    return np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)
