"""Which candidates do nearly the same at the same place: a delay and a lag, one law of friction and another."""

from collections.abc import Collection, Mapping

from residual_mpc.effects.equivalents import are_substitutes
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Term


def imitate(one: Term, other: Term) -> bool:
    """Whether two effects do nearly the same at the same place. What acts on the whole robot, such as a mass at its
    tool, has no target to compare."""
    kinds = {BY_NAME[t.effect].target for t in (one, other)}
    here = one.target == other.target or ("robot" in kinds and len(kinds) == 2)
    return here and are_substitutes(one.effect, other.effect)


def counting_all(weights: Mapping[Term, float], alike: Collection[Term]) -> dict[Term, float]:
    """The weights, with that of an effect on every target added to the same effect on one where the runs do not tell
    the two apart: what acts on all acts on the one as well."""
    on_one = {t for t in alike if t.target is not None}
    return {t: w + (weights.get(t._replace(target=None), 0.0) if t in on_one else 0.0) for t, w in weights.items()}
