"""Which stage of the chain the gap comes from: each named effect's share of the squared gap, averaged over orders."""

from itertools import combinations
from math import factorial

from residual_mpc.diagnosis.dataset import Dataset
from residual_mpc.diagnosis.gap import Scales, gap_of
from residual_mpc.diagnosis.replay import predict
from residual_mpc.diagnosis.space import Space
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Term, Values


def squared_gaps(
    data: Dataset, scales: Scales, space: Space, values: Values, terms: tuple[Term, ...]
) -> dict[frozenset[Term], float]:
    """Squared gap of every subset of the terms, the others at null."""
    subsets = [frozenset(c) for n in range(len(terms) + 1) for c in combinations(terms, n)]
    rows = [{k: v for k, v in values.items() if k.effect == TUNE or k.term in s} for s in subsets]
    predicted = predict(data, space.settings(rows))
    return {s: gap_of(data, scales, data.y - p).total ** 2 for s, p in zip(subsets, predicted, strict=True)}


def shapley(gaps: dict[frozenset[Term], float], terms: tuple[Term, ...]) -> dict[Term, float]:
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


def stage_shares(
    drops: dict[Term, float], after: float, floor: float, outliers: float
) -> tuple[tuple[str, float], ...]:
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
    return tuple(sorted(((k, float(v / total)) for k, v in shares.items()), key=lambda ks: -ks[1]))
