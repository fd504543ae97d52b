"""A fitted law in words: "a torque of 0.9 sin(14 q + 0.3) N m acts on joint elbow, like cogging"."""

from collections.abc import Mapping
from typing import Any

from residual_mpc.effects.phrase import called
from residual_mpc.report.words.numbers import measure, number, percent

Law = Mapping[str, Any]  # an entry of diagnosis.json that is a fitted law

KNOWN = ("angle", "position", "speed", "time", "command", "load", "turning", "logged")  # quantities
RATES = {"forward": "forward speed", "sideways": "sideways speed", "yaw": "yaw rate"}
LIKE = {
    ("torque", "angle"): "like cogging or an eccentric gear",
    ("torque", "position"): "like a cable or a spring",
    ("friction", "position"): "like friction that is not the same everywhere",
    ("friction", "time"): "like grease that warms up",
    ("strength", "position"): "like a linkage or a cable whose lever arm changes",
    ("strength", "load"): "like a supply or a motor that weakens under load",
    ("strength", "time"): "like motors or a battery that change during a run",
    ("rate", "turning"): "like wheels that do not grip alike in all turns",
}
ALIKE = 0.25  # of its mean, up to which a rate counts as the same throughout
WHAT = {"torque": "a torque", "friction": "a dry friction"}
MORE = {"torque": "additional torque", "friction": "additional dry friction", "damping": "additional viscous friction"}


def law_sentence(law: Law) -> str:
    """One clause without a full stop."""
    target = law.get("target") or law.get("only_target")
    shape, like = _shape(law), _like(law)
    if _quantity(law) == "logged":
        return _of_column(law, target)
    if law["of"] == "rate":
        clause = f"the model lacks a {RATES.get(str(target), 'rate')} {shape}"
    elif law["of"] == "strength" and law["form"] == "curve":
        low, high = (percent(1.0 + v) for v in (min(law["values"]), max(law["values"])))
        clause = f"{_actuator(law, target)} gives {low} to {high} of its modelled output, depending on {law['on']}"
    elif law["of"] == "strength":
        clause = f"{_actuator(law, target)} gives more than modelled by a share {shape}"
    else:
        where = called("joint", target) if target else "the joint"
        clause = f"{WHAT.get(law['of'], 'a ' + str(law['of']))} {shape} acts at {where}"
    return clause.removesuffix(",") + (f", {like}" if like else "")


def _of_column(law: Law, target: object) -> str:
    """A law of a logged column by its values at the ends of what was logged, and at a bend between them."""
    share = law["of"] == "strength"
    values = [percent(1.0 + v) if share else measure(v, str(law["unit"])) for v in law["values"]]
    points = [f"{v} at {number(z)}" for v, z in zip(values, law["knots"], strict=True)]
    if law["form"] == "curve":
        points = [points[0], points[len(points) // 2], points[-1]]
    over = f"{law['on']}: {', '.join(points[:-1])} and {points[-1]}"
    if share:
        return f"the share of the modelled output that {_actuator(law, target)} gives depends on {over}"
    where = called("joint", target) if target else "every joint"
    return f"{MORE[law['of']]} at {where} depends on {over}"


def _like(law: Law) -> str:
    """A known thing that acts like it; empty where there is none."""
    if _quantity(law) == "load" and law["values"][-1] >= law["values"][0]:
        return ""
    low, high = min(law["values"], default=0.0), max(law["values"], default=0.0)
    if law["of"] == "rate" and law.get("target") == "yaw" and high - low < ALIKE * abs(high + low) / 2.0:
        return "like a drifting heading, such as that of a gyroscope"
    return LIKE.get((law["of"], _quantity(law)), "")


def _actuator(law: Law, target: object) -> str:
    if _quantity(law) in ("load", "position"):  # a law on a joint
        return f"the actuator of {called('joint', target)}" if target else "the actuator of the joint"
    return called("actuator", target) if target else "every actuator"


def _quantity(law: Law) -> str:
    words = str(law["on"]).split()
    return next((w for w in words if w in KNOWN), "")


def _shape(law: Law) -> str:
    unit, on = str(law["unit"]), str(law["on"])
    numbers = {k: (float(v["value"]), str(v["unit"])) for k, v in law["parameters"].items()}

    def said(name: str) -> str:
        value, of = numbers[name]
        return percent(value) if of == "1" else measure(value, of)

    if law["form"] == "harmonic":
        amplitude, cycles, phase, offset = (numbers[n][0] for n in ("amplitude", "cycles", "phase", "offset"))
        steady = "" if abs(offset) < 0.05 * amplitude else f" {_signed(offset)}"
        wave = f"{number(amplitude)} sin({number(cycles)} q {_signed(round(phase, 2))}){steady}"
        return f"of {wave} {unit}, q being {on},"
    if law["form"] == "constant":
        return f"of {said('level')}"
    if law["form"] == "line":
        return f"whose slope over {on} is {said('gradient')}, with {said('at_zero')} at 0"
    if law["form"] == "step":
        return f"that steps from {said('below')} to {said('above')} where {on} passes {said('at')}"
    if law["form"] == "saturating":
        return f"that goes from {said('below')} to {said('above')} while {on} goes from {said('from')} to {said('to')}"
    if law["form"] == "bend":
        at = said("at")
        return f"whose slope over {on} is {said('gradient_below')} below {at} and {said('gradient_above')} above"
    low, high = (percent(v) if unit == "1" else measure(v, unit) for v in (min(law["values"]), max(law["values"])))
    return f"between {low} and {high}, a function of {on},"


def _signed(value: float) -> str:
    return f"{'+' if value >= 0 else '-'} {number(abs(value))}"
