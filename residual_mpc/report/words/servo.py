"""A servo in words: what an effect would be on its motor, and what its owner can change."""

from collections.abc import Mapping, Sequence, Set
from typing import Any

from residual_mpc.effects.phrase import called
from residual_mpc.effects.servo.changes import advice_on
from residual_mpc.effects.servo.numbers import BY_NAME
from residual_mpc.report.words.confidence import UNCERTAIN
from residual_mpc.report.words.numbers import ARROW, listed, measure, measure_interval, number, percent

Reading = Mapping[str, Any]  # an entry of "motor" of an effect in diagnosis.json
CHANGED = ("corrected", "retuned")
STATED = 0.5  # probability from which a number is stated without "possibly"
TAKEN = 0.05  # share by which the model's stiffness has to differ from the constants' to be worth a word


def reading_clause(reading: Reading) -> str:
    """One equivalent as a clause without a full stop: "as if the supply were 6.1 V (5.9 to 6.3) rather than 7.4 V"."""
    return CLAUSES[reading["quantity"]](reading)


def readings_sentence(readings: Sequence[Reading]) -> str:
    """All equivalents of an effect: those that could each be the reason, then what the servo acts like."""
    groups: dict[tuple[str, ...], list[Reading]] = {}
    for reading in readings:
        groups.setdefault(tuple(reading["actuators"]), []).append(reading)
    said = []
    for actuators, group in groups.items():
        causes = [r for r in group if r["quantity"] in CAUSES]
        others = [r for r in group if r["quantity"] not in CAUSES]
        where = "" if len(groups) == 1 else f"{listed(actuators)}: "
        joint = " and " if any(r["jointly"] for r in causes) else "; or "
        clauses = [joint.join(reading_clause(r) for r in causes)] if causes else []
        clauses += [reading_clause(r) for r in others]
        said.append(where + "; ".join(clauses))
    text = ". ".join(clause[:1].upper() + clause[1:] for clause in said)
    return f"{text}." if text else ""


def motor_lines(entry: Mapping[str, Any]) -> list[str]:
    """The sentence on an effect or a change without its full stop; nothing where its motor is not known."""
    text = readings_sentence(entry.get("motor") or [])
    return [text.removesuffix(".")] if text else []


def short_reading(readings: Sequence[Reading]) -> str:
    """The first equivalent, for a headline; empty where the actuators differ in it."""
    causes = [r for r in readings if r["quantity"] in CAUSES]
    said = causes or [r for r in readings if r["quantity"] == "stiffness"]
    if not said or len({tuple(r["actuators"]) for r in readings}) > 1:
        return ""
    clauses = [reading_clause({**r, "ci95": None}) for r in said]
    if all(r["jointly"] for r in said):
        return " and ".join(clauses)
    return clauses[0] + (", for example" if len(causes) > 1 else "")


def changes(document: Mapping[str, Any], registers: Mapping[str, Mapping[str, str]]) -> list[dict[str, Any]]:
    """What an owner can change about the effects that are named, where a servo or a motor is concerned.

    registers: by actuator, what its manufacturer calls its settings. Actuators for which the same holds share an entry.
    """
    out: dict[tuple[str, ...], dict[str, Any]] = {}
    servos = [s for s in document.get("servos") or [] if s["kind"] == "position" or s["motor"]]
    for effect in document["explanation"]:
        numbers = {k: p["value"] for k, p in (effect.get("parameters") or {}).items() if p["value"] is not None}
        for servo in servos:
            if not _concerns(effect, servo, document["explanation"]):
                continue
            stiffness = next((v["nominal"] for v in servo["values"] if v["name"] == "stiffness"), 0.0)
            p_gain = (servo["motor"] or {}).get("p_gain")
            for advice in advice_on(effect["effect"], numbers, stiffness, p_gain):
                written = {k: _in_text(k, v, _unit(effect, k)) for k, v in numbers.items()}
                written |= {k: _in_text(k, *v) for k, v in advice.numbers.items()}
                register = registers.get(servo["actuator"], {}).get(advice.register, "")
                key = (advice.setting, register, advice.text.format(**written))
                entry = out.setdefault(key, {
                    "setting": advice.setting, "register": register or None, "actuators": [],
                    "effect": effect["effect"], "probability": effect.get("probability"), "sentence": key[2],
                })  # fmt: skip
                entry["actuators"].append(servo["actuator"])
    return list(out.values())


def value_text(value: Mapping[str, Any], unit: str | None = None) -> str:
    """A number of a servo with its interval; "none" for a limit that is not there. unit: in place of its own, "1" where
    it stands elsewhere."""
    if value["value"] is None:
        return "none"
    return measure_interval(value["value"], value["ci95"], unit or value["unit"])


def nominal_text(value: Mapping[str, Any], unit: str | None = None) -> str:
    """The model's own value of it."""
    return "none" if value["nominal"] is None else measure(value["nominal"], unit or value["unit"])


def is_changed(value: Mapping[str, Any], servo: Mapping[str, Any]) -> bool:
    """Whether a number of a servo differs from the model's, and says more than the others."""
    other = BY_NAME[value["name"]].same_as
    same = any(v["name"] == other and v["value"] == value["value"] for v in servo["values"])
    return value["status"] in CHANGED and not same


def noun_of(document: Mapping[str, Any]) -> str:
    """What the robot's drives are together: servos, motors where all take torques, else actuators."""
    torques = {servo.get("kind") == "torque" for servo in document.get("servos") or []}
    return "actuator" if len(torques) > 1 else "motor" if True in torques else "servo"


def servo_lines(document: Mapping[str, Any], uncertain: Set[str] = frozenset()) -> list[str]:
    """A line a servo for a terminal: the numbers that the diagnosis changes, each beside the model's. What is the same
    for all of several is said once. uncertain: effects whose numbers are left out."""
    said = {
        servo["actuator"]: [
            f"{_hedge(v)}{BY_NAME[v['name']].text} {nominal_text(v)} {ARROW} {value_text(v)}"
            for v in servo["values"]
            if is_changed(v, servo) and not _is_uncertain(v, uncertain)
        ]
        for servo in document.get("servos") or []
    }
    several = len(said) > 1
    shared = [text for text in next(iter(said.values()), []) if several and all(text in own for own in said.values())]
    noun = noun_of(document)
    lines = [f"all {noun}s alike: {', '.join(shared)}"] if shared else []
    for actuator, own in said.items():
        rest = [text for text in own if text not in shared]
        lines += [f"{called(noun, actuator)}: {', '.join(rest)}"] if rest else []
    return lines


def _hedge(value: Mapping[str, Any]) -> str:
    """ "possibly " before a number whose effects are less likely than not."""
    probability = value.get("probability")
    return "possibly " if probability is not None and probability < STATED else ""


def _is_uncertain(value: Mapping[str, Any], effects: Set[str]) -> bool:
    """Whether only these effects, at a low probability, change a number."""
    low = value.get("probability") is not None and value["probability"] < UNCERTAIN
    return low and bool(value["effects"]) and set(value["effects"]) <= effects


def _concerns(effect: Mapping[str, Any], servo: Mapping[str, Any], explanation: Sequence[Mapping[str, Any]]) -> bool:
    """Whether it acts on this servo: by its own target, or on all where none of its kind has this servo as target."""
    names = (servo["actuator"], servo["joint"], f"position.{servo['joint']}")
    own = {e.get("target") for e in explanation if e["effect"] == effect["effect"]} & set(names)
    target = effect.get("target")
    return any(effect["effect"] in v["effects"] for v in servo["values"]) and (target in own if own else target is None)


def _unit(effect: Mapping[str, Any], parameter: str) -> str:
    return str(effect["parameters"][parameter].get("unit", "1"))


def _in_text(name: str, value: float, unit: str) -> str:
    return percent(value) if name == "gain" and unit == "1" else measure(value, unit)


def _supply(r: Reading) -> str:
    return f"as if the supply were {_measured(r)} rather than {measure(r['nominal'], 'V')}"


def _loss(r: Reading) -> str:
    return f"as if the supply of {measure(r['nominal'], 'V')} fell by {_measured(r)}"


def _resistance(r: Reading) -> str:
    return f"as if the motor's resistance were {_measured(r)} rather than {measure(r['nominal'], 'ohm')}"


def _stiffness(r: Reading) -> str:
    what = "the servo" if r["p_gain"] is None else f"a P gain of {number(r['p_gain'])}"
    text = f"{what} acts like {_measured(r)}, where the model has {measure(r['nominal'], r['unit'])}"
    constants = r["by_constants"]
    if constants is None or abs(constants / r["nominal"] - 1.0) < TAKEN:
        return text
    return f"{text} and the motor's constants give {measure(constants, r['unit'])}"


def _current(r: Reading) -> str:
    return f"as if the current were limited to {_measured(r)} ({number(r['nominal'])} A at stall)"


def _duty(r: Reading) -> str:
    interval = "" if r["ci95"] is None else f" ({percent(r['ci95'][0])} to {percent(r['ci95'][1])})"
    return f"as if the duty cycle were limited to {percent(r['value'])}{interval}"


def _back_emf(r: Reading) -> str:
    model, back_emf = measure(r["nominal"], r["unit"]), measure(r["by_constants"], r["unit"])
    joint = "the joint" if len(r["actuators"]) == 1 else "each joint"
    damped = f"{joint} is damped by {_measured(r)} in all"
    return f"{damped}, where the model has {model} and the motor's back-EMF alone gives {back_emf}"


CLAUSES = {
    "supply_voltage": _supply,
    "supply_loss": _loss,
    "resistance": _resistance,
    "stiffness": _stiffness,
    "current_limit": _current,
    "duty_limit": _duty,
    "back_emf_damping": _back_emf,
}
# Each could be the reason alone.
CAUSES = ("supply_voltage", "supply_loss", "resistance", "current_limit", "duty_limit")


def _measured(r: Reading) -> str:
    return measure_interval(r["value"], r["ci95"], r["unit"])
