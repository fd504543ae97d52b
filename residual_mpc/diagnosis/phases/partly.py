"""Effects that act in a part of the runs alone: a payload that is picked up, a delay that ends with a restart.

One explanation of all runs then averages over what differs. The effects are searched for in the part alone; those
without which the rest of the runs is predicted better act in the part only.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, combinations

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.diagnosis.data.parts import Part, groups_of
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.options import Progress
from residual_mpc.diagnosis.phases.horizons import everywhere
from residual_mpc.diagnosis.phases.prepare import Prepared
from residual_mpc.diagnosis.phases.refine import Refined, refine
from residual_mpc.diagnosis.phases.regroup import regrouped
from residual_mpc.diagnosis.phases.remaining import Finish, better, missed, much_left, quiet
from residual_mpc.diagnosis.phases.search import Searched, search_effects
from residual_mpc.diagnosis.phases.splits import Split, sharpened, splits, timeline_of, with_held_runs
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.settings import PartSettings
from residual_mpc.diagnosis.results.variation_records import Variation
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Term, Values
from residual_mpc.models.size_numbers import size_knobs


def partly(
    prepared: Prepared, refined: Refined, finish: Finish, rng: np.random.Generator, progress: Progress
) -> Refined | None:
    """The explanation in which some effects act in a part of the runs alone; None where the runs do not show any.
    finish: fits what a search has found to the end."""
    settings = prepared.options.settings.parts
    if not much_left(prepared, refined.explanation.final.values, rng):
        return None
    for split in splits(prepared, refined)[: settings.tried]:
        progress("searching in a part of the runs", 0.3)
        found = _in_part(prepared, refined.explanation.final.values, split, finish, rng.spawn(1)[0])
        if found is not None:
            return found
    return None


def _in_part(
    prepared: Prepared, steady: Values, split: Split, finish: Finish, rng: np.random.Generator
) -> Refined | None:
    """What a search in the part alone finds, carried on in all runs; None where no effect of it is absent from the
    rest, or it explains all runs hardly better than effects that always act."""
    settings = prepared.options.settings
    searched = search_effects(_only_inside(prepared, split.part), rng, quiet)
    values = refine(searched, rng, quiet).explanation.final.values
    absent = _absent(prepared, values, split.part, settings.parts)
    if not absent:
        return None
    part = _sharpened(prepared, values, absent, split)
    terms = frozenset(absent) | _in_their_place(searched, absent)
    of = regrouped(prepared, lambda data: groups_of(data, part.part), [dict.fromkeys(terms, 0.0)])
    data = everywhere(of)
    problem = build_problem(data, of.space, searched.found.sigma, of.scales.motion, settings=settings.predict)
    (fit,) = fit_all(problem, [values], settings=settings.fit)  # the part was another before its instant moved
    values = fit.values
    rows = ((of, values), (prepared, steady))
    now, before = (missed(data, of.scales, predict(data, p.space.settings([v]))[0]) for p, v in rows)
    if not better(data, now, before, settings.parts, settings.fit):
        return None
    # what acts everywhere may be another effect than the one that the part alone shows
    begun = replace(of, options=replace(of.options, start=values))
    made = finish(search_effects(begun, rng, quiet))
    made = replace(made, prepared=of)
    final = made.explanation.final
    named = [t for t in final.terms if t in terms]
    said = {t: part.variation(data.runs) or _by_run(of.clean, part.part, final.values, t) for t in named}
    return replace(made, explanation=replace(made.explanation, partly=said)) if said else None


def _sharpened(prepared: Prepared, values: Values, absent: Sequence[Term], split: Split) -> Split:
    """The split with its instant where the windows show it, and with the runs that were held out."""
    less = {k: v for k, v in values.items() if k.term not in absent}
    rows = prepared.space.settings([values, less])

    def both(data: Dataset, order: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        inside, outside = (missed(data, prepared.scales, y)[order] for y in predict(data, rows))
        return inside, outside

    line, order = timeline_of(prepared.fitting)
    split = sharpened(line, split, *both(prepared.fitting, order))
    line, order = timeline_of(prepared.clean)
    part = with_held_runs(line, split.part, prepared.free[order], *both(prepared.clean, order))
    return replace(split, part=part)


def _absent(prepared: Prepared, values: Values, part: Part, settings: PartSettings) -> tuple[Term, ...]:
    """The effects without which the windows outside the part are predicted best; none of them if that is hardly better
    than with all."""
    rest = everywhere(prepared)
    rest = rest.take(part.outside(rest))
    terms = list(dict.fromkeys(k.term for k in values if k.effect != TUNE))[: settings.most]
    sets = [frozenset(s) for s in chain.from_iterable(combinations(terms, n) for n in range(len(terms) + 1))]
    rows = prepared.space.settings([{k: v for k, v in values.items() if k.term not in s} for s in sets])
    left = [missed(rest, prepared.scales, y) for y in predict(rest, rows)]
    sums = [float(x.sum()) for x in left]
    least = min(sums)
    # an effect that hardly acts in the rest is not absent from it: of sets that do as well, the smallest
    best = min((k for k, s in enumerate(sums) if s <= settings.as_good * least), key=lambda k: (len(sets[k]), sums[k]))
    fewer = better(rest, left[best], left[0], settings, prepared.options.settings.fit)
    return tuple(t for t in terms if t in sets[best]) if fewer else ()


def _in_their_place(searched: Searched, absent: Sequence[Term]) -> frozenset[Term]:
    """What rivals have in place of effects that act in the part alone: it acts there alone as well."""
    return frozenset(t for r in searched.rivalry.rivals if set(r.gone) <= set(absent) for t in r.came)


def _by_run(data: Dataset, part: Part, values: Values, term: Term) -> Variation:
    """The size in each run, of an effect that acts in some of them: as it is there, and nothing elsewhere."""
    knob = size_knobs(values, term)[0]
    null = BY_NAME[knob.effect].parameter(knob.parameter).null
    runs = {int(i): data.runs[i].name for i in np.unique(data.run)}
    if np.isinf(null):  # a limit or a stiffness that the rest lacks has no size there
        acts = {name: values[knob] for i, name in runs.items() if i in part.where}
        return Variation(by_run=acts, free=tuple(name for name in runs.values() if name not in acts))
    return Variation(by_run={name: values[knob] if i in part.where else null for i, name in runs.items()})


def _only_inside(prepared: Prepared, part: Part) -> Prepared:
    """With the windows in the part alone for the fits."""

    def inside(windows: tuple[Dataset, Scales] | None) -> tuple[Dataset, Scales] | None:
        keep = np.zeros(0, dtype=bool) if windows is None else part.inside(windows[0])
        return None if windows is None or not keep.any() else (windows[0].take(keep), windows[1])

    longer = tuple(replace(look, free=inside(look.free)) for look in prepared.longer)
    free = prepared.free & part.inside(prepared.raw)
    return replace(prepared, free=free, longer=longer, near=inside(prepared.near))
