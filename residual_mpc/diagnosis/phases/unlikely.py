"""Effects that are likelier absent than present leave the explanation where it does as well without them.

An effect may fit better beyond doubt and still be no cause: it makes up for what the law of another one lacks, rests on
one run, or may do nothing by its own interval. Where several of these doubts meet, naming it misleads.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.options import Progress
from residual_mpc.diagnosis.phases.certainty import certainty_of
from residual_mpc.diagnosis.phases.refine import Refined, refined_without
from residual_mpc.diagnosis.phases.validate import Validated, validate
from residual_mpc.diagnosis.results.causes import doubts_by_numbers
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.verdict import deciding
from residual_mpc.models.settings import Term

TELLING = 3  # members of the largest group that still says what is there


def without_unlikely(
    refined: Refined, validated: Validated, rng: np.random.Generator, progress: Progress
) -> tuple[Refined, Validated]:
    """The explanation less the effects that are unlikely, all at once or the least likely alone, as long as the verdict
    stays and the gap hardly rises."""
    while True:
        unlikely = _unlikely(validated)
        for gone in _fewer(unlikely):
            progress("leaving out unlikely effects", 0.7)
            less = refined_without(refined, tuple(gone), rng.spawn(1)[0])
            left_out = {**refined.explanation.unlikely, **gone}
            less = replace(less, explanation=replace(less.explanation, unlikely=left_out))
            now = validate(less, rng.spawn(1)[0], progress)
            if _as_good(validated, now, validated.options.settings):
                refined, validated = less, now
                break
        else:
            return refined, validated


def _fewer(unlikely: Mapping[Term, float]) -> list[Mapping[Term, float]]:
    """What is tried: without all of them, and without the least likely one."""
    if not unlikely:
        return []
    least = min(unlikely, key=lambda t: unlikely[t])
    return [unlikely, {least: unlikely[least]}][: len(unlikely)]


def _unlikely(validated: Validated) -> dict[Term, float]:
    """The effects that are unlikely, each with its probability: whatever else might stand in their place, unless that
    is so much that the place says nothing. What acts in a part of the runs has been compared with doing so always."""
    of, settings = validated.explanation, validated.options.settings
    if not validated.gaps.helps:
        return {}
    found = certainty_of(validated, None)
    by_number = doubts_by_numbers(of, validated.judged.verdict[1], found.varying, settings=settings)
    vague = {t for g in of.rivalry.groups if len(g) > TELLING for m in g for t in m}
    out = {}
    for term, factor in by_number.items():
        share = of.rivalry.shares.get(term, 1.0) if term in vague else 1.0
        p = found.sure[term] * found.doubt[term] * factor * share
        if p < settings.causes.unlikely and term not in of.run_sizes and term not in of.in_parts:
            out[term] = p
    return out


def _as_good(before: Validated, now: Validated, settings: ResultSettings) -> bool:
    """Whether an explanation does as well with fewer effects: its verdict is the same, and over each horizon the
    squared gap rises by a small share of what it was before any effect."""
    if now.verdict != before.verdict or not now.gaps.helps:
        return False
    looks = zip(deciding(before.judged.looks), deciding(now.judged.looks), strict=False)
    return all(
        b.steady.total**2 - a.steady.total**2 <= settings.causes.little * max(a.before.total**2 - a.floor.total**2, 0.0)
        for a, b in looks
    )
