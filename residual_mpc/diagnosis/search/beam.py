"""The sets that a search goes on with: what stands first among those of a step, and the runners-up."""

import numpy as np

from residual_mpc.diagnosis.fit.evidence import dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.predict.effect_sets import without
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.search.acceptance import Ruler
from residual_mpc.diagnosis.search.additions import distinct
from residual_mpc.diagnosis.search.optional_numbers import Makeup, makeup
from residual_mpc.diagnosis.search.settings import SearchSettings


def trimmed(
    problem: Problem, children: list[Fit], blocks: np.ndarray, seen: set[Makeup], settings: SearchSettings
) -> list[Fit]:
    """Cheapest first; of the first few that the data do not tell apart, sets that grew from different ones of the beam,
    without a term that the others have made needless. seen: sets that the search has been at."""
    tuned = settings.steps
    if len(children) < 2:
        return children
    phi = dispersion(children[0], blocks)
    near = [c for c in children[: tuned.trimmed] if len(c.terms) > 1 and c.cost <= children[0].cost + tuned.alike * phi]
    if len(near) < 2:
        return children
    pairs = [(c, t) for c in near for t in c.terms if makeup(without(c.values, t)) not in seen]
    fewer = fit_all(
        problem,
        [without(c.values, t) for c, t in pairs],
        settings.additions.rough,
        rough=True,
        near=[c for c, _ in pairs],
        settings=settings.fit,
    )
    best: dict[int, Fit] = {}
    for (child, _), fit in zip(pairs, fewer, strict=True):
        if fit.cost <= child.cost + tuned.needed * phi and (id(child) not in best or fit.cost < best[id(child)].cost):
            best[id(child)] = fit
    return distinct([best.get(id(c), c) for c in children])


def leaving_far_less(ruler: Ruler, children: list[Fit], chosen: Fit, settings: SearchSettings) -> list[Fit]:
    """The sets that leave a far smaller gap than the chosen one, the smallest first. Small differences elsewhere may
    take up what tells two sets apart, so that their likelihoods are alike."""
    rest = [c for c in children if makeup(c.values) != makeup(chosen.values)]
    *gaps, own = ruler.squared([*rest, chosen])
    far = settings.rivals.far_smaller * own
    found = sorted(((g, i) for i, g in enumerate(gaps) if g < far), key=lambda pair: pair[0])
    return [rest[i] for _, i in found]


def others(ruler: Ruler, base: Fit, best: Fit, children: list[Fit], settings: SearchSettings) -> list[Fit]:
    """Runners-up that the next step may start from as well: none where the best leaves little to explain, since a
    greedy step goes wrong only while several causes still mix."""
    first, now = ruler.squared([base, best])
    if now - ruler.floor < settings.settled * (first - ruler.floor):
        return []
    return [c for c in children if frozenset(c.terms) != frozenset(best.terms)][: settings.beam - 1]
