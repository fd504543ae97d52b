"""Two effects that help only together.

A servo that is too weak sags unless friction holds the joint, for example: neither of the two is worth adding alone.
Effects of sensors are left out to save time: they mostly add to what the robot does.
"""

from collections import Counter
from itertools import combinations, product

import numpy as np

from residual_mpc.diagnosis.fit.evidence import dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, Race, fit_all
from residual_mpc.diagnosis.fit.start_values import possible
from residual_mpc.diagnosis.predict.problem import Problem, part_of
from residual_mpc.diagnosis.search.additions import closer, distinct, mixed
from residual_mpc.diagnosis.search.screen import drawn, gap_weights, smaller
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import TUNE, Values

ROWS = 96  # hypotheses replayed at once: bounds the memory


def pairs(problem: Problem, alone: Fit, blocks: np.ndarray, settings: SearchSettings) -> list[Fit]:
    """The best sets of two effects, each on all targets alike or on the only motorised joint, cheapest first; alone:
    the model without effects.

    A few probes of each effect with those of each other one are replayed on a quarter of the screening's windows, and
    all probes of the best pairs.
    """
    small, weight = smaller(problem, alone, settings=settings)
    cost = np.einsum("wn,wn->w", r := small.residuals([alone.values])[0], r)
    quarter = drawn(cost, max(settings.screen.fewest_quick, small.data.count // 4), power=1.0)
    quick = part_of(small, quarter > 0, quarter[quarter > 0])
    tuned = settings.pairs
    driven = _only_driven(problem.space.robot)
    probes = {
        t: list({frozenset(p.items()): p for p in problem.space.probes(t)}.values())  # a bound may make two of them one
        for t in problem.space.candidates
        if t.target in (None, driven) and BY_NAME[t.effect].stage != "sensor"
    }
    couples = [(a, b) for a, b in combinations(probes, 2) if problem.space.may_join(b, (a,))]
    starts = [s for c in couples for s in _combined(alone.values, *(_spread(probes[t], tuned.sketched) for t in c))]
    if not starts:
        return []
    scores = _all_scores(quick, starts)
    best = list(dict.fromkeys(frozenset(_effects(s)) for s in _ranked(starts, scores)))[: tuned.closely]
    known = {frozenset(s.items()) for s in starts}
    for a, b in couples:
        if frozenset({a.effect, b.effect}) in best:
            more = [s for s in _combined(alone.values, probes[a], probes[b]) if frozenset(s.items()) not in known]
            starts, scores = starts + more, scores + _all_scores(quick, more)
    ranked = _ranked(starts, scores)
    begun = fit_all(
        small, _of_each_pair(ranked, settings=settings), settings.additions.rough, rough=True, settings=settings.fit
    )
    margin = settings.additions.hopeless * dispersion(alone, blocks)
    fits = closer(problem, small, distinct(begun), Race(margin / weight), Race(margin), settings=settings)
    return sorted((f for f in fits if possible(f.values)), key=lambda f: f.cost)


def _only_driven(robot: Robot) -> str | None:
    """The only motorised joint of a robot that also has passive joints; None elsewhere."""
    driven = set(optional.actuator_joints(robot))
    return driven.pop() if len(driven) == 1 and len(optional.joints(robot)) > 1 else None


def _spread(probes: list[Values], most: int) -> list[Values]:
    """At most so many of the probes, the first and the last among them."""
    picked = np.unique(np.linspace(0, len(probes) - 1, min(most, len(probes))).round().astype(int))
    return [probes[i] for i in picked]


def _combined(alone: Values, one: list[Values], other: list[Values]) -> list[Values]:
    """Each probe of one effect with each of another."""
    return [{**alone, **p, **q} for p, q in product(one, other)]


def _effects(start: Values) -> list[str]:
    """The effects of a hypothesis."""
    return [k.effect for k in start if k.effect != TUNE]


def _ranked(starts: list[Values], scores: list[tuple[float, float]]) -> list[Values]:
    """The hypotheses, the best first by each score in turn."""
    rankings = [[starts[i] for i in np.argsort(column, kind="stable")] for column in np.array(scores).T]
    return mixed(*rankings)


def _all_scores(problem: Problem, starts: list[Values]) -> list[tuple[float, float]]:
    return [s for k in range(0, len(starts), ROWS) for s in _scores(problem, starts[k : k + ROWS])]


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
        names = frozenset(_effects(start))
        if names not in seen and all(count[n] < settings.pairs.each for n in names):
            taken.append(start)
            count.update(names)
        seen.add(names)
    return taken[: settings.pairs.tried]
