"""The probability of each named effect, leaving its rivals aside."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from residual_mpc.diagnosis.phases.validate import Validated
from residual_mpc.diagnosis.remainder.records import Rest
from residual_mpc.diagnosis.results.causes import most_sure
from residual_mpc.diagnosis.results.gaps import ExplanationGaps
from residual_mpc.diagnosis.results.one_encoder import of_one_encoder
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.support import Support, doubts
from residual_mpc.diagnosis.results.variation_records import Variation
from residual_mpc.diagnosis.results.verdict import beats_forecast, clearest, deciding, judged_share
from residual_mpc.diagnosis.search.substitutes import imitate
from residual_mpc.effects.laws import is_law
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Term


@dataclass(frozen=True)
class Certainty:
    """Of each named effect. sure: its probability without a rival and without doubt; weak: a factor on that for its
    support alone; doubt: for all that speaks against it, weak included; varying: how the sizes vary for which the fit
    does not account."""

    sure: Mapping[Term, float]
    weak: Mapping[Term, float]
    doubt: Mapping[Term, float]
    varying: Mapping[Term, Variation]


def certainty_of(validated: Validated, rest: Rest | None) -> Certainty:
    """rest: what is left, None where it is not described yet."""
    of, supports, settings = validated.explanation, validated.supports, validated.options.settings
    # a slow effect hardly shows in the headline's gap: what is left counts where the gap is clearest
    usual = validated.usual
    unexplained = judged_share(clearest(usual.looks)) if validated.gaps.helps else validated.judged.verdict[1]
    beats = beats_forecast(usual.looks[0], usual.constant_velocity)
    judged = validated.verdict if validated.without is None else usual.verdict[0]
    certain = partial(most_sure, judged, unexplained, _times_floor(usual), beats, settings=settings)
    most = settings.causes.coarse if validated.judged.coarse else 1.0
    sure = {t: min(certain(standing=_stands(t, s)), most) for t, s in supports.items()}
    weak = doubts(supports, rest, settings=settings)
    known = {**of.run_sizes, **of.in_parts}  # the fit accounts for these variations, but for none with the motion
    varying = {t: v for t, v in validated.varying.items() if v.by_state or t not in known}
    doubt = {t: d * steadiness(t, varying, settings) for t, d in weak.items()}
    doubt |= {t: settings.parts.sized * doubt[t] for t in of.run_sizes if t in doubt}
    beside = [t for t in doubt if t not in of.in_parts and any(_alike(t, part) for part in of.in_parts)]
    doubt |= {t: settings.causes.resting * doubt[t] for t in beside}
    bent = of_one_encoder(of.final.terms, [n.term for n in of.untestable])
    doubt |= {t: settings.causes.resting * doubt[t] for t in bent if t in doubt}
    return Certainty(sure, weak, doubt, varying)


def steadiness(term: Term, varying: Mapping[Term, Variation], settings: ResultSettings) -> float:
    """A factor on the probability of an effect: less if it varies in a way that speaks for another cause, or if the
    same effect elsewhere turns out to follow another law."""
    own = varying.get(term)
    kin = any(v.by_state for t, v in varying.items() if t.effect == term.effect)
    return settings.support.unsupported if kin or (own is not None and own.doubtful) else 1.0


def _alike(term: Term, part: Term) -> bool:
    """Whether an effect that acts in all runs may be another size, in the rest, of one that acts in a part: it imitates
    that, or both are limits of one stage."""
    one, other = BY_NAME[term.effect], BY_NAME[part.effect]
    limits = all(any(p.threshold for p in e.parameters) for e in (one, other))
    return imitate(term, part) or (limits and one.stage == other.stage)


def _stands(term: Term, support: Support) -> float:
    """How far an effect stands above what is left; a law takes up whatever there is."""
    return 0.0 if is_law(term.effect) else support.standing


def _times_floor(found: ExplanationGaps) -> float:
    """How many times the noise floor is left, at the horizon where that is most."""
    return max(look.times_floor for look in deciding(found.looks))
