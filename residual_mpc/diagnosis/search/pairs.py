"""Two effects that help only together.

A servo that is too weak sags unless friction holds the joint, for example: neither of the two is worth adding alone.
"""

from collections import Counter
from itertools import combinations

import numpy as np

from residual_mpc.diagnosis.fit.evidence import dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, Race, fit_all
from residual_mpc.diagnosis.fit.start_values import possible
from residual_mpc.diagnosis.predict.problem import Problem, part_of
from residual_mpc.diagnosis.search.additions import closer, distinct, mixed
from residual_mpc.diagnosis.search.screen import drawn, gap_weights, smaller
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.models.settings import TUNE, Values

ROWS = 96  # hypotheses replayed at once: bounds the memory


def pairs(problem: Problem, alone: Fit, blocks: np.ndarray, settings: SearchSettings) -> list[Fit]:
    """The best sets of two effects, each on all targets alike, cheapest first; alone: the model without effects.

    All probes of one effect with all of another are replayed on a quarter of the screening's windows.
    """
    small, weight = smaller(problem, alone, settings=settings)
    cost = np.einsum("wn,wn->w", r := small.residuals([alone.values])[0], r)
    quarter = drawn(cost, max(settings.screen.fewest_quick, small.data.count // 4), power=1.0)
    quick = part_of(small, quarter > 0, quarter[quarter > 0])
    probes = [(t, p) for t in problem.space.candidates if t.target is None for p in problem.space.probes(t)]
    starts: list[Values] = [
        {**alone.values, **p, **q} for (a, p), (b, q) in combinations(probes, 2) if problem.space.may_join(b, (a,))
    ]
    if not starts:
        return []
    scores = [s for k in range(0, len(starts), ROWS) for s in _scores(quick, starts[k : k + ROWS])]
    columns = np.array(scores).T
    rankings = [[starts[i] for i in np.argsort(column, kind="stable")] for column in columns]
    ranked = mixed(*rankings)
    begun = fit_all(
        small, _of_each_pair(ranked, settings=settings), settings.additions.rough, rough=True, settings=settings.fit
    )
    margin = settings.additions.hopeless * dispersion(alone, blocks)
    fits = closer(problem, small, distinct(begun), Race(margin / weight), Race(margin), settings=settings)
    return sorted((f for f in fits if possible(f.values)), key=lambda f: f.cost)


def _scores(problem: Problem, starts: list[Values]) -> list[tuple[float, float]]:
    """Of each hypothesis: its cost, and its part of the squared gap."""
    size = gap_weights(problem)
    squares = [r.ravel() ** 2 for r in problem.residuals(starts)]
    return [(float(s.sum()), float(size @ s)) for s in squares]


def _of_each_pair(ranked: list[Values], settings: SearchSettings) -> list[Values]:
    """The best start of each pair of effects, the first few of them in which no effect stands too often:
    all that one strong effect goes with would crowd out the others."""
    taken: list[Values] = []
    count: Counter[str] = Counter()
    seen: set[frozenset[str]] = set()
    for start in ranked:
        names = frozenset(k.effect for k in start if k.effect != TUNE)
        if names not in seen and all(count[n] < settings.pairs.each for n in names):
            taken.append(start)
            count.update(names)
        seen.add(names)
    return taken[: settings.pairs.tried]
