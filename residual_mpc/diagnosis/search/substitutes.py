"""Which candidates do nearly the same at the same place: a delay and a lag, one law of friction and another."""

from collections.abc import Collection, Mapping

from residual_mpc.effects.equivalents import are_substitutes
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Term


def imitate(one: Term, other: Term) -> bool:
    """Whether two effects do nearly the same at the same place. What acts on the whole robot, such as a mass at its
    tool, has no target to compare."""
    kinds = {BY_NAME[t.effect].target for t in (one, other)}
    here = _joint(one) == _joint(other) or ("robot" in kinds and len(kinds) == 2)
    return here and are_substitutes(one.effect, other.effect)


def _joint(term: Term) -> str | None:
    """The target of a term; for an encoder, its joint."""
    return None if term.target is None else term.target.removeprefix("position.")


def counting_what_includes(weights: Mapping[Term, float], alike: Collection[Term]) -> dict[Term, float]:
    """The weights, with that of each effect that includes another one added to that one where the runs do not tell the
    two apart: what acts on all targets acts on each of them, and an effect whose numbers may be equal is then its
    simple case."""
    out = dict(weights)
    for t in weights:
        if t not in alike:
            continue
        if t.target is not None:
            out[t] += weights.get(t._replace(target=None), 0.0)
        out[t] += sum(weights.get(other, 0.0) for other in alike if _simple_case(other) == t)
    return out


def _simple_case(term: Term) -> Term | None:
    """What a term is where two of its numbers are equal, such as dry friction for Stribeck friction."""
    equal = BY_NAME[term.effect].equal
    return None if equal is None else term._replace(effect=equal[0])
