"""Named effects beside fitted laws: a law that is so simple that it has a name, and effects that a law has replaced."""

from collections.abc import Mapping

from residual_mpc.diagnosis.laws.propose import Proposal
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.laws import KIND_OF, LawKind, is_law
from residual_mpc.models import optional
from residual_mpc.models.settings import TUNE, Knob, Term, Values

# What a law of this sort and form is called; the quantity is None where it does not matter. A constant share of the
# load has no name here: a gain changes the load itself, and with it what the other law beside it is of.
NAMES: Mapping[tuple[str, str | None, str], str] = {
    ("strength", "time", "constant"): "actuator_gain",
    ("friction", None, "constant"): "coulomb_friction",
    ("torque", None, "constant"): "torque_offset",
    ("torque", "position", "line"): "joint_spring",
    ("torque", "speed", "line"): "viscous_friction",
}
LEVEL = {"curve": "start", "wave": "offset"}  # a law's number that adds the same everywhere


def with_a_name(law: Proposal, space: Space) -> Proposal:
    """The effect that is this law; the law itself if it has no name, or its name is no candidate."""
    kind = KIND_OF[law.term.effect]
    name = _name(kind, law.form)
    for term in space.candidates:
        if term.effect == name and _same_place(term, law.term, space):
            return beside(term, _smallest(term, space))
    return law


def taken_up(values: Values, term: Term, space: Space) -> Values:
    """The values without an effect, which a law takes up if it contains it: a constant friction, torque or gain."""
    out = dict(without(values, term))
    for law in dict.fromkeys(k.term for k in out if is_law(k.effect)):
        kind = KIND_OF[law.effect]
        if term.effect != _name(kind, "constant") or not _same_place(term, law, space):
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


def without(values: Values, term: Term) -> Values:
    """The values without those of a term."""
    return {k: v for k, v in values.items() if k.effect == TUNE or k.term != term}


def _name(kind: LawKind, form: str) -> str | None:
    return NAMES.get((kind.of, None, form)) or NAMES.get((kind.of, kind.on, form))


def _same_place(term: Term, law: Term, space: Space) -> bool:
    """Whether an effect acts on just the joint that a law acts on, or a law on all."""
    joints = dict(zip(space.robot.actuators, optional.actuator_joints(space.robot), strict=True))
    slots = space.slots[term.effect] if term.target is None else (term.target,)
    return law.target is None or {joints.get(s, s) for s in slots} == {law.target}


def replaced(before: Values, now: Values) -> list[Proposal]:
    """The effects that an explanation had and has no more, with their numbers of then."""
    terms = dict.fromkeys(k.term for k in before if k.effect != TUNE)
    gone = [t for t in terms if not any(k.effect != TUNE and k.term == t for k in now)]
    return [beside(t, {k: v for k, v in before.items() if k.effect != TUNE and k.term == t}) for t in gone]


def beside(term: Term, start: Values) -> Proposal:
    """A named effect as a proposal."""
    return Proposal(term, "", {}, start)


def _smallest(term: Term, space: Space) -> Values:
    """The plausible numbers that are nearest to none."""

    def size(values: Values) -> float:
        return sum(abs(v - space.null(k)) / space.scale(k) for k, v in values.items())

    return min(space.plausible(term), key=size)
