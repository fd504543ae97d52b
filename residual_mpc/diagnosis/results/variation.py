"""Whether the size of a named effect is steady: it may differ from run to run, with how fast the robot moves, or begin
or end in the middle of the runs.

For each effect, one factor on its size is estimated for each part of the windows (each run, each level of motion, of
its own influence or of the joint's position, or before and after an instant) by Gauss-Newton steps from the steady fit;
the other parameters stay. A variation is reported only if predictions with a separate size for each part fit better
beyond doubt.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, fit_trust
from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.data.unknown_past import after_unknown_past, runs_with_unknown_past
from residual_mpc.diagnosis.fit.evidence import blocks_of
from residual_mpc.diagnosis.fit.least_squares import Fit, on_problem
from residual_mpc.diagnosis.predict.group_space import resized, zero_of
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.diagnosis.results.divisions import KINDS, Division, divisions_of, divisions_of_effect
from residual_mpc.diagnosis.results.fitted_explanation import FittedExplanation
from residual_mpc.diagnosis.results.odd_run import odd_run
from residual_mpc.diagnosis.results.settings import ResultSettings, VariationSettings
from residual_mpc.diagnosis.results.variation_records import Instant, Variation
from residual_mpc.effects.laws import is_law
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Term, Values
from residual_mpc.models.size_numbers import size_knobs

ITERATIONS = 4  # of the sizes of the parts


@dataclass(frozen=True, eq=False)
class _Scores:
    """How the cost depends on a factor applied to the size of one effect. residuals (W, n), and their derivative by the
    factor; information, score (W,): of each window, divided by phi, the dispersion of the residuals along it."""

    term: Term
    derivative: np.ndarray
    residuals: np.ndarray
    information: np.ndarray
    score: np.ndarray
    phi: float

    def step(self, windows: np.ndarray) -> float:
        """The change of the factor that suits these windows (W,) bool; NaN if they do not show it."""
        h = float(self.information[windows].sum())
        return -float(self.score[windows].sum()) / h if h > 0.0 else float("nan")

    def tells(self, windows: np.ndarray, told: float) -> bool:
        """Whether the standard error of the factor in these windows is at most `told`: a run in which nothing moves, or
        in which a stop is not reached, says nothing of the size."""
        return float(self.information[windows].sum()) * told**2 >= 1.0

    def scatter(self, windows: np.ndarray) -> float:
        """The sum of squares of these windows' own sizes about their common one, over the dispersion."""
        h, g = self.information[windows], self.score[windows]
        return float(((g + h * self.step(windows)) ** 2 / h).sum())

    def gain(self, windows: np.ndarray) -> float:
        """By how much their cost falls with it."""
        h = float(self.information[windows].sum())
        return float(self.score[windows].sum()) ** 2 / h if h > 0.0 else 0.0


def variations(of: FittedExplanation, settings: ResultSettings) -> dict[Term, Variation]:
    """The named effects whose size is not steady, tested on windows of the headline's horizon, including held-out ones,
    excluding those soon after an unknown past; long logs are thinned evenly."""
    return _varied(of, of.clean, settings)[0]


def variations_in_fits(of: FittedExplanation, settings: ResultSettings) -> dict[Term, Variation]:
    """As `variations`, on windows that fits may see alone."""
    return _varied(of, of.clean.take(of.free), settings)[0]


def makes_the_odd_run(of: FittedExplanation, settings: ResultSettings) -> bool:
    """Whether effects whose sizes differ between the runs, or that begin or end, account for the run that is unlike all
    others."""
    found, left, run = _varied(of, of.clean, settings)
    sizes = any(v.by_run is not None or v.since is not None or v.until is not None for v in found.values())
    return sizes and odd_run(left, run) is None


def _varied(
    of: FittedExplanation, clean: Dataset, settings: ResultSettings
) -> tuple[dict[Term, Variation], np.ndarray, np.ndarray]:
    """The variations; the mean squared residual that they leave in each window (W,), and its run (W,)."""
    terms = [t for t in of.final.terms if not is_law(t.effect) and size_knobs(of.final.values, t)]
    if not terms:
        return {}, np.zeros(0), np.zeros(0, dtype=int)
    past = settings.data.unknown_past
    unknown = runs_with_unknown_past(clean, past)
    clean = clean.take(after_unknown_past(clean, np.ones(clean.count, dtype=bool), unknown, past))
    data = clean.take(evenly(clean, settings.variation.steps, settings=settings.data))
    problem = build_problem(data, of.space, 1.0 / of.problem.weight, settings=settings.predict)
    trust = fit_trust(data, of.scales, data.y - problem.replays([of.final.values])[0], settings=settings.data)
    problem = problem if (trust == 1.0).all() else replace(problem, count=trust)
    fit = on_problem(problem, of.final, settings=settings.fit)
    found, r = variations_on(problem, fit, terms, of.scales, settings)
    return found, np.sum(r * r, axis=1) / np.maximum(np.count_nonzero(r, axis=1), 1), data.run


def variations_on(
    problem: Problem, fit: Fit, terms: Sequence[Term], scales: Scales, settings: ResultSettings
) -> tuple[dict[Term, Variation], np.ndarray]:
    """Which of these effects of a fit are not steady on the windows of the problem, and the residuals (W, n) beside
    them."""
    blocks, r, out = blocks_of(problem.data, settings=settings.fit), fit.r, dict[Term, Variation]()
    divisions = divisions_of(problem.data, scales, settings.variation.runs)
    left = list(terms)
    while left:  # the clearest first: one varying effect can make others appear to vary
        each = (_scores(fit, t, r, blocks, problem.data.run) for t in left)
        each = (scores for scores in each if scores.information.any())  # a limit may move no prediction here
        tried = (_of_one(scores, problem, fit.values, divisions, settings.variation) for scores in each)
        found = max((f for f in tried if f is not None), key=lambda f: f.gain, default=None)
        if found is None:
            break
        out[found.term] = found.variation
        left.remove(found.term)
        r = r + found.moved
    return out, r


@dataclass(frozen=True, eq=False)
class _Found:
    """gain: by how much the cost, over the dispersion, falls with the variation, in excess of the required gain; moved
    (W, n): what it adds to the residuals."""

    term: Term
    variation: Variation
    gain: float
    moved: np.ndarray


def _scores(fit: Fit, term: Term, r: np.ndarray, blocks: np.ndarray, run: np.ndarray) -> _Scores:
    """With the residuals r (W, n): over the dispersion of the blocks' scores about the size that suits each run."""
    direction = np.zeros(len(fit.knobs))
    for k in size_knobs(fit.values, term):
        i = fit.knobs.index(k)
        direction[i] = (fit.values[k] - zero_of(k)) / fit.scales[i]
    j = fit.jacobian @ direction
    information, score = np.einsum("wn,wn->w", j, j), np.einsum("wn,wn->w", j, r)
    number = run[np.unique(blocks, return_index=True)[1]]
    h, g = np.bincount(blocks, weights=information), np.bincount(blocks, weights=score)
    own = np.array([-g[number == i].sum() / max(h[number == i].sum(), 1e-300) for i in number])
    free = max(len(h) - len(np.unique(number)), 1)
    phi = max(float(((g + h * own) ** 2 / np.maximum(h, 1e-300)).sum()) / free, 1.0)
    return _Scores(term, j, r, information / phi, score / phi, phi)


def _of_one(
    scores: _Scores, problem: Problem, values: Values, divisions: tuple[Division, ...], settings: VariationSettings
) -> _Found | None:
    """The clearest variation of one effect; None if it is steady, as far as these windows show. Runs with other motions
    differ where the size depends on the motion: then it also differs within runs, and that is the variation."""
    every = (*divisions, *divisions_of_effect(
        problem.data, scores.term, scores.information, problem.space.slots[scores.term.effect]
    ))
    found = [(d, f) for d in every if (f := _divided(scores, problem, values, d, settings)) is not None]
    run = problem.data.run
    inside = {d.kind for d, _ in found if d.of is not None and _differs_within_runs(scores, d.of, run, settings)}
    if len(np.unique(run)) > settings.runs:  # runs of other sizes, which are not listed, differ between the parts too
        found = [(d, f) for d, f in found if d.kind in inside]
    within = bool(inside)
    at = _instant(scores, problem, values, settings)
    rest = [f for _, f in found if not (within and f.variation.by_run is not None)]
    return max((f for f in (at, *rest) if f is not None), key=lambda f: f.gain, default=None)


def _differs_within_runs(scores: _Scores, of: np.ndarray, run: np.ndarray, settings: VariationSettings) -> bool:
    """Whether, though each run (W,) has a size of its own, the sizes differ beyond doubt between its windows with less
    and with more of a quantity (W,) than the run's median: over the scatter of the windows about these sizes, since the
    dispersion of the steady fit holds the difference itself."""
    gain, left, free, parts = 0.0, 0.0, 0, 0
    shows = scores.information > 0.0
    for i in np.unique(run):
        mine = (run == i) & np.isfinite(of) & shows
        more = mine & (of > np.median(of[mine])) if mine.any() else mine
        shown = [p for p in (mine & ~more, more) if p.any()]
        gain += sum(scores.gain(p) for p in shown) - scores.gain(mine)
        left += sum(scores.scatter(p) for p in shown)
        parts += len(shown)
        free += max(len(shown) - 1, 0)
    spread = max(left / max(int(shows.sum()) - parts, 1), 1.0 / scores.phi)
    return gain / spread > settings.beyond_doubt + settings.per_part * max(free - 1, 0)


def _divided(
    scores: _Scores, problem: Problem, values: Values, division: Division, settings: VariationSettings
) -> _Found | None:
    """The sizes in the parts of a division; None if they do not differ beyond doubt and by something that matters."""
    shown = [k for k, p in enumerate(division.parts) if np.isfinite(scores.step(p)) and scores.tells(p, settings.told)]
    parts = [division.parts[k] for k in shown]
    need = settings.beyond_doubt + settings.per_part * (len(parts) - 1)
    linear = sum(scores.gain(p) for p in parts) - scores.gain(np.any(parts, axis=0)) if len(parts) > 1 else 0.0
    better = _sizes_of(problem, values, scores, parts) if linear > settings.screened * need else None
    if better is None or better.gain <= need or np.ptp(better.steps) <= settings.material:
        return None
    knob = size_knobs(values, scores.term)[0]
    bounds = problem.space.bounds
    sizes = [float(resized(values, scores.term, 1.0 + s, bounds)[knob]) for s in better.steps]
    every = dict(zip((division.names[k] for k in shown), sizes, strict=True))
    restricts = np.isinf(BY_NAME[knob.effect].parameter(knob.parameter).null)
    free = tuple(name for name, x in every.items() if restricts and x > settings.free * values[knob])
    named = {name: x for name, x in every.items() if name not in free}
    run, motion, influence, position = (named if division.kind == kind else None for kind in KINDS)
    variation = Variation(run, motion, influence, position, free=free)
    return _Found(scores.term, variation, better.gain - need, better.moved)


def _instant(scores: _Scores, problem: Problem, values: Values, settings: VariationSettings) -> _Found | None:
    """Where the effect begins or ends, if it does in the middle of the runs; None for a limit or a stiffness, which no
    size takes away."""
    data, term = problem.data, scores.term
    if not all(np.isfinite(BY_NAME[k.effect].parameter(k.parameter).null) for k in size_knobs(values, term)):
        return None
    order = np.lexsort((data.start, data.run))
    h, g = np.cumsum(scores.information[order])[:-1], np.cumsum(scores.score[order])[:-1]
    total_h, total_g = float(scores.information.sum()), float(scores.score.sum())
    with np.errstate(divide="ignore", invalid="ignore"):
        gains = g**2 / h + (total_g - g) ** 2 / (total_h - h) - total_g**2 / total_h
    before = np.arange(1, len(order))  # windows
    gains = np.where(np.minimum(before, len(order) - before) < settings.fewest, np.nan, gains)
    need = settings.beyond_doubt + 2.0 * np.log(len(order))  # one of many instants
    if not np.isfinite(gains).any() or not np.nanmax(gains) > settings.screened * need:
        return None
    n = int(np.nanargmax(gains)) + 1
    later = np.zeros(data.count, dtype=bool)
    later[order[n:]] = True
    better = _sizes_of(problem, values, scores, [~later, later])
    if better is None or better.gain <= need:
        return None
    before, after = 1.0 + better.steps
    at = Instant(data.runs[data.run[order[n]]].name, float(data.start[order[n]]))
    if abs(before) < settings.absent * after:
        return _Found(term, Variation(since=at), better.gain - need, better.moved)
    if abs(after) < settings.absent * before:
        return _Found(term, Variation(until=at), better.gain - need, better.moved)
    return None


@dataclass(frozen=True, eq=False)
class _Better:
    """steps: the change of the factor for each part; gain, moved: see `_Found`."""

    steps: np.ndarray
    gain: float
    moved: np.ndarray


def _sizes_of(problem: Problem, values: Values, scores: _Scores, parts: list[np.ndarray]) -> _Better | None:
    """A size for each part (W,) bool, by Gauss-Newton steps with the derivative of the steady fit, and what the
    predictions themselves gain."""
    steps = np.nan_to_num([scores.step(p) for p in parts])
    steady = problem.residuals([values])[0]
    part = np.argmax(parts, axis=0)
    cost = float(np.sum(scores.residuals**2))
    best: _Better | None = None
    for _ in range(ITERATIONS):
        each = problem.residuals([resized(values, scores.term, 1.0 + s, problem.space.bounds) for s in steps])
        moved = each[part, np.arange(len(part))] - steady
        r = scores.residuals + moved
        gain = (cost - float(np.sum(r * r))) / scores.phi
        if best is not None and gain <= best.gain:
            break
        best = _Better(steps, gain, moved)
        slopes = np.array([float(np.sum(scores.derivative[p] * r[p])) for p in parts])
        curvature = np.array([float(scores.information[p].sum()) * scores.phi for p in parts])
        steps = steps - np.divide(slopes, curvature, out=np.zeros(len(parts)), where=curvature > 0.0)
    return best
