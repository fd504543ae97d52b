"""Which stage of the chain the gap comes from: each named effect's share of the squared gap, averaged over orders."""

from collections.abc import Sequence
from itertools import combinations
from math import factorial

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, gap_of
from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.effect_sets import EffectSet
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.results.records import GapStep, StageShare
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Term, Values


def staged(
    data: Dataset,
    scales: Scales,
    space: Space,
    final: Fit | None,
    gaps: tuple[float, float, float],
    steps: int,
    settings: ResultSettings,
) -> tuple[tuple[GapStep, ...], tuple[StageShare, ...]]:
    """The gap on these windows after each effect is added (largest first), and the stages' shares of its square.

    final: None where no effect helps. gaps: before, after and of a perfect model, of the windows as they were logged.
    Each effect's share, which takes every subset of the effects, comes from `steps` simulation steps' worth of windows,
    fewer where the subsets are many.
    """
    start, after, floor = gaps
    if final is None:
        noise = min(floor, start) ** 2 / max(start**2, 1e-30)
        return (GapStep((), start),), (StageShare("unexplained", 1.0 - noise), StageShare("noise", noise))
    if not final.terms:  # samples that jump away are all there is
        return (GapStep((), start),), stage_shares({}, after, floor, start**2 - after**2)
    few = evenly(
        data, steps * settings.full_subsets // max(2 ** len(final.terms), settings.full_subsets), settings=settings.data
    )
    subsets = [frozenset(c) for n in range(len(final.terms) + 1) for c in combinations(final.terms, n)]
    part = squared_gaps(data.take(few), scales, space, final.values, subsets)
    drops = shapley(part, final.terms)
    order = sorted(final.terms, key=lambda t: -drops[t])
    chain = [frozenset(order[:n]) for n in range(len(order) + 1)]
    whole = part if few.all() else squared_gaps(data, scales, space, final.values, chain)
    fallen = part[chain[0]] - part[chain[-1]]
    scale = (whole[chain[0]] - whole[chain[-1]]) / fallen if fallen > 0.0 else 1.0  # exactly 1 where all were taken
    flagged = max(start**2 - whole[chain[0]], 0.0)
    shares = stage_shares({t: scale * d for t, d in drops.items()}, after, floor, flagged)
    added = [GapStep(tuple(order[:n]), float(np.sqrt(whole[chain[n]]))) for n in range(1, len(order) + 1)]
    return (GapStep((), start), *added), shares


def squared_gaps(
    data: Dataset, scales: Scales, space: Space, values: Values, subsets: Sequence[frozenset[Term]]
) -> dict[frozenset[Term], float]:
    """Squared gap of each set of terms, the others at null."""
    rows = [{k: v for k, v in values.items() if k.effect == TUNE or k.term in s} for s in subsets]
    predicted = predict(data, space.settings(rows))
    return {s: gap_of(data, scales, data.y - p).total ** 2 for s, p in zip(subsets, predicted, strict=True)}


def shapley(gaps: dict[frozenset[Term], float], terms: EffectSet) -> dict[Term, float]:
    """Each term's share of the drop in squared gap (Shapley 1953): its mean over all orders of adding."""
    n = len(terms)
    out = dict.fromkeys(terms, 0.0)
    for term in terms:
        for subset in gaps:
            if term in subset:
                continue
            weight = factorial(len(subset)) * factorial(n - len(subset) - 1) / factorial(n)
            out[term] += weight * (gaps[subset] - gaps[subset | {term}])
    return out


def stage_shares(drops: dict[Term, float], after: float, floor: float, outliers: float) -> tuple[StageShare, ...]:
    """Shares of the squared gap before: by stage of the named effects, what is left, and the noise."""
    shares: dict[str, float] = {}
    for term, drop in drops.items():
        stage = BY_NAME[term.effect].stage
        shares[stage] = shares.get(stage, 0.0) + max(drop, 0.0)
    if outliers > 0:
        shares["sensor"] = shares.get("sensor", 0.0) + outliers
    noise = min(floor**2, after**2)
    shares["noise"] = noise
    shares["unexplained"] = max(after**2 - noise, 0.0)
    total = max(sum(shares.values()), 1e-30)
    return tuple(sorted((StageShare(k, float(v / total)) for k, v in shares.items()), key=lambda s: -s.share))
