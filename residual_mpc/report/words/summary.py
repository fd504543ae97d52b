"""The whole diagnosis in one sentence that anyone understands."""

from collections.abc import Mapping, Sequence
from typing import Any

from residual_mpc.diagnosis.results.intervals import AT_BOUND
from residual_mpc.report.words.effects import STATES, name, name_at, numbers_of, sentence_of, variation_clause
from residual_mpc.report.words.gaps import at_horizon, hardest, ratio, shorter, size
from residual_mpc.report.words.groups import or_else
from residual_mpc.report.words.numbers import listed, number, percent
from residual_mpc.report.words.servo import short_reading

NAMED = 3  # causes named in the sentence; the rest are counted
SURE = 0.5  # probability below which an effect is a possibility
FAINT = 0.1  # probability below which an effect is only counted, unless there is none above
AS_GOOD = 2.0  # times the noise floor up to which a model is as good as these sensors can tell
SLOW = 0.4  # shrink at the headline's horizon below which a longer one is quoted as well
WORTH_SAYING = 0.05  # a learned residual that removes less than this is not worth the sentence

# Effects of which one says "adding this delay" rather than "modelling this".
ADDED = ("delay", "lag", "friction", "payload", "bias", "armature", "slope")


def sentence(document: Mapping[str, Any]) -> str:
    """The verdict of diagnosis.json in one sentence. Raises KeyError for a verdict that there is not."""
    document = _of_new_readings(document)
    say = {"no_gap": _no_gap, "effects": _effects, "partial": _partial, "unknown": _unknown}
    return say[document["verdict"]](document)


def surest_first(effects: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """An explanation by falling probability; one without a probability counts as sure."""
    return sorted(effects, key=lambda effect: -_probability(effect))


def in_sentence(effects: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The effects of an explanation that the sentence names, the surest first; it counts the others."""
    effects = surest_first(effects)
    likely = [effect for effect in effects if _probability(effect) >= FAINT] or effects
    return likely if len(likely) <= NAMED + 1 else likely[:NAMED]  # "1 more" is no shorter than the effect


def unseen(held_out: Sequence[Any]) -> str:
    """What the figures were measured on: whole runs, or parts of runs, that were held out."""
    if not held_out:
        return "the runs used in the fit"
    return "held-out runs" if all(isinstance(part, str) for part in held_out) else "held-out parts of the runs"


def _of_new_readings(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """With the figures of a slow sensor's new readings, which the verdict is about, where one is slow."""
    new = document["gap"].get("new_readings")
    if not new:
        return document
    value = 1.0 - new["after"] / max(new["before"], 1e-12)
    return {**document, "gap": {**document["gap"], **new}, "shrink": {"value": value} if document["shrink"] else None}


def _no_gap(document: Mapping[str, Any]) -> str:
    if document["gap"].get("own_step"):
        return (
            "The gap is the error of the model's own time step: with a smaller one, the model predicts this robot to "
            "within the sensor noise."
        )
    return "The model predicts this robot to within the sensor noise: there is no gap to explain."


def _effects(document: Mapping[str, Any]) -> str:
    return f"{_causes(document)}; {_adding(document)} {_achieved(document)}."


def _partial(document: Mapping[str, Any]) -> str:
    gap = document["gap"]
    worst = hardest(gap, "after")
    times = ratio(worst, "after")
    other_law = _varying_with_the_state(document)
    if times is not None and times <= AS_GOOD and other_law:
        return f"{_causes(document)}; {_adding(document)} {_achieved(document)}, but {other_law}."
    left = "part of the gap" if times is None else f"{number(times, 2)} times the noise floor"
    where = at_horizon(worst, gap["horizon"])
    return f"{_causes(document)}; {_adding(document)} {_achieved(document)} and leaves {left} unexplained{where}."


def _varying_with_the_state(document: Mapping[str, Any]) -> str:
    """ "the size of the sensor scale of j4 depends on the joint's position, so the true cause follows another law"."""
    varying = [(e, on) for e in document["explanation"] for key, on in STATES.items() if e.get(key)]
    if not varying:
        return ""
    names, states = [name_at(e) for e, _ in varying], {on for _, on in varying}
    what = states.pop() if len(states) == 1 else "the state of the robot"
    sizes, depend = ("size", "depends") if len(varying) == 1 else ("sizes", "depend")
    return f"the {sizes} of the {listed(names)} {depend} on {what}, so the true cause follows another law"


def _unknown(document: Mapping[str, Any]) -> str:
    gap = document["gap"]
    if gap.get("blinded"):
        missed = f"miss {number(gap['noise_floor'], 2)} times the motion"
        return (
            f"These runs cannot test the model over {number(gap['horizon'], 2)} s: the sensor noise alone makes the "
            f"prediction of a perfect model {missed}. Shorten the horizon ({shorter(gap)}), or record calmer motions."
        )
    worst = hardest(gap, "before")
    times = ratio(worst, "before")
    noise = "more than the sensor noise" if times is None else f"{number(times, 2)} times the noise floor"
    learned = (document.get("unexplained") or {}).get("learned_residual_shrink") or 0.0
    hope = f"; a learned residual removes {percent(learned)} of it" if learned >= WORTH_SAYING else ""
    missed = f"Over {number(worst['horizon'], 2)} s the model {size(worst['before'])}, {noise}"
    return f"{missed}, and no effect in the library explains a significant part of it{hope}."


def _causes(document: Mapping[str, Any]) -> str:
    """The surest causes first; those below an even chance after the word "possibly"."""
    effects = surest_first(document["explanation"])
    said = in_sentence(effects)
    clauses = {id(effect): _clause(effect, or_else(effect, document)) for effect in said}
    sure = [clauses[id(effect)] for effect in said if _probability(effect) >= SURE]
    maybe = [f"possibly {clauses[id(effect)]}" for effect in said if _probability(effect) < SURE]
    hidden = effects[len(said) :]
    if hidden:
        doubted = "possibly " if all(_probability(effect) < SURE for effect in hidden) else ""
        more = "1 more effect contributes" if len(hidden) == 1 else f"{len(hidden)} more effects contribute"
        (maybe if maybe else sure).append(f"{doubted}{more}")
    text = listed([*sure, *maybe])
    return text[:1].upper() + text[1:]


def _clause(effect: Mapping[str, Any], alternative: str) -> str:
    """With what it would be on a motor whose constants are known, whether a number was kept from going further, and
    what may be there instead."""
    bound = AT_BOUND if any(p.get("note") == AT_BOUND for p in numbers_of(effect).values()) else ""
    notes = [note for note in (short_reading(effect.get("motor") or []), bound, alternative) if note]
    said = f"{sentence_of(effect)}{variation_clause(effect)}"
    return f"{said} ({', '.join(notes)})" if notes else said


def _adding(document: Mapping[str, Any]) -> str:
    effects = document["explanation"]
    if len(effects) > 1:
        return "adding these effects to the model"
    last = name(effects[0]).split()[-1]
    return f"adding this {last} to the model" if last in ADDED else "modelling this"


def _achieved(document: Mapping[str, Any]) -> str:
    shrink, where = (document.get("shrink") or {}).get("value"), unseen(document["held_out"])
    longer = _over_longer(document, shrink or 0.0)
    if shrink is None or shrink <= 0.0:
        return f"does not reduce the gap on {where}{longer}"
    what = "the gap of the new readings" if document["gap"].get("new_readings") else "the gap"
    return f"removes {percent(shrink)} of {what} on {where}{longer}"


def _over_longer(document: Mapping[str, Any], shrink: float) -> str:
    """What a longer horizon shows of a slow effect that hardly reduces the headline's gap; empty for others."""
    horizons = document["gap"].get("horizons", [])[1:]
    if not horizons:
        return ""
    best = max(horizons, key=lambda h: 1.0 - h["after"] / max(h["before"], 1e-12))
    removed = 1.0 - best["after"] / max(best["before"], 1e-12)
    slow = shrink < SLOW and removed > 2.0 * max(shrink, 0.0) and removed > SLOW
    return f" over {document['gap']['horizon']:g} s, and {percent(removed)} over {best['horizon']:g} s" if slow else ""


def _probability(effect: Mapping[str, Any]) -> float:
    probability = effect.get("probability")
    return 1.0 if probability is None else float(probability)
