"""Effects that have another size in each run, such as a gain that falls with the battery or the grip of two surfaces.

One size for all runs leaves what differs between them. The sizes come from the windows that fits may see; that of a run
that was held out comes from the first half of its windows, and the second half alone is judged.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.options import Progress
from residual_mpc.diagnosis.phases.horizons import everywhere
from residual_mpc.diagnosis.phases.refine import Refined
from residual_mpc.diagnosis.phases.regroup import regrouped
from residual_mpc.diagnosis.phases.remaining import Finish, better, missed, much_left, quiet
from residual_mpc.diagnosis.phases.search import search_effects
from residual_mpc.diagnosis.predict.group_space import GroupSpace, Sizes, sized, zero_of
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.results.variation import variations_in_fits
from residual_mpc.diagnosis.results.variation_records import Variation
from residual_mpc.models.settings import Term, Values
from residual_mpc.models.size_numbers import size_knobs

TRIED = 9  # sizes of a held-out run, over the range of those of the others and as much again
WIDER = 0.5  # of that range, on either side


def with_run_sizes(refined: Refined, finish: Finish, rng: np.random.Generator, progress: Progress) -> Refined | None:
    """The explanation in which effects have their own sizes in each run; None where one size does nearly as well."""
    prepared, of = refined.prepared, refined.explanation
    values, settings = of.final.values, prepared.options.settings
    if not of.final.terms or isinstance(prepared.space, GroupSpace) or not much_left(prepared, values, rng):
        return None
    found = variations_in_fits(of, settings)
    by_run = {t: v.by_run for t, v in found.items() if v.by_run is not None and not v.free}
    if not by_run:
        return None
    progress("fitting sizes for each run", 0.62)
    names = [r.name for r in prepared.raw.runs]
    sizes = _factors(values, by_run, names)
    begun = _of_held_runs(prepared.clean, prepared.free, prepared.space, values, sizes, refined)
    here = regrouped(prepared, lambda data: _groups(data, begun), [sizes[i] for i in range(len(names))])
    data = everywhere(here)
    now, before = (
        missed(data, here.scales, predict(data, space.settings([values]))[0]) for space in (here.space, prepared.space)
    )
    if not better(data, now, before, settings.parts, settings.fit):
        return None
    made = finish(search_effects(replace(here, options=replace(here.options, start=values)), rng, quiet))
    final = made.explanation.final
    sized_by_run = {t: _by_run(final.values, t, sizes, names) for t in by_run if t in final.terms}
    if not sized_by_run:
        return None
    return replace(made, prepared=here, explanation=replace(made.explanation, run_sizes=sized_by_run))


def _factors(
    values: Values, by_run: Mapping[Term, Mapping[str, float]], names: list[str]
) -> dict[int, dict[Term, float]]:
    """Of each run (its index) the factor on the size of each term, 1 where a run does not show it."""
    out: dict[int, dict[Term, float]] = {i: {} for i in range(len(names))}
    for term, found in by_run.items():
        knob = size_knobs(values, term)[0]
        for i, name in enumerate(names):
            out[i][term] = (found[name] - zero_of(knob)) / (values[knob] - zero_of(knob)) if name in found else 1.0
    return out


def _of_held_runs(
    data: Dataset, free: np.ndarray, space: Space, values: Values, sizes: dict[int, dict[Term, float]], of: Refined
) -> dict[int, float]:
    """Writes into the sizes those of the runs of which no fit has seen a window, from the first half of each; returns
    from when on such a run is judged, s."""
    seen = np.unique(data.run[free])
    begun: dict[int, float] = {}
    for i in (i for i in np.unique(data.run).tolist() if i not in seen):
        mine = np.flatnonzero(data.run == i)
        mine = mine[np.argsort(data.start[mine])]
        first = np.isin(np.arange(data.count), mine[: max(len(mine) // 2, 1)])
        part = data.take(first)
        for term in sizes[i]:
            known = np.array([sizes[j][term] for j in seen.tolist()])
            reach = WIDER * float(np.ptp(known))
            tried = np.linspace(known.min() - reach, known.max() + reach, TRIED)
            rows = space.settings([sized(values, {**sizes[i], term: float(f)}) for f in tried])
            sums = [float(missed(part, of.prepared.scales, y).sum()) for y in predict(part, rows)]
            sizes[i][term] = _lowest(tried, np.array(sums))
        begun[i] = float(data.start[mine[len(mine) // 2]]) if len(mine) > 1 else np.inf
    return begun


def _lowest(x: np.ndarray, y: np.ndarray) -> float:
    """Where the parabola through the lowest of the points (n,) and its neighbours is lowest."""
    k = int(np.clip(np.argmin(y), 1, len(x) - 2))
    left, here, right = y[k - 1 : k + 2]
    curvature = left - 2.0 * here + right
    shift = 0.5 * (left - right) / curvature if curvature > 0.0 else 0.0
    return float(x[k] + np.clip(shift, -1.0, 1.0) * (x[1] - x[0]))


def _groups(data: Dataset, begun: Mapping[int, float]) -> np.ndarray:
    """(W,) the group of each window, that of its run; negative in the half of a held-out run that gave its size."""
    from_when = np.array([begun.get(int(i), -np.inf) for i in data.run])
    return np.where(data.start >= from_when - 1e-6, data.run + 1, -1)


def _by_run(values: Values, term: Term, sizes: Mapping[int, Sizes], names: list[str]) -> Variation:
    """The size in each run, in the unit of the effect's first number."""
    knob = size_knobs(values, term)[0]
    return Variation(by_run={name: sized(values, sizes[i])[knob] for i, name in enumerate(names)})
