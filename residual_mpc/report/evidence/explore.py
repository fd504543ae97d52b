"""What other values of the named parameters would predict: replays of held-out windows, one parameter at a time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.gap import gap_of
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.records import DiagnosisResult, Estimate
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Knob, Term
from residual_mpc.report.evidence.evidence import Array
from residual_mpc.report.evidence.in_groups import settings_in_groups
from residual_mpc.report.motion.choose import window_gaps

VALUES = 7  # of a slider, the fitted one in the middle
BEYOND = 1.0  # lengths of its half of the interval that a slider goes beyond it
SLIDERS = 6
WINDOWS = 3  # that are drawn
JUDGED = 40  # held-out windows over which the gap of each value is taken, at most
STEPS = 400_000  # simulation steps of all replays together, by which there are fewer for a slow simulation
CHANNELS = 3
SAMPLES = 160  # of a drawn curve


@dataclass(frozen=True)
class Slider:
    """One parameter of a named effect. values (VALUES,): increasing, the fitted one in the middle; gaps (VALUES,): over
    the held-out windows that are judged."""

    term: Term
    estimate: Estimate
    values: Array
    gaps: Array


@dataclass(frozen=True)
class Look:
    """One channel of one window. t (n,) s since the window's start; measured, before and each of curves
    (sliders, VALUES, n) in the channel's unit."""

    channel: str
    t: Array
    measured: Array
    before: Array
    curves: Array


@dataclass(frozen=True)
class View:
    """One held-out window with its channels. start: s, on the log's clock; gaps (sliders, VALUES): of this window."""

    run: str
    start: float
    looks: tuple[Look, ...]
    gaps: Array


@dataclass(frozen=True)
class Exploration:
    sliders: tuple[Slider, ...]
    views: tuple[View, ...]
    judged: int


def explore(made: DiagnosisResult) -> Exploration | None:
    """None where no effect with a number is named, or nothing was held out."""
    knobs = [
        (Knob(c.term.effect, c.term.target, p.name), c.term, p)
        for c in made.diagnosis.causes
        if c.term.effect in BY_NAME and BY_NAME[c.term.effect].fitted
        for p in c.parameters
    ]
    known = [k for k in knobs if k[0] in made.diagnosis.values and np.isfinite(k[2].ci95).all()][:SLIDERS]
    known = [k for k in known if k[2].ci95[0] < k[2].value < k[2].ci95[1]]
    held = np.flatnonzero(made.held if made.held.any() else np.ones(made.data.count, dtype=bool))
    if not known or not len(held):
        return None
    robots = [block.robot for block in made.data.blocks]
    grids = [slider_values(knob, estimate, robots) for knob, _, estimate in known]
    final = made.diagnosis.values
    rows = [{**final, knob: float(v)} for (knob, _, _), grid in zip(known, grids, strict=True) for v in grid]
    shown = _windows(made, held)
    affordable = int(STEPS * made.data.count / (len(rows) * max(made.data.cost, 1)))
    others = held[np.linspace(0, len(held) - 1, min(JUDGED, affordable, len(held))).astype(int)]
    judged = np.zeros(made.data.count, dtype=bool)
    judged[np.union1d(shown, others)] = True
    data = made.data.take(judged)
    settings = settings_in_groups(data.blocks[0].robot, rows, made.diagnosis.groups_of_windows)
    error = data.y - predict(data, settings)  # (rows, W, M, C)
    gaps = np.array([gap_of(data, made.scales, e).total for e in error]).reshape(len(known), VALUES)
    sliders = tuple(
        Slider(term, estimate, grid, g) for (_, term, estimate), grid, g in zip(known, grids, gaps, strict=True)
    )
    place = {int(w): k for k, w in enumerate(np.flatnonzero(judged))}
    views = tuple(_view(made, w, place[w], error, len(known)) for w in shown)
    return Exploration(sliders, views, data.count)


def slider_values(knob: Knob, estimate: Estimate, robots: Sequence[Robot]) -> Array:
    """(VALUES,) from below the 95 % interval to above it, within what is physically possible for each of the robots: a
    friction that is added may not make the joint's own negative."""
    (parameter,) = (p for p in BY_NAME[knob.effect].parameters if p.name == knob.parameter)
    limits = [r.bounds(knob.effect, knob.parameter, knob.target) for r in robots]
    least, most = (
        min(max(parameter.lower, *(low for low, _ in limits)), estimate.value),
        max(min(parameter.upper, *(high for _, high in limits)), estimate.value),
    )
    low, high = estimate.ci95
    half = VALUES // 2
    ends = [estimate.value + (1.0 + BEYOND) * (end - estimate.value) for end in (low, high)]
    below = np.linspace(max(ends[0], least), estimate.value, half + 1)
    above = np.linspace(estimate.value, min(ends[1], most), half + 1)
    return np.concatenate([below, above[1:]])


def _windows(made: DiagnosisResult, held: np.ndarray) -> list[int]:
    """At most WINDOWS of those held out: the largest gap, the largest correction, then the gaps in the middle."""
    before, after = window_gaps(made)
    usable = held[np.isfinite(before[held])]
    if not len(usable):
        return []
    order = usable[np.argsort(-before[usable])]
    best = usable[int(np.nanargmax(before[usable] - after[usable]))]
    middle = order[len(order) // 2]
    return list(dict.fromkeys(int(w) for w in (order[0], best, middle)))[:WINDOWS]


def _view(made: DiagnosisResult, window: int, place: int, error: np.ndarray, sliders: int) -> View:
    data = made.data
    shares = dict(made.diagnosis.where.channels)
    ranked = sorted((c for c in data.channels if c in shares), key=lambda c: -shares[c])[:CHANNELS]
    there = np.flatnonzero(np.isfinite(data.t[window]))
    there = there[np.unique(np.linspace(0, len(there) - 1, min(SAMPLES, len(there))).astype(int))]
    looks = []
    for channel in ranked:
        k = data.channels.index(channel)
        rows = there[np.isfinite(data.y[window, there, k])]
        if len(rows) < 2:
            continue
        y = data.y[window, rows, k]
        curves = (y - error[:, place, rows, k]).reshape(sliders, VALUES, len(rows))
        looks.append(Look(channel, data.t[window, rows], y, y - made.before[window, rows, k], curves))
    one = np.zeros(data.count, dtype=bool)
    one[window] = True
    alone = data.take(one)
    gaps = [gap_of(alone, made.scales, e[place : place + 1]).total for e in error]
    name = data.runs[data.run[window]].name
    return View(name, float(data.start[window]), tuple(looks), np.array(gaps).reshape(sliders, VALUES))
