"""A law that may be fitted."""

from collections.abc import Sequence
from dataclasses import dataclass

from residual_mpc.diagnosis.laws.shapes import Shape
from residual_mpc.effects.laws import LawKind
from residual_mpc.models.settings import Knob, Term, Values


@dataclass(frozen=True, eq=False)
class Proposal:
    """A law that may be fitted. fixed: its numbers that say how it acts; start: where the fit of the others begins.
    richer: the same law in shapes of more numbers, which the linear analysis of the remainder did not select."""

    term: Term
    form: str
    fixed: Values
    start: Values
    richer: "tuple[Proposal, ...]" = ()


def proposal(kind: LawKind, target: str | None, shape: Shape, richer: Sequence[Shape] = ()) -> Proposal:
    """The law of this shape; its free numbers begin at nothing."""
    fixed = {Knob(kind.name, target, name): v for name, v in shape.fixed.items()}
    start = {Knob(kind.name, target, n): 0.0 for n in shape.free}
    more = tuple(proposal(kind, target, r) for r in richer)
    return Proposal(Term(kind.name, target), shape.form, fixed, start, more)
