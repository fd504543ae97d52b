"""Each effect in words: its name, its stage, a clause for someone who has never heard the name, what supports it."""

from collections.abc import Callable, Mapping
from statistics import median
from typing import Any

from residual_mpc.effects.effect import Effect as KnownEffect
from residual_mpc.effects.library import BY_NAME
from residual_mpc.effects.phrase import Phrase
from residual_mpc.report.words.laws import law_sentence
from residual_mpc.report.words.numbers import listed, measure, number, percent_of_nominal
from residual_mpc.report.words.phrases import OPPOSITES, QUANTITIES

Effect = Mapping[str, Any]  # an entry of diagnosis.json that names an effect

PEOPLE = {"coulomb": "Coulomb", "stribeck": "Stribeck"}
DIVISIONS = {  # of the windows, in each part of which an effect has a size of its own
    "by_run": "from run to run",
    "by_motion": "with the size of the motion",
    "by_influence": "with its influence on the motion",
    "by_position": "with the position of the joint",
}
STATES = {  # what a size may depend on that speaks for another law
    "by_motion": "the motion",
    "by_influence": "the motion",
    "by_position": "the joint's position",
}
TEXTS = {
    "by_motion": "in {} motions",
    "by_influence": "where its influence is {}",
    "by_position": "at {} positions",
}
MANY = 8  # runs, above which not each one's size is listed
SUPPORT = {
    "fits": "fits significantly better",
    "predicts": "predicts held-out runs better",
    "survives": "is found whichever run is left out",
    "experiment": "agrees with a planned experiment",
    "counterfactual": "agrees with a run in which the cause was changed",
}


def name(effect: Effect) -> str:
    """{"effect": "command_delay", ...} as "command delay"."""
    return " ".join(PEOPLE.get(word, word) for word in str(effect["effect"]).split("_"))


def name_at(effect: Effect) -> str:
    """ "viscous friction of elbow"."""
    return name(effect) + (f" of {effect['target']}" if effect.get("target") else "")


def stage(effect: Effect) -> str:
    """The stage of the chain at which the effect sits; empty for an effect that the library does not have."""
    known = BY_NAME.get(effect["effect"])
    return str(effect.get("stage") or (known.stage if known else ""))


def numbers_of(effect: Effect) -> dict[str, Mapping[str, Any]]:
    """The parameters that are one number each; a fitted law also has lists."""
    some = effect.get("parameters") or {}
    return {k: p for k, p in some.items() if isinstance(p.get("value"), int | float)}


def sentence_of(effect: Effect) -> str:
    """One entry of an explanation as a clause without a full stop: "commands take effect 81 ms late".

    An effect from elsewhere, or one without its parameters, is called by its name.
    """
    known = BY_NAME.get(effect["effect"])
    phrase = known.phrase if known else None
    target = effect.get("target") or effect.get("only_target")
    if effect["effect"] == "fitted_law" and "form" in effect:
        return law_sentence(effect)
    if effect["effect"] == "fitted_law":
        return f"a function of {effect.get('on', 'the motion')}, fitted to the runs, corrects {target or 'the robot'}"
    if known is None or phrase is None:
        return f"{name(effect)} acts on {target or 'the robot'}"
    parameters = numbers_of(effect)
    units = [str(p.get("unit", "1")) for p in parameters.values()]
    text = _text_of(known, phrase, parameters)
    values = {"quantity": next((QUANTITIES[u] for u in units if u in QUANTITIES), "output")}
    for key, parameter in parameters.items():
        value = float(parameter["value"])
        if value < 0 and f"{{{key}}}" in text:  # a number that the clause does not name turns no word round
            text, value = _opposite(text, value)
        values[key] = _written(key, phrase.shares)(value, str(parameter.get("unit", "1")))
    where = [
        said.format(value=values[key], per=str(parameters[key].get("unit", "1")).removeprefix("1/").strip("()"))
        for key, said in phrase.optional.items()
        if key in parameters
    ]
    if where:
        text, values["where"] = text + phrase.located, listed(where)
    try:
        return text.format(who=phrase.who(target, known.target), **values)
    except KeyError:
        return f"{name(effect)} acts on {phrase.who(target, known.target)}"


def remarks(effect: Effect, since_start: Callable[[str, float], float]) -> list[str]:
    """What else an entry of an explanation says of itself, a phrase each. since_start: (run, stamp s) as s from the
    run's first stamp."""
    said = [SUPPORT[e] for e in effect.get("evidence") or [] if e in SUPPORT]
    out = [listed(said)] if said else []
    if effect.get("since"):
        run, t = effect["since"]["run"], effect["since"]["t"]
        out.append(f"begins {measure(since_start(run, t), 's')} into {run}")
    if effect.get("until"):
        run, t = effect["until"]["run"], effect["until"]["t"]
        out.append(f"ends {measure(since_start(run, t), 's')} into {run}")
    if any(effect.get(division) for division in DIVISIONS):
        out.append(sizes_words(effect))
    if effect.get("free"):
        out.append(_free(effect))
    return [*out, str(effect["note"])] if effect.get("note") else out


def _free(effect: Effect) -> str:
    """ "restricts nothing in run2", "is rigid in small motions"."""
    does = "is rigid" if "stiffness" in (effect.get("parameters") or {}) else "restricts nothing"
    text = next((text for key, text in TEXTS.items() if effect.get(key)), "in {}")
    return f"{does} {text.format(listed(list(effect['free'])))}"


def sizes_words(effect: Effect) -> str:
    """ "by run: run1 0.93, run2 0.6", of many runs the lowest, the median and the highest; "in small, medium and large
    motions: 0.9, 1 and 1.1"; "where its influence is weak, medium and strong: 0.9, 1 and 1.1"; "at low, middle and high
    positions: 0.9, 1 and 1.1"."""
    for division, text in TEXTS.items():
        named = effect.get(division)
        if named:
            return f"{text.format(listed(list(named)))}: {listed([number(size) for size in named.values()])}"
    sizes = effect["by_run"]
    if len(sizes) > MANY:
        ranked = sorted(sizes.values())
        low, middle, high = (number(x) for x in (ranked[0], median(ranked), ranked[-1]))
        return f"varies over {len(sizes)} runs: {low} to {high}, median {middle}"
    return "by run: " + ", ".join(f"{run} {number(size)}" for run, size in sizes.items())


def variation_clause(effect: Effect) -> str:
    """ ", varying from run to run (0.6 to 1)", ", beginning in run3"; empty for a steady effect."""
    if effect.get("since"):
        return f", beginning in {effect['since']['run']}"
    if effect.get("until"):
        return f", ending in {effect['until']['run']}"
    for division, how in DIVISIONS.items():
        sizes = effect.get(division)
        if sizes and len(sizes) == 1:
            return f", in {next(iter(sizes))} only"
        if sizes:
            unit = next((str(p.get("unit", "1")) for p in numbers_of(effect).values()), "1")
            return f", varying {how} ({measure(min(sizes.values()), unit)} to {measure(max(sizes.values()), unit)})"
    return ""


def _text_of(known: KnownEffect, phrase: Phrase, parameters: Mapping[str, Mapping[str, Any]]) -> str:
    """The text that names the numbers which count: those whose intervals do not contain their null values."""
    units = [str(p.get("unit", "1")) for p in parameters.values()]
    text = next((phrase.by_unit[u] for u in units if u in phrase.by_unit), phrase.text)
    named = [k for k in parameters if f"{{{k}}}" in text]
    there = {k: _is_there(known, k, p) for k, p in parameters.items()}
    if not named or any(there[k] is not False for k in named):
        return text
    return next((other for k, other in phrase.instead.items() if there.get(k)), text)


def _is_there(known: KnownEffect, key: str, parameter: Mapping[str, Any]) -> bool | None:
    """Whether a number's interval excludes its null value; None where that is not known."""
    low, high = parameter.get("ci95") or (None, None)
    null = next((p.null for p in known.parameters if p.name == key), None)
    return None if null is None or low is None or high is None else not low <= null <= high


def _written(key: str, shares: tuple[str, ...]) -> Callable[[float, str], str]:
    return (lambda value, unit: percent_of_nominal(value)) if key in shares else measure


def _opposite(text: str, value: float) -> tuple[str, float]:
    for word, opposite in OPPOSITES.items():
        if word in text:
            return text.replace(word, opposite), -value
    return text, value
