"""Which set of effects: forward by the best addition, back by pruning, across by swapping, until nothing changes."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.additions import HOPELESS, NONE, ROUGH, additions, distinct
from residual_mpc.diagnosis.dataset import Dataset
from residual_mpc.diagnosis.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.fit import Fit, Race, elsewhere, fit_all
from residual_mpc.diagnosis.floor import noise_errors
from residual_mpc.diagnosis.gap import Scales, gap_of, per_window
from residual_mpc.diagnosis.pairs import pairs
from residual_mpc.diagnosis.problem import Problem, reweigh, tolerating
from residual_mpc.diagnosis.replays import Replays
from residual_mpc.diagnosis.search_settings import SearchSettings
from residual_mpc.diagnosis.tolerated import carrying, tolerant
from residual_mpc.diagnosis.verdict import AS_GOOD, SMALL
from residual_mpc.models.settings import TUNE, Knob, Term, Values


@dataclass(frozen=True)
class Step:
    """One accepted step of the search, for the report: the set after it, and its cost in that step's weights."""

    terms: tuple[Term, ...]
    before: float
    after: float


@dataclass(frozen=True)
class Found:
    """The chosen set on its final weights, its sub- and rival sets on the same weights, and the way there; sigma (C,):
    standard deviations for fits that know of no small differences."""

    problem: Problem
    fit: Fit
    base: Fit
    phi: float
    ruler: "Ruler"
    steps: tuple[Step, ...]
    sigma: np.ndarray


@dataclass(frozen=True)
class Ruler:
    """Squared gaps on the search's windows: what an engineer would see, beside what a likelihood sees."""

    replays: Replays
    scales: Scales
    floor: float  # squared gap of a perfect model

    def squared(self, fits: list[Fit]) -> np.ndarray:
        """(H,) squared gap of each fit, in which the windows whose prediction diverges under the last of them count at
        their limit."""
        data = self.replays.data
        errors = [data.y - p for p in self.replays([f.values for f in fits])]
        trust = window_trust(data, self.scales, errors[-1])
        return np.array([gap_of(data, self.scales, e, trust).total ** 2 for e in errors])

    def much_left(self, fit: Fit) -> bool:
        """Whether a fit leaves more than the sensors can tell from nothing (verdict `partial`)."""
        return bool(self.squared([fit])[0] > max(AS_GOOD**2 * self.floor, SMALL**2))


def build_ruler(replays: Replays, scales: Scales, base: Fit, rng: np.random.Generator) -> Ruler:
    """The ruler of a search; its floor comes from noise drawn by rng."""
    data = replays.data
    errors = noise_errors(data, replays.space.settings([base.values]), rng, 2)
    return Ruler(replays, scales, float(np.mean([gap_of(data, scales, e).total ** 2 for e in errors])))


TO_THE_END = 12  # steps of a fit without one of the terms
TOGETHER = 4  # terms up to which that is done at the end of a search: its cost grows with their cube
NEEDLESS = 60.0  # likelihood ratio beyond which such a fit is not carried on: the term is needed
DIVERGED = 0.5  # scaled error of a window: half of the motion is missed
TYPICAL = 4.0  # times the median window's error
FAR_FROM_FLOOR = 4.0  # times the squared noise floor
MUCH = 0.25  # of the squared gap
TRIMMED = 3  # children that are tried without each of their terms
NEEDED = 4.0  # likelihood ratio that such a term has to be worth
ALIKE = 10.0  # likelihood ratio below which two sets count as not told apart

Report = Callable[[str, float], None]  # what is done, and the share of the search that is behind


def search(
    problem: Problem,
    scales: Scales,
    settings: SearchSettings,
    rng: np.random.Generator,
    report: Report = lambda text, done: None,
    start: Values | None = None,
) -> Found:
    """Search on the problem's windows. The problem's own weights are those of the pure sensor noise; start: the values
    to go on from, None for the model alone."""
    noise = 1.0 / problem.weight
    blocks = blocks_of(problem.data)
    base_values: Values = {k: problem.space.null(k) for k in problem.space.tunables}
    base = fit_all(problem, [base_values])[0]
    ruler = build_ruler(problem.replays, scales, base, rng)
    beam = [base]
    if start is not None and len(start) > len(base_values):
        known = fit_all(problem, [start], 0)[0]
        beam = refit(judge(problem, known, noise, scales), [known])
    forward = Forward(problem, ruler, base, noise, blocks, report)
    beam, steps = forward.go_on(beam, settings)
    if ruler.much_left(beam[0]):  # what closes a good part of that is better than nothing
        unmarginalised = replace(forward, small_differences=False)
        beam, more = unmarginalised.go_on(beam[:1], settings.without_tolerances())
        if more:
            forward, settings, steps = unmarginalised, settings.without_tolerances(), steps + more
    last = beam[0]
    if steps and len(last.terms) <= TOGETHER:
        report("testing each effect by removing it", 1.0)
        last = prune(forward.at(last), ruler, last, base, noise, blocks, settings, thorough=True)
    here = judge(carrying(problem, last.values), last, noise, scales)
    current, base = refit(here, [last, base])
    sigma = 1.0 / judge(problem, current, noise, scales).weight
    return Found(here, current, base, dispersion(current, blocks), ruler, tuple(steps), sigma)


@dataclass(frozen=True)
class Forward:
    """Forward steps from a set of effects to larger ones. small_differences: whether those are marginalised."""

    problem: Problem
    ruler: Ruler
    base: Fit
    noise: np.ndarray
    blocks: np.ndarray
    report: Report
    small_differences: bool = True

    def at(self, fit: Fit) -> Problem:
        """The problem, carrying the columns of the small differences about this fit where they are marginalised."""
        return carrying(self.problem, fit.values) if self.small_differences else self.problem

    def _leaves_much(self, alone: Fit, best: Fit) -> bool:
        """Whether the best single effect leaves much of the gap."""
        before, after = self.ruler.squared([alone, best])
        return bool(after > MUCH * before and self.ruler.much_left(best))

    def go_on(self, beam: list[Fit], settings: SearchSettings) -> tuple[list[Fit], list[Step]]:
        """Further steps until none is convincing; the beam at the end and the steps taken."""
        steps, seen = list[Step](), {frozenset(beam[0].terms)}
        ruler, base, blocks = self.ruler, self.base, self.blocks
        while len(beam[0].terms) < settings.largest:
            problem = self.at(beam[0])
            here = judge(problem, beam[0], self.noise, ruler.scales)
            beam = refit(here, beam[:1]) + refit(here, beam[1:], ROUGH)  # from the others one only looks on
            named = len(beam[0].terms)
            text = f"searching ({named} effect{'' if named == 1 else 's'} so far)"
            self.report(text, named / settings.largest)
            children = additions(here, beam, blocks, settings)
            if named == 0 and children and self._leaves_much(beam[0], children[0]):
                children = sorted([*pairs(here, beam[0], blocks), *children], key=lambda f: f.cost)
            children = simplest_first(trimmed(here, children, blocks, seen), blocks)
            # the set with the lowest cost may improve the gap by too little to see; a later one may be the cause
            chosen = next((c for c in children if convincing(problem, ruler, beam[0], c, base, blocks, settings)), None)
            if chosen is None:
                break
            best = prune(problem, ruler, chosen, base, self.noise, blocks, settings)
            if frozenset(best.terms) in seen:  # what was added is dropped again: it would go on for ever
                break
            seen.add(frozenset(best.terms))
            steps.append(Step(chosen.terms, beam[0].cost, chosen.cost))
            beam = [best, *others(ruler, base, best, children, settings)]
        return beam, steps


def judge(problem: Problem, fit: Fit, noise: np.ndarray, scales: Scales) -> Problem:
    """The problem with small differences marginalised that this fit's residuals make likely, with each channel weighed
    by what is left then, never less than its noise, and with the windows in which the fit's prediction diverges
    weighing less (Huber's weights on whole windows)."""
    data, trust = problem.data, window_trust(problem.data, scales, problem.data.y - problem.replays([fit.values])[0])
    count = None if (trust == 1.0).all() else trust
    plain = tolerant(replace(reweigh(problem, noise), count=count, tolerances=problem.tolerances), fit)
    r = plain.residuals([fit.values])[0].reshape(*data.y.shape)
    seen = np.isfinite(data.y)
    left = np.sqrt(np.einsum("wmc,wmc->c", r, r) / np.maximum(np.einsum("w,wmc->c", trust, seen.astype(float)), 1.0))
    fair = reweigh(problem, noise * np.maximum(left, 1.0))
    return tolerant(replace(fair, count=count, tolerances=problem.tolerances), fit)


def window_trust(data: Dataset, scales: Scales, error: np.ndarray) -> np.ndarray:
    """(W,) weight of each window: 1, or less where its prediction has diverged. A window whose scaled error exceeds
    both DIVERGED and TYPICAL times the median window's counts as one at that limit."""
    square = per_window(data, scales, np.clip(np.nan_to_num(error, nan=np.nan), -1e6, 1e6))
    limit = max(DIVERGED, TYPICAL * float(np.sqrt(np.nanmedian(square)))) ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(square > limit, limit / square, 1.0)


def refit(problem: Problem, fits: list[Fit], most: int = 6) -> list[Fit]:
    """The same sets fitted on this problem, from where they were."""
    return fit_all(problem, [f.values for f in fits], most)


def trimmed(problem: Problem, children: list[Fit], blocks: np.ndarray, seen: set[frozenset[Term]]) -> list[Fit]:
    """Cheapest first; of the first few that the data do not tell apart, sets that grew from different ones of the beam,
    without a term that the others have made needless. seen: sets that the search has been at."""
    if len(children) < 2:
        return children
    phi = dispersion(children[0], blocks)
    near = [c for c in children[:TRIMMED] if len(c.terms) > 1 and c.cost <= children[0].cost + ALIKE * phi]
    if len(near) < 2:
        return children
    pairs = [(c, t) for c in near for t in c.terms if frozenset(c.terms) - {t} not in seen]
    fewer = fit_all(problem, [without(c.values, t) for c, t in pairs], ROUGH, rough=True, near=[c for c, _ in pairs])
    best: dict[int, Fit] = {}
    for (child, _), fit in zip(pairs, fewer, strict=True):
        if fit.cost <= child.cost + NEEDED * phi and (id(child) not in best or fit.cost < best[id(child)].cost):
            best[id(child)] = fit
    return distinct([best.get(id(c), c) for c in children])


def simplest_first(children: list[Fit], blocks: np.ndarray) -> list[Fit]:
    """Cheapest first, but of those that the data do not tell from the cheapest, the ones with fewer numbers first."""
    if len(children) < 2:
        return children
    reach = children[0].cost + ALIKE * dispersion(children[0], blocks)
    near = [c for c in children if c.cost <= reach]
    return sorted(near, key=lambda c: (len(c.knobs), c.cost)) + [c for c in children if c.cost > reach]


def others(ruler: Ruler, base: Fit, best: Fit, children: list[Fit], settings: SearchSettings) -> list[Fit]:
    """Runners-up that the next step may start from as well: none where the best leaves little to explain, since a
    greedy step goes wrong only while several causes still mix."""
    first, now = ruler.squared([base, best])
    if now - ruler.floor < settings.settled * (first - ruler.floor):
        return []
    return [c for c in children if frozenset(c.terms) != frozenset(best.terms)][: settings.beam - 1]


def convincing(
    problem: Problem,
    ruler: Ruler,
    current: Fit,
    best: Fit,
    base: Fit,
    blocks: np.ndarray,
    settings: SearchSettings,
) -> bool:
    """Beyond doubt against coloured residuals, and seen above the noise."""
    _, was, now = ruler.squared([base, current, best])
    removed, left = was - now, max(was - ruler.floor, 0.0)
    if removed < max(settings.over_floor * ruler.floor, settings.share * left):
        return False  # the cheap question first
    fair = judge(problem, best, 1.0 / problem.weight, ruler.scales)
    if fair.wide is not None:  # small differences let a fit rest where its gap is not smallest
        plain = fit_all(tolerating(fair, None), [current.values, best.values], 3, rough=True, fresh=[NONE, NONE])
        _, was, now = ruler.squared([base, *plain])
        removed, left = was - now, max(was - ruler.floor, 0.0)
        if removed < max(settings.over_floor * ruler.floor, settings.share * left):
            return False
    else:  # nothing is marginalised: the likelihood is as sure of itself as ever
        settings = settings.without_tolerances()
    after, before = fit_all(fair, [best.values, current.values], 3, fresh=[NONE, NONE])
    ratio = (before.cost - after.cost) / dispersion(after, blocks)
    knobs = len(after.knobs) - len(before.knobs)
    # far above the noise residuals are coloured and the ratio cautious: a quarter of what is left asks for less of it
    sizeable = left > FAR_FROM_FLOOR * ruler.floor and removed > settings.sizeable * left
    least = settings.beyond_doubt_sizeable if sizeable else settings.beyond_doubt
    if left > ruler.floor and removed > settings.most * left:  # the search is not finished while one effect closes that
        least = min(least, settings.beyond_doubt_most)
    return bool(ratio >= least + settings.per_knob * knobs)


def prune(
    problem: Problem,
    ruler: Ruler,
    current: Fit,
    base: Fit,
    noise: np.ndarray,
    blocks: np.ndarray,
    settings: SearchSettings,
    thorough: bool = False,
) -> Fit:
    """Drop terms that the others have made needless; thorough: the others are fitted to the end, and once more from
    elsewhere, since a term that was found first may have kept them from where they belong."""
    while len(current.terms) > 1:
        here = judge(problem, current, noise, ruler.scales)
        full = refit(here, [current])[0]
        race = Race(HOPELESS * dispersion(full, blocks))
        starts = [without(full.values, t) for t in full.terms]
        near, known = [full] * len(starts), [NONE] * len(starts)
        if thorough:
            more = [other for s in starts if (other := elsewhere(here, s)) is not None]
            near_enough = Race(NEEDLESS * dispersion(full, blocks), full.cost)
            fewer = fit_all(here, [*starts, *more], TO_THE_END, race=near_enough, rough=True)
        else:
            fewer = fit_all(here, starts, ROUGH, race=race, rough=True, near=near, fresh=known)
        weakest = min(fewer, key=lambda f: f.cost)
        if convincing(problem, ruler, weakest, full, base, blocks, settings):
            return full
        current = weakest
    return current


def without(values: Values, term: Term) -> dict[Knob, float]:
    """The values less one term's."""
    return {k: v for k, v in values.items() if k.effect == TUNE or k.term != term}
