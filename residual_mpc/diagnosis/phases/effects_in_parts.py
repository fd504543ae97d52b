"""Effects that act in a part of the runs alone: a payload that is picked up, a delay that ends with a restart.

One explanation of all runs then averages over what differs. The effects are searched for in the part alone; those
without which the rest of the runs is predicted better act in the part only.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.parts import Part, groups_of
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.options import Progress
from residual_mpc.diagnosis.phases.horizons import everywhere
from residual_mpc.diagnosis.phases.prepare import Prepared
from residual_mpc.diagnosis.phases.refine import Refined, refine
from residual_mpc.diagnosis.phases.regroup import in_their_place, regrouped, still_judged
from residual_mpc.diagnosis.phases.remaining import Finish, better, compared, of_a_part, window_errors
from residual_mpc.diagnosis.phases.search import search_effects, search_headline, searched_share
from residual_mpc.diagnosis.phases.set_aside import with_fits_on
from residual_mpc.diagnosis.phases.splits import Split, sharpened, splits, timeline_of, with_held_runs
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.settings import PartSettings
from residual_mpc.diagnosis.results.variation_records import Variation
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Term, Values
from residual_mpc.models.size_numbers import size_knobs

TOGETHER = 8  # sets of effects that are predicted at once


def effects_in_parts(
    prepared: Prepared,
    refined: Refined,
    most: float,
    finish: Finish,
    rng: np.random.Generator,
    progress: Progress,
) -> Refined | None:
    """The explanation in which some effects act in a part of the runs alone; None where the runs do not show any, or
    where it leaves more than `most` in the mean of `window_errors`. finish: fits what a search has found to the end."""
    steady = refined.explanation.final.values
    for split in splits(prepared, refined)[: prepared.options.settings.parts.tried]:
        inside = _within_part(prepared, split, rng.spawn(1)[0], of_a_part(progress))
        found = (
            None if inside is None else _in_all_runs(prepared, steady, inside, most, finish, rng.spawn(1)[0], progress)
        )
        if found is not None:
            return found
    return None


@dataclass(frozen=True, eq=False)
class _Inside:
    """What was found in a part alone. values: the numbers; terms: the effects that act there alone, with those that
    rivals have in their place; windows: all of them, told apart; sigma: of the last fit."""

    split: Split
    values: Values
    terms: frozenset[Term]
    windows: Prepared
    sigma: np.ndarray


def _within_part(prepared: Prepared, split: Split, rng: np.random.Generator, progress: Progress) -> _Inside | None:
    """What a search in the part alone finds; None where no effect of it is absent from the rest, already before longer
    horizons and rivals are looked at."""
    settings = prepared.options.settings
    inside = with_fits_on(prepared, split.part.inside)
    first = search_headline(inside, rng, lambda stage, done: progress(stage, searched_share(done)))
    if not _absent(prepared, first.fit.values, split.part, settings.parts):
        return None
    searched = search_effects(inside, rng, progress, found=first)
    values = refine(searched, rng, progress).explanation.final.values
    absent = _absent(prepared, values, split.part, settings.parts)
    if not absent:
        return None
    split = _sharpened(prepared, values, absent, split)
    steady = [k.term for k in values if k.effect != TUNE and k.term not in absent]
    terms = in_their_place(searched.rivalry, absent, steady, settings.search.rivals.far)
    windows = regrouped(prepared, lambda data: groups_of(data, split.part), [dict.fromkeys(terms, 0.0)])
    return _Inside(split, values, terms, windows, searched.found.sigma)


def _in_all_runs(
    prepared: Prepared,
    steady: Values,
    inside: _Inside,
    most: float,
    finish: Finish,
    rng: np.random.Generator,
    progress: Progress,
) -> Refined | None:
    """What was found in the part, carried on in all runs; None where it explains them hardly better than effects that
    always act, or leaves more than `most`, or where no held-out window is left."""
    of, settings = inside.windows, prepared.options.settings
    data = everywhere(of)
    before = window_errors(data, of.scales, predict(data, prepared.space.settings([steady]))[0])

    def improves(values: Values) -> bool:
        now = window_errors(data, of.scales, predict(data, of.space.settings([values]))[0])
        return float(now.mean()) < most and better(data, now, before, settings.parts, settings.fit)

    problem = build_problem(data, of.space, inside.sigma, of.scales.motion, settings=settings.predict)
    (fit,) = fit_all(problem, [inside.values], settings=settings.fit)  # the part was another before its instant moved
    if not still_judged(prepared, of) or not improves(fit.values):
        return None
    # what acts everywhere may be another effect than the one that the part alone shows
    begun = replace(of, options=replace(of.options, start=fit.values))
    made = finish(search_effects(begun, rng, progress))
    final = made.explanation.final
    named = [t for t in final.terms if t in inside.terms]
    if not named or not improves(final.values):
        return None
    part, runs = inside.split.part, data.runs
    variation = inside.split.variation(runs)
    varying = {t: variation or _by_run(of.clean, part, final.values, t) for t in named}
    return replace(made, prepared=of, explanation=replace(made.explanation, in_parts=varying))


def _sharpened(prepared: Prepared, values: Values, absent: Sequence[Term], split: Split) -> Split:
    """The split with its instant where the windows show it, and with the runs that were held out."""
    less = {k: v for k, v in values.items() if k.term not in absent}
    rows = prepared.space.settings([values, less])

    def errors(data: Dataset, order: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        inside, outside = (window_errors(data, prepared.scales, y)[order] for y in predict(data, rows))
        return inside, outside

    data = prepared.fitting.take(compared(prepared.fitting))
    timeline, order = timeline_of(data)
    inside, outside = errors(data, order)
    split = sharpened(timeline, split, inside, outside, settings=prepared.options.settings.parts)
    timeline, order = timeline_of(prepared.clean)
    inside, outside = errors(prepared.clean, order)
    settings = prepared.options.settings.parts
    return with_held_runs(timeline, split, prepared.free[order], inside, outside, settings)


def _absent(prepared: Prepared, values: Values, part: Part, settings: PartSettings) -> tuple[Term, ...]:
    """The effects without which the windows outside the part are predicted best; none of them if that is hardly better
    than with all."""
    rest = everywhere(prepared)
    rest = rest.take(part.outside(rest))
    terms = list(dict.fromkeys(k.term for k in values if k.effect != TUNE))[: settings.most]
    sets = [frozenset(s) for s in chain.from_iterable(combinations(terms, n) for n in range(len(terms) + 1))]
    if not rest.count or not terms:
        return ()
    rows = [{k: v for k, v in values.items() if k.term not in s} for s in sets]
    left: list[np.ndarray] = []
    for k in range(0, len(rows), TOGETHER):
        predicted = predict(rest, prepared.space.settings(rows[k : k + TOGETHER]))
        left += [window_errors(rest, prepared.scales, y) for y in predicted]
    sums = [float(x.sum()) for x in left]
    least = min(sums)
    # the smallest set that does about as well: an effect that hardly acts in the rest is then not called absent
    best = min((k for k, s in enumerate(sums) if s <= settings.as_good * least), key=lambda k: (len(sets[k]), sums[k]))
    fewer = better(rest, left[best], left[0], settings, prepared.options.settings.fit)
    return tuple(t for t in terms if t in sets[best]) if fewer else ()


def _by_run(data: Dataset, part: Part, values: Values, term: Term) -> Variation:
    """The size in each run, of an effect that acts in some of them: as it is there, and nothing elsewhere."""
    knob = size_knobs(values, term)[0]
    null = BY_NAME[knob.effect].parameter(knob.parameter).null
    runs = {int(i): data.runs[i].name for i in np.unique(data.run)}
    if np.isinf(null):  # a limit or a stiffness that the rest lacks has no size there
        acts = {name: values[knob] for i, name in runs.items() if i in part.where}
        return Variation(by_run=acts, free=tuple(name for name in runs.values() if name not in acts))
    return Variation(by_run={name: values[knob] if i in part.where else null for i, name in runs.items()})
