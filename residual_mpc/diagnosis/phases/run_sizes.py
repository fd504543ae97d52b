"""Effects that have another size in each run, such as a gain that falls with the battery or the grip of two surfaces.

One size for all runs leaves what differs between them. The sizes come from the windows that fits may see; that of a run
that was held out comes from the first half of its windows, and the second half alone is judged.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.left_out import SLACK
from residual_mpc.diagnosis.options import Progress
from residual_mpc.diagnosis.phases.horizons import everywhere
from residual_mpc.diagnosis.phases.prepare import Prepared
from residual_mpc.diagnosis.phases.refine import Refined
from residual_mpc.diagnosis.phases.regroup import in_their_place, regrouped, still_judged
from residual_mpc.diagnosis.phases.remaining import Finish, better, window_errors
from residual_mpc.diagnosis.phases.search import search_effects
from residual_mpc.diagnosis.predict.group_space import GroupSpace, Sizes, resized, sized, zero_of
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.settings import PartSettings
from residual_mpc.diagnosis.results.variation import variations_in_fits
from residual_mpc.diagnosis.results.variation_records import Variation
from residual_mpc.models.settings import Term, Values
from residual_mpc.models.size_numbers import size_knobs

RunSizes = Mapping[int, Sizes]  # of each run (its index) the factors of the terms that it shows


@dataclass(frozen=True, eq=False)
class SizedByRun:
    """What sizes of their own in each run would explain. values: of the explanation with one size, before these sizes
    change the others; sizes: of the terms; windows: all of them, told apart by run; error: the mean of `window_errors`
    with these sizes."""

    values: Values
    sizes: RunSizes
    windows: Prepared
    error: float


def sizes_by_run(refined: Refined, progress: Progress) -> SizedByRun | None:
    """The sizes in each run of the effects whose sizes differ; None where one size does nearly as well."""
    prepared, of = refined.prepared, refined.explanation
    values, settings = of.final.values, prepared.options.settings
    if not of.final.terms or isinstance(prepared.space, GroupSpace):
        return None
    found = variations_in_fits(of, settings).items()
    by_run = {t: v.by_run for t, v in found if v.by_run is not None and not v.free and _has_size(values, t)}
    if not by_run:
        return None
    progress("fitting sizes for each run", 0.62)
    runs = prepared.raw.runs
    seen = _factors(values, by_run, [r.name for r in runs])
    sizes = {**seen, **_held_runs(prepared, values, seen, settings.parts)}
    judged_from = {i: _second_half(prepared.clean, i) for i in sizes.keys() - seen.keys()}
    alike = _in_place_of(refined, list(by_run), settings.search.rivals.far)
    sizes = {i: {m: f for t, f in s.items() for m in alike[t]} for i, s in sizes.items()}
    groups = [sizes.get(i, {}) for i in range(len(runs))]
    here = regrouped(prepared, lambda data: _groups(data, judged_from), groups)
    data = everywhere(here)
    now, before = (
        window_errors(data, here.scales, predict(data, space.settings([values]))[0])
        for space in (here.space, prepared.space)
    )
    if not still_judged(prepared, here) or not better(data, now, before, settings.parts, settings.fit):
        return None
    return SizedByRun(values, sizes, here, float(now.mean()))


def with_run_sizes(of: SizedByRun, finish: Finish, rng: np.random.Generator, progress: Progress) -> Refined | None:
    """The explanation with these sizes, carried on; None where no effect with them is left. finish: fits what a search
    has found to the end."""
    here = of.windows
    made = finish(search_effects(replace(here, options=replace(here.options, start=of.values)), rng, progress))
    final, names = made.explanation.final, [r.name for r in here.raw.runs]
    terms = dict.fromkeys(t for sizes in of.sizes.values() for t in sizes)
    varying = {t: _by_run(here, final.values, t, of.sizes, names) for t in terms if t in final.terms}
    if not varying:
        return None
    return replace(made, prepared=here, explanation=replace(made.explanation, run_sizes=varying))


def _in_place_of(refined: Refined, terms: Sequence[Term], far: float) -> dict[Term, frozenset[Term]]:
    """Of each term, itself and what may stand in its place: to first order it has the same factors."""
    of = refined.explanation
    steady = [t for t in of.final.terms if t not in terms]
    return {t: in_their_place(of.rivalry, [t], [*steady, *(x for x in terms if x != t)], far) for t in terms}


def _has_size(values: Values, term: Term) -> bool:
    """Whether the first number that says how much of an effect there is, is not at its null value."""
    knob = size_knobs(values, term)[0]
    return values[knob] != zero_of(knob)


def _factors(values: Values, by_run: Mapping[Term, Mapping[str, float]], names: list[str]) -> dict[int, Sizes]:
    """Of each run that shows some of the terms, the factors on their sizes."""
    out: dict[int, dict[Term, float]] = {}
    for term, found in by_run.items():
        knob = size_knobs(values, term)[0]
        for name, size in found.items():
            factor = (size - zero_of(knob)) / (values[knob] - zero_of(knob))
            out.setdefault(names.index(name), {})[term] = factor
    return dict(out)


def _held_runs(prepared: Prepared, values: Values, seen: RunSizes, settings: PartSettings) -> dict[int, Sizes]:
    """The factors of the runs of which no fit has seen a window, one term after the other, from the first half of each:
    where the parabola through the best of the sizes tried, over the range of the others' and beyond, is lowest."""
    data, out = prepared.clean, dict[int, Sizes]()
    terms = list(dict.fromkeys(t for sizes in seen.values() for t in sizes))
    for i in np.setdiff1d(data.run, data.run[prepared.free]).tolist():
        first = data.take((data.run == i) & (data.start < _second_half(data, i) - SLACK))
        sizes: dict[Term, float] = {}
        for term in terms if first.count else ():
            known = np.array([s[term] for s in seen.values() if term in s])
            beyond = settings.wider * float(np.ptp(known))
            tried = np.linspace(known.min() - beyond, known.max() + beyond, settings.sizes_tried)
            here = sized(values, sizes, prepared.space.bounds)
            rows = [resized(here, term, float(f), prepared.space.bounds) for f in tried]
            predicted = predict(first, prepared.space.settings(rows))
            errors = [float(window_errors(first, prepared.scales, y).sum()) for y in predicted]
            sizes[term] = lowest(tried, np.array(errors))
        out[i] = sizes
    return out


def lowest(x: np.ndarray, y: np.ndarray) -> float:
    """Where the parabola through the lowest of the evenly spaced points (n,) and its neighbours is lowest."""
    k = int(np.clip(np.argmin(y), 1, len(x) - 2))
    left, here, right = y[k - 1 : k + 2]
    curvature = left - 2.0 * here + right
    shift = 0.5 * (left - right) / curvature if curvature > 0.0 else 0.0
    return float(x[k] + np.clip(shift, -1.0, 1.0) * (x[1] - x[0]))


def _second_half(data: Dataset, run: int) -> float:
    """s: where the second half of a run's windows begins."""
    starts = np.sort(data.start[data.run == run])
    return float(starts[len(starts) // 2]) if len(starts) > 1 else np.inf


def _groups(data: Dataset, judged_from: Mapping[int, float]) -> np.ndarray:
    """(W,) the group of each window, that of its run; negative in the half of a held-out run that gave its size."""
    begin = np.array([judged_from.get(int(i), -np.inf) for i in data.run])
    return np.where(data.start >= begin - SLACK, data.run + 1, -1)


def _by_run(of: Prepared, values: Values, term: Term, sizes: RunSizes, names: list[str]) -> Variation:
    """The size in each run that shows it, in the unit of the effect's first number."""
    knob = size_knobs(values, term)[0]
    shown = {i: s[term] for i, s in sorted(sizes.items()) if term in s}
    return Variation(by_run={names[i]: resized(values, term, f, of.space.bounds)[knob] for i, f in shown.items()})
