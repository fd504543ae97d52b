"""A fitted law in words: "a torque of 0.9 sin(14 q + 0.3) N m acts on joint elbow, like cogging"."""

from collections.abc import Mapping
from typing import Any

from residual_mpc.report.words.numbers import measure, number, percent

Law = Mapping[str, Any]  # an entry of diagnosis.json that is a fitted law

RATES = {"forward": "forward speed", "sideways": "sideways speed", "yaw": "yaw rate"}
LIKE = {
    ("torque", "angle"): "like cogging or an eccentric gear",
    ("torque", "position"): "like a cable or a spring",
    ("friction", "position"): "like friction that is not the same everywhere",
    ("friction", "time"): "like grease that warms up",
    ("strength", "time"): "like motors or a battery that change during a run",
    ("rate", "turning"): "like wheels that do not grip alike in all turns",
}
WHAT = {"torque": "a torque", "friction": "a dry friction"}


def law_sentence(law: Law) -> str:
    """One clause without a full stop."""
    target = law.get("target") or law.get("only_target")
    shape, like = _shape(law), LIKE.get((law["of"], _quantity(law)), "")
    if law["of"] == "rate":
        clause = f"the model lacks a {RATES.get(str(target), 'rate')} {shape}"
    elif law["of"] == "strength":
        clause = f"{f'actuator {target}' if target else 'every actuator'} gives more than modelled by a share {shape}"
    else:
        where = f"joint {target}" if target else "the joint"
        clause = f"{WHAT.get(law['of'], 'a ' + str(law['of']))} {shape} acts at {where}"
    return clause + (f", {like}" if like else "")


def _quantity(law: Law) -> str:
    words = str(law["on"]).split()
    return next((w for w in words if w in ("angle", "position", "speed", "time", "command", "turning")), "")


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
