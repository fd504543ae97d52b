"""What is left, in words: where it sits, what it depends on, what would look like that."""

from collections.abc import Mapping, Sequence
from typing import Any

from residual_mpc.report.words.effects import name as effect_name
from residual_mpc.report.words.numbers import listed, percent

SITS, LIFT = 0.25, 1.3  # share and lift from which a regime is worth naming
PART = 0.2  # share from which a component is
BURST = 0.15  # share of the time that holds half of what comes in bursts
SIDES = 0.2  # share of a curve's squares that is alike to both sides, from which its sides differ

COMPONENTS = {"forward": "the forward motion", "sideways": "the sideways motion", "yaw": "yaw", "twist.theta": "yaw"}
HINTS = {
    "wheel_angle": "an eccentric wheel or a bent axle would look like that",
    "angle": "cogging of a motor or the teeth of a gear would look like that",
    "time": "something that warms up, wears in or runs down would look like that",
    "work": "something that warms up, wears in or runs down would look like that",
    "position": "a dragging cable, a spring or a stop would look like that",
    "direction": "play or friction would look like that",
    "run": "something that was changed between the runs would look like that",
    "order": "something that changed from run to run would look like that",
    "heading": "a floor that is not level would look like that",
    "place": "a floor that is not the same everywhere would look like that",
}
AT_ONE_TIME = "something that comes at the same time of every run would look like that"
ONE_SIDED = "something that is weaker to one side would look like that"


def rest_sentence(remainder: Mapping[str, Any]) -> str:
    """`remainder` of diagnosis.json in one or two plain sentences."""
    sits = f"What is left sits in {_components(remainder['components'])}{_regime(remainder['regimes'])}"
    depends = remainder["depends_on"]
    if depends:
        hint = hint_of(depends[0])
        said = f"{sits} and {_depends(depends[0])}{': ' + hint if hint else ''}."
    else:
        bursts = remainder["half_within"] <= BURST
        how = f"half of it comes in {percent(remainder['half_within'])} of the time, as gusts or bumps would"
        said = f"{sits} and depends on nothing that was logged{'; ' + how if bursts else ''}."
    return f"{said}{_resembles(remainder['resembles'])}"


def component_name(name: str) -> str:
    """ "yaw", "position.elbow" as they are spoken of."""
    return COMPONENTS.get(name, name.removeprefix("position."))


def hint_of(dependence: Mapping[str, Any]) -> str:
    """What would look like that; empty where nothing comes to mind."""
    kind = dependence["kind"]
    if kind in ("turning", "speed"):
        return ONE_SIDED if _one_sided(dependence["curve"]) else ""
    if kind == "time" and dependence["form"] == "added":  # what warms up does nothing at rest
        return AT_ONE_TIME
    return HINTS.get(kind, "")


def form_of(dependence: Mapping[str, Any]) -> str:
    """How the coordinate enters, where it is not simply added."""
    if dependence["kind"] == "wheel_angle":
        return "once per revolution"
    repeats = dependence["curve"]["repeats"]
    if dependence["kind"] == "angle" and repeats:
        return f"{repeats} times per revolution"
    return {"speed": "in proportion to the speed", "direction": "along the direction of motion"}.get(
        dependence["form"], ""
    )


def _components(components: Sequence[Mapping[str, Any]]) -> str:
    named = [c for c in components if c["share"] >= PART] or list(components[:1])
    if len(named) > 3 or sum(c["share"] for c in named) < 0.5:
        return "several channels alike"
    return listed([component_name(c["name"]) for c in named]) if named else "no channel"


def _regime(regimes: Sequence[Mapping[str, Any]]) -> str:
    for r in sorted(regimes, key=lambda r: -r["lift"]):
        if r["share"] >= SITS and r["lift"] >= LIFT:
            where = {"large command": "under large commands", "actuator off": "with the actuators off",
                     "command step": "after steps of a command", "command reversal": "after reversals",
                     "standstill": "at standstill", "slow": "in slow motion", "fast": "in fast motion"}  # fmt: skip
            text = where.get(
                r["name"], f"while {r['name']}" if r["name"].startswith("turning") else f"in the {r['name']}"
            )
            return f" {text}"
    return ""


def _depends(d: Mapping[str, Any]) -> str:
    if d["kind"] == "steady":
        return {
            "added": f"is a steady drift ({percent(d['share'])} of it)",
            "speed": f"grows in proportion to the speed ({percent(d['share'])} of it)",
            "direction": f"has the direction of the motion, whatever its speed ({percent(d['share'])} of it)",
        }[d["form"]]
    form = form_of(d)
    others = f"; {listed(d['alike'])} would do as well" if d["alike"] else ""
    return f"depends on {d['on']} ({percent(d['share'])} of it{', ' + form if form else ''}{others})"


def _resembles(resembles: Mapping[str, Any] | None) -> str:
    if not resembles:
        return ""
    target = f" of {resembles['target']}" if resembles["target"] else ""
    closes = percent(resembles["closes"])
    return f" Of the known effects it resembles {effect_name(resembles)}{target} most, which closes {closes} of it."


def _one_sided(curve: Mapping[str, Any]) -> bool:
    """Whether a curve that should be odd, such as one over a speed, is not: its even part is much of it."""
    x, y = curve["x"], curve["y"]
    pairs = [(v, _at(x, y, -u)) for u, v in zip(x, y, strict=True) if min(x) <= -u <= max(x)]
    even = sum((0.5 * (a + b)) ** 2 for a, b in pairs)
    return even > SIDES * sum(0.5 * (a * a + b * b) for a, b in pairs) > 0.0


def _at(x: Sequence[float], y: Sequence[float], at: float) -> float:
    """Linear between the points."""
    for (x0, y0), (x1, y1) in zip(zip(x, y, strict=True), zip(x[1:], y[1:], strict=True), strict=False):
        if x0 <= at <= x1:
            return float(y0 + (y1 - y0) * (at - x0) / (x1 - x0))
    return float(y[-1])
