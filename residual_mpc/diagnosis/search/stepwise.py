"""Which set of effects: forward by the best addition, back by pruning, across by swapping, until nothing changes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.diagnosis.fit.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, Race, fit_all
from residual_mpc.diagnosis.fit.marginalisation import carrying
from residual_mpc.diagnosis.fit.start_values import elsewhere
from residual_mpc.diagnosis.predict.effect_sets import EffectSet, without
from residual_mpc.diagnosis.predict.problem import Problem, about
from residual_mpc.diagnosis.search.acceptance import Ruler, build_ruler, convincing, judge
from residual_mpc.diagnosis.search.additions import NONE, additions, distinct, simplest_first
from residual_mpc.diagnosis.search.beam import leaving_far_less, others, trimmed
from residual_mpc.diagnosis.search.by_target import by_target, counted
from residual_mpc.diagnosis.search.off_bounds import off_bounds
from residual_mpc.diagnosis.search.optional_numbers import freed, makeup, with_shown, without_numbers
from residual_mpc.diagnosis.search.pairs import pairs
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.models.settings import Term, Values


@dataclass(frozen=True)
class Step:
    """One accepted step of the search, for the report: the set after it, and its cost in that step's weights."""

    terms: EffectSet
    before: float
    after: float


@dataclass(frozen=True)
class Found:
    """The chosen set on its final weights, its sub- and rival sets on the same weights, and the way there; met: the
    likeliest other sets that the last steps came across, as they were there; sigma (C,): standard deviations for fits
    that know of no small differences; anew: whether the search also began with the nominal model and without small
    differences."""

    problem: Problem
    fit: Fit
    base: Fit
    phi: float
    ruler: "Ruler"
    steps: tuple[Step, ...]
    met: tuple[Fit, ...]
    sigma: np.ndarray
    anew: bool = False


# What else is worth a first look, by term: from a problem and a fit on it
Suggest = Callable[[Problem, Fit], Mapping[Term, tuple[Values, ...]]]
Report = Callable[[str, float], None]  # what is done, and the share of the search that is behind
Accepted = Callable[[Ruler, Fit, Fit], None]  # the ruler, the fit without effects, and the set that was accepted


def unseen(ruler: Ruler, base: Fit, best: Fit) -> None:
    """Ignore the accepted set."""


def stepwise_search(
    problem: Problem,
    scales: Scales,
    settings: SearchSettings,
    rng: np.random.Generator,
    report: Report = lambda text, done: None,
    start: Values | None = None,
    questioned: bool = False,
    accepted: Accepted = unseen,
    suggest: Suggest = lambda problem, fit: {},
    anew: bool = True,
) -> Found:
    """Search on the problem's windows. The problem's own weights are those of the pure sensor noise; start: the values
    to go on from, None for the model alone; questioned: whether its effects are tested again where nothing is added;
    accepted: told each set that the search moves on to; suggest: the first looks at effects that have no probes;
    anew: whether it may begin again with the nominal model where much is left."""
    noise = 1.0 / problem.weight
    blocks = blocks_of(problem.data, settings=settings.fit)
    base_values: Values = {k: problem.space.null(k) for k in problem.space.tunables}
    base = fit_all(problem, [base_values], settings=settings.fit)[0]
    ruler = build_ruler(problem.replays, scales, base, rng, settings.data)
    beam = [base]
    if start is not None and len(start) > len(base_values):
        known = fit_all(problem, [start], 0, settings=settings.fit)[0]
        beam = refit(judge(problem, known, noise, scales, settings=settings), [known], settings=settings)
    forward = Forward(problem, ruler, base, noise, blocks, report, suggest, settings, accepted=accepted)
    beam, steps, met = forward.go_on(beam, [])
    # what closes a good part of what is left is better than nothing. Where that is little, small differences of
    # everything may take up what one effect does
    much = forward.much_left(beam[0])
    marginalised, again = settings.fit.predict.tolerances.marginalised, False
    if marginalised and (much or forward.ruler_about(beam[0]).visible(beam[0], settings)):
        unmarginalised = replace(forward, settings=settings.without_tolerances(), small_differences=False)
        go_on = unmarginalised.from_both if anew and beam[0].terms else unmarginalised.go_on
        further_beam, further, seen_there = go_on(beam[:1], steps)
        again = anew or not beam[0].terms
        if further != steps and (much or forward.far_smaller(further_beam[0], beam[0])):
            beam, met = further_beam, seen_there
            forward, settings, steps = unmarginalised, unmarginalised.settings, further
    last = beam[0]
    if (steps or questioned) and len(last.terms) <= settings.steps.together:
        report("testing each effect by removing it", 1.0)
        closer = forward.at(last)
        last = prune(closer, forward.ruler_at(closer), last, base, noise, blocks, settings, thorough=True)
    problem = about(problem, last.values, settings=settings.predict)
    ruler = forward.ruler_at(problem)
    here = judge(carrying(problem, last.values, settings=settings.fit), last, noise, scales, settings=settings)
    current, base = refit(here, [last, base], settings=settings)
    sigma = 1.0 / judge(problem, current, noise, scales, settings=settings).weight
    chosen = makeup(current.values)
    others_met = tuple(f for f in met if makeup(f.values) != chosen)[: settings.steps.met]
    return Found(here, current, base, dispersion(current, blocks), ruler, tuple(steps), others_met, sigma, again)


@dataclass(frozen=True)
class Forward:
    """Forward steps from a set of effects to larger ones. small_differences: whether those are marginalised."""

    problem: Problem
    ruler: Ruler
    base: Fit
    noise: np.ndarray
    blocks: np.ndarray
    report: Report
    suggest: Suggest
    settings: SearchSettings
    small_differences: bool = True
    accepted: Accepted = unseen

    def at(self, fit: Fit) -> Problem:
        """The problem about this fit, carrying the columns of the small differences where they are marginalised."""
        problem = about(self.problem, fit.values, settings=self.settings.predict)
        return carrying(problem, fit.values, settings=self.settings.fit) if self.small_differences else problem

    def ruler_at(self, problem: Problem) -> Ruler:
        """The ruler with this problem's predictions."""
        return replace(self.ruler, replays=problem.replays)

    def _leaves_much(self, ruler: Ruler, alone: Fit, best: Fit) -> bool:
        """Whether the best single effect leaves much of the gap."""
        before, after = ruler.squared([alone, best])
        return bool(after > self.settings.steps.much * before and ruler.much_left(best))

    def much_left(self, fit: Fit) -> bool:
        """Whether a fit leaves more than the sensors can tell from nothing."""
        return self.ruler_about(fit).much_left(fit)

    def ruler_about(self, fit: Fit) -> Ruler:
        """The ruler with the predictions about this fit."""
        return self.ruler_at(about(self.problem, fit.values, settings=self.settings.predict))

    def far_smaller(self, fit: Fit, than: Fit) -> bool:
        """Whether a fit leaves a far smaller gap than another."""
        own, other = self.ruler_about(than).squared([fit, than])
        return bool(own < self.settings.rivals.far_smaller * other)

    def _choose(self, problem: Problem, ruler: Ruler, current: Fit, children: list[Fit]) -> tuple[Fit, Fit] | None:
        """The first of these sets that is convincing, or another one that is and leaves a far smaller gap: as it is,
        and from where to go on."""

        def first(some: list[Fit]) -> tuple[Fit, Fit] | None:
            base, blocks, settings = self.base, self.blocks, self.settings
            looked_at = ((c, convincing(problem, ruler, current, c, base, blocks, settings)) for c in some)
            return next(((c, onward) for c, onward in looked_at if onward is not None), None)

        # the set with the lowest cost may improve the gap by too little to see; a later one may be the cause
        chosen = first(children)
        if chosen is None:
            return None
        return first(leaving_far_less(ruler, children, chosen[1], self.settings)) or chosen

    def from_both(self, beam: list[Fit], steps: list[Step]) -> tuple[list[Fit], list[Step], list[Fit]]:
        """As `go_on` from these sets, or from the nominal model where that leads to a far smaller gap: what was found
        first may have kept the search from the cause."""
        further, settings = self.go_on(beam, steps), self.settings
        begun = replace(
            self,
            report=lambda text, done: self.report(f"{text}, from the beginning", done),
            # with contacts, which only MuJoCo replays, so many hypotheses take minutes
            settings=replace(settings, pairs=replace(settings.pairs, always=not self.problem.space.rough)),
        )
        other = begun.go_on([self.base], [])
        return other if self.far_smaller(other[0][0], further[0][0]) else further

    def go_on(self, beam: list[Fit], steps: list[Step]) -> tuple[list[Fit], list[Step], list[Fit]]:
        """Further steps until none is convincing; the beam at the end, the steps taken so far, and the sets that the
        last two steps came across, those of the last step first, each cheapest first."""
        steps, seen, met = list(steps), {makeup(beam[0].values)}, list[Fit]()
        base, blocks, settings = self.base, self.blocks, self.settings
        while counted(beam[0].terms) < settings.largest:
            problem = self.at(beam[0])
            ruler = self.ruler_at(problem)
            here = judge(problem, beam[0], self.noise, ruler.scales, settings=settings)
            looked_on = refit(here, beam[1:], settings.additions.rough, settings=settings)
            beam = [off_bounds(here, f, settings) for f in refit(here, beam[:1], settings=settings)] + looked_on
            here = replace(here, space=replace(here.space, suggested=self.suggest(here, beam[0])))
            named = len(beam[0].terms)
            text = f"searching ({named} effect{'' if named == 1 else 's'} so far)"
            self.report(text, named / settings.largest)
            children = additions(here, beam, blocks, settings)
            alone = named == 0 and settings.pairs.sought and bool(children)
            if alone and (settings.pairs.always or self._leaves_much(ruler, beam[0], children[0])):
                children = sorted([*pairs(here, beam[0], blocks, settings=settings), *children], key=lambda f: f.cost)
            children = trimmed(here, children, blocks, seen, settings=settings)
            met = distinct([*children[: settings.steps.met], *met[: settings.steps.met]])
            children = simplest_first(children, blocks, settings=settings)
            chosen = self._choose(problem, ruler, beam[0], children)
            # what acts on all targets alike may differ between them, and what is added may only make up for that
            apart = by_target(here, beam[0], blocks, settings)
            if chosen is not None:
                apart = leaving_far_less(ruler, apart, chosen[1], settings)
            told = self._choose(problem, ruler, beam[0], apart)
            chosen, children = (chosen, children) if told is None else (told, apart)
            if chosen is None:
                break
            child, onward = chosen
            best = prune(problem, ruler, onward, base, self.noise, blocks, settings)
            if makeup(best.values) in seen:  # what was added is dropped again: it would go on for ever
                break
            seen.add(makeup(best.values))
            self.accepted(ruler, base, best)
            steps.append(Step(child.terms, beam[0].cost, child.cost))
            beam = [best, *others(ruler, base, best, children, settings)]
        return beam, steps, met


def refit(problem: Problem, fits: list[Fit], most: int = 6, *, settings: SearchSettings) -> list[Fit]:
    """The same sets fitted on this problem, from where they were."""
    return fit_all(problem, [f.values for f in fits], most, settings=settings.fit)


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
    """Drop terms and optional numbers that the others have made needless; thorough: the others are fitted to the end,
    and once more from elsewhere, since a term that was found first may have kept them from where they belong."""
    while len(current.terms) > 1 or freed(current.values):
        here = judge(problem, current, noise, ruler.scales, settings=settings)
        full = refit(here, [current], settings=settings)[0]
        race = Race(settings.additions.hopeless * dispersion(full, blocks))
        starts = [without_numbers(full.values, k) for k in freed(full.values)]
        starts += [without(full.values, t) for t in full.terms] if len(full.terms) > 1 else []
        near, known = [full] * len(starts), [NONE] * len(starts)
        if thorough:
            more = [other for s in starts if (other := elsewhere(here, s, settings=settings.fit)) is not None]
            near_enough = Race(settings.steps.needless * dispersion(full, blocks), full.cost)
            fewer = fit_all(
                here,
                [*starts, *more],
                settings.steps.thorough_steps,
                race=near_enough,
                rough=True,
                settings=settings.fit,
            )
        else:
            fewer = fit_all(
                here,
                starts,
                settings.additions.rough,
                race=race,
                rough=True,
                near=near,
                fresh=known,
                settings=settings.fit,
            )
        # an effect that stands for where another acts is needless once that is free; with as many numbers it has to fit
        # better for that
        anew = [replace(f, fresh=None) for f in fewer if len(f.terms) < len(full.terms)]
        shown = [f for f in with_shown(here, anew, dispersion(full, blocks), 1.0, settings) if f is not None]
        simpler = [f for f in shown if len(f.knobs) < len(full.knobs) or f.cost <= full.cost]
        weakest = min([*fewer, *simpler], key=lambda f: f.cost)
        kept = convincing(problem, ruler, weakest, full, base, blocks, settings)
        if kept is not None:
            return kept
        current = weakest
    return current
