"""Sets of effects, as hypotheses name them."""

from residual_mpc.models.settings import TUNE, Knob, Term, Values

EffectSet = tuple[Term, ...]  # the effects of one hypothesis, each once, in the order in which they were found
ConfoundedGroup = tuple[EffectSet, ...]  # sets that the runs do not tell apart; the one to prefer stands first


def without(values: Values, term: Term) -> dict[Knob, float]:
    """The values less one term's."""
    return {k: v for k, v in values.items() if k.effect == TUNE or k.term != term}
