"""Which candidates do nearly the same at the same place: a delay and a lag, one law of friction and another."""

from residual_mpc.effects.equivalents import are_substitutes
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Term


def imitate(one: Term, other: Term) -> bool:
    """Whether two effects do nearly the same at the same place. What acts on the whole robot, such as a mass at its
    tool, has no target to compare."""
    kinds = {BY_NAME[t.effect].target for t in (one, other)}
    here = one.target == other.target or ("robot" in kinds and len(kinds) == 2)
    return here and are_substitutes(one.effect, other.effect)
