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
}


def law_sentence(law: Law) -> str:
    """One clause without a full stop."""
    subject, shape = _what(law), _shape(law)
    like = LIKE.get((law["of"], _quantity(law)))
    return f"{subject} {shape}{_where(law)}" + (f", {like}" if like else "")


def _what(law: Law) -> str:
    if law["of"] == "rate":
        return f"an additional {RATES.get(law['target'], 'rate')}"
    if law["of"] == "strength":
        return "a relative change of the output"
    return {"torque": "a torque", "friction": "a dry friction"}.get(law["of"], f"a {law['of']}")


def _where(law: Law) -> str:
    target = law.get("target") or law.get("only_target")
    if law["of"] == "rate":
        return ""
    if law["of"] == "strength":
        return f" of {target}" if target else " of every actuator"
    return f" at joint {target}" if target else " at the joint"


def _quantity(law: Law) -> str:
    words = str(law["on"]).split()
    return next((w for w in words if w in ("angle", "position", "speed", "time", "command")), "")


def _shape(law: Law) -> str:
    unit, on = str(law["unit"]), str(law["on"])
    p = {k: float(v["value"]) for k, v in law["parameters"].items()}
    units = {k: str(v["unit"]) for k, v in law["parameters"].items()}

    def said(name: str) -> str:
        return percent(p[name]) if units[name] == "1" and not name.startswith("slope") else measure(p[name], units[name])

    if law["form"] == "harmonic":
        steady = "" if abs(p["offset"]) < 0.05 * p["amplitude"] else f" {_signed(p['offset'])}"
        wave = f"{number(p['amplitude'])} sin({number(p['cycles'])} q {_signed(p['phase'])}){steady}"
        return f"of {wave} {unit}, where q is {on},"
    if law["form"] == "constant":
        return f"of {said('level')}"
    if law["form"] == "line":
        return f"of {said('at_zero')} that changes by {said('slope')} with {on}"
    if law["form"] == "step":
        return f"that steps from {said('below')} to {said('above')} where {on} passes {said('at')}"
    if law["form"] == "saturation":
        return f"that goes from {said('below')} to {said('above')} while {on} goes from {said('from')} to {said('to')}"
    if law["form"] == "bend":
        return f"that changes with {on} by {said('slope_below')} below {said('at')} and by {said('slope_above')} above"
    low, high = (percent(v) if unit == "1" else measure(v, unit) for v in (min(law["values"]), max(law["values"])))
    return f"between {low} and {high} as a function of {on}"


def _signed(value: float) -> str:
    return f"{'+' if value >= 0 else '-'} {number(abs(value))}"
