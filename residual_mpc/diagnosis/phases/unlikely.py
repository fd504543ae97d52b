"""Drops effects that are more likely absent than present if the explanation does about as well without them.

An effect may fit better beyond doubt and still be no cause: it compensates for an error in another effect's law, rests
on one run, or may do nothing by its own interval. Where several of these doubts apply, naming it misleads.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.options import Progress
from residual_mpc.diagnosis.phases.certainty import certainty_of
from residual_mpc.diagnosis.phases.refine import Refined, refined_without
from residual_mpc.diagnosis.phases.validate import Validated, validate
from residual_mpc.diagnosis.predict.noise_floor import AS_GOOD
from residual_mpc.diagnosis.results.causes import doubts_by_numbers
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.verdict import HorizonGaps, deciding
from residual_mpc.models.settings import Term


def without_unlikely(
    refined: Refined, validated: Validated, rng: np.random.Generator, progress: Progress
) -> tuple[Refined, Validated]:
    """The explanation less the effects that are unlikely, all at once or else the least likely one, as long as the
    verdict stays and the gap hardly rises. The held-out windows choose between the sets, so that nothing is left out
    without any."""
    while refined.explanation.held.any():
        unlikely = _unlikely(validated)
        for gone in _tried(unlikely):
            progress("leaving out unlikely effects", 0.67)
            less = refined_without(refined, tuple(gone), rng.spawn(1)[0])
            left_out = {**refined.explanation.unlikely, **gone}
            less = replace(less, explanation=replace(less.explanation, unlikely=left_out))
            now = validate(less, rng.spawn(1)[0], progress)
            if _as_good(validated, now, validated.options.settings):
                refined, validated = less, now
                break
        else:
            break
    return refined, validated


def _tried(unlikely: Mapping[Term, float]) -> list[Mapping[Term, float]]:
    """What is left out in turn: all of them, then the least likely one alone."""
    if len(unlikely) < 2:
        return [unlikely] if unlikely else []
    least = min(unlikely, key=lambda t: unlikely[t])
    return [unlikely, {least: unlikely[least]}]


def _unlikely(validated: Validated) -> dict[Term, float]:
    """The effects that are unlikely, each with its probability before it is shared among rivals, except in groups too
    large to say anything. Effects in a part of the runs are exempt: they were compared with effects that always act."""
    of, settings = validated.explanation, validated.options.settings
    if not validated.gaps.helps:
        return {}
    found = certainty_of(validated, None)
    by_number = doubts_by_numbers(of, validated.judged.verdict[1], found.varying, settings=settings)
    vague = {t for g in of.rivalry.groups if len(g) > settings.causes.telling for m in g for t in m}
    out = {}
    for term, factor in by_number.items():
        p = found.sure[term] * found.doubt[term] * factor
        share = of.rivalry.shares.get(term, 1.0) if term in vague else 1.0
        if p * share < settings.causes.unlikely and term not in of.run_sizes and term not in of.in_parts:
            out[term] = p
    return out


def _as_good(was: Validated, now: Validated, settings: ResultSettings) -> bool:
    """Whether an explanation does as well with fewer effects: its verdict is the same, and the gap over each horizon
    hardly rises."""
    if now.verdict != was.verdict or not now.gaps.helps:
        return False
    before, after = ({x.horizon: x for x in deciding(v.judged.looks)} for v in (was, now))
    return before.keys() == after.keys() and all(_hardly_rises(x, after[h], settings) for h, x in before.items())


def _hardly_rises(was: HorizonGaps, now: HorizonGaps, settings: ResultSettings) -> bool:
    """Whether the squared gap over one horizon rises by a small share of its initial excess over the floor (of the
    squared floor, if that is more), and the gap by a small share of itself or to what counts as nothing. Without a
    memory in the explanation, the first windows of a run with an unknown past count as well."""
    same, tuned = was.unjudged == now.unjudged, settings.causes
    left, more = (x.steady.total if same else x.after.total for x in (was, now))
    excess = max(was.before.total**2 - was.floor.total**2, was.floor.total**2)
    enough = max(tuned.rises * left, tuned.nothing * AS_GOOD * was.floor.total)
    return more**2 - left**2 <= tuned.little * excess and more <= enough
