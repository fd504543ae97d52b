"""Named effects beside fitted laws: laws that are equivalent to an effect, and effects that a law has replaced."""

from residual_mpc.diagnosis.laws.proposal import Proposal
from residual_mpc.diagnosis.predict.effect_sets import without
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.laws import LawKind, is_law, kind_of
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models import optional
from residual_mpc.models.settings import TUNE, Knob, Term, Values

LEVEL = {"curve": "start", "wave": "offset"}  # the number that shifts the whole law


def named_twin(law: Proposal, space: Space) -> Proposal | None:
    """The effect that is equivalent to a law, if it is a candidate."""
    kind = kind_of(law.term.effect)
    assert kind is not None
    terms = [t for t in space.candidates if _is(t, kind, law.form) and _same_place(t, law.term, space)]
    return beside(terms[0], _smallest(terms[0], space)) if terms else None


def taken_up(values: Values, term: Term, space: Space) -> Values:
    """The values without an effect; a law that contains it (a constant friction, torque or gain) absorbs its size."""
    out = dict(without(values, term))
    for law in dict.fromkeys(k.term for k in out if is_law(k.effect)):
        kind = kind_of(law.effect)
        if kind is None or not _is(term, kind, "constant") or not _same_place(term, law, space):
            continue
        (size,) = (v for k, v in values.items() if k.effect != TUNE and k.term == term)
        level = Knob(law.effect, law.target, LEVEL[kind.shape])
        if kind.of == "strength":
            out = {k: v * size if k.effect != TUNE and k.term == law else v for k, v in out.items()}
            out[level] += size - 1.0
        else:
            out[level] += size
        break
    return out


def _is(term: Term, kind: LawKind, form: str) -> bool:
    """Whether an effect is what a law of this kind and form is."""
    return any(of in BY_NAME[term.effect].laws for of in ((kind.of, None, form), (kind.of, kind.on, form)))


def _same_place(term: Term, law: Term, space: Space) -> bool:
    """Whether an effect acts on just the joints that a law acts on: on all of their actuators, if on actuators."""
    driven = optional.actuator_joints(space.robot)
    joints = dict(zip(space.robot.actuators, driven, strict=True))
    if term.target in joints and BY_NAME[term.effect].target == "actuator" and driven.count(joints[term.target]) > 1:
        return False

    def places(t: Term) -> set[str]:
        slots = space.robot.slots(t.effect) if t.target is None else (t.target,)
        return {joints.get(s, s) for s in slots}

    return places(term) == places(law)


def replaced(before: Values, now: Values) -> list[Proposal]:
    """The effects that an explanation had and has no more, with their earlier numbers."""
    terms = dict.fromkeys(k.term for k in before if k.effect != TUNE)
    gone = [t for t in terms if not any(k.effect != TUNE and k.term == t for k in now)]
    return [beside(t, {k: v for k, v in before.items() if k.effect != TUNE and k.term == t}) for t in gone]


def beside(term: Term, start: Values) -> Proposal:
    """A named effect as a proposal."""
    return Proposal(term, "", {}, start)


def _smallest(term: Term, space: Space) -> Values:
    """The plausible numbers that are closest to no effect."""

    def size(values: Values) -> float:
        return sum(abs(v - space.null(k)) / space.scale(k) for k, v in values.items())

    return min(space.plausible(term), key=size)
