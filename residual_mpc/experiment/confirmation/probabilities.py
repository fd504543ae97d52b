"""The probabilities of effects after a test on new runs."""

from collections.abc import Mapping

from residual_mpc.diagnosis.predict.effect_sets import EffectSet
from residual_mpc.experiment.confirmation.effect_tests import whole_of
from residual_mpc.experiment.confirmation.records import Confirmation
from residual_mpc.experiment.confirmation.settings import ConfirmationSettings
from residual_mpc.models.settings import Term


def updated(
    listed: Mapping[Term, float], confirmation: Confirmation, settings: ConfirmationSettings
) -> dict[Term, float]:
    """Each effect's probability after the test, given those before it. Explanations that the runs exclude pass most of
    their probability to those that can take their place; the odds of each effect in the kept explanation are then
    updated by Bayes' rule."""
    own, kept = confirmation.explanations[0], confirmation.explanations[confirmation.kept]
    there = whole_of(kept, own)
    out = dict(listed)
    for term in own.terms:
        out |= _in_place_of(term, listed, confirmation, settings)
    causes = settings.results.causes
    told = all(g.as_good for g in confirmation.gaps)
    most = causes.most_sure * (1.0 if told else causes.most_partial)  # something else is at work on the new runs
    rates = {"agrees": settings.agrees, "denies": settings.denies}
    for test in confirmation.effects:
        if test.outcome in rates and test.term in there:
            present, absent = rates[test.outcome]
            p = min(out[test.term], most)
            p = p * present / (p * present + (1.0 - p) * absent)
            out[test.term] = min(p, settings.denied) if test.outcome == "denies" else p
    return {t: min(p, most) if t in there else p for t, p in out.items()}


def _in_place_of(
    term: Term, listed: Mapping[Term, float], confirmation: Confirmation, settings: ConfirmationSettings
) -> dict[Term, float]:
    """The probabilities of an effect of the diagnosed explanation and of those that may stand in its place."""
    own, *others = (e for e in confirmation.explanations if not e.combined)
    kept = confirmation.explanations[confirmation.kept]
    places: list[tuple[EffectSet, bool]] = [((term,), kept is own or term not in kept.instead_of)]
    for other in others:
        if term in other.instead_of:
            places.append((tuple(t for t in other.terms if t not in own.terms), not other.nowhere))
    before = [min((listed.get(t, 0.0) for t in terms), default=0.0) for terms, _ in places]
    total = min(sum(before), settings.results.causes.most_sure)
    after = [p if open_ else settings.excluded * p for p, (_, open_) in zip(before, places, strict=True)]
    left = sum(p for p, (_, open_) in zip(after, places, strict=True) if open_)
    free = total - sum(p for p, (_, open_) in zip(after, places, strict=True) if not open_)
    count = sum(open_ for _, open_ in places)
    out: dict[Term, float] = {}
    for p, (terms, open_) in zip(after, places, strict=True):
        share = p if not open_ else free * p / left if left > 0.0 else free / count
        out |= {t: max(share, out.get(t, 0.0)) for t in terms}
    return out
