"""Sets of effects, as hypotheses name them."""

from residual_mpc.models.settings import Term

EffectSet = tuple[Term, ...]  # the effects of one hypothesis, each once, in the order in which they were found
ConfoundedGroup = tuple[EffectSet, ...]  # sets that the runs do not tell apart; the one to prefer stands first
