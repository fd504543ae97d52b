"""The remaining error in words: where it is, what it depends on, what would cause that, which effect comes closest."""

from collections.abc import Mapping, Sequence
from typing import Any

from residual_mpc.report.words.effects import name_at
from residual_mpc.report.words.numbers import listed, number, percent

SITS, LIFT = 0.25, 1.3  # share and lift from which a regime is worth naming
PART = 0.2  # share from which a component is
BURST = 0.15  # share of the time that holds half of what comes in bursts
EVENT = 0.05  # share from which it looks like something that happened to the robot
TIMES = 2  # of what is left that are told
SIDES = 0.2  # share of a curve's squares that is alike to both sides, from which its sides differ

COMPONENTS = {"forward": "the forward motion", "sideways": "the sideways motion", "yaw": "yaw", "twist.theta": "yaw"}
# What would leave an error of that kind.
HINTS = {
    "wheel_angle": "an eccentric wheel or a bent axle",
    "angle": "motor cogging or gear teeth",
    "time": "warm-up, run-in or a falling supply voltage",
    "work": "warm-up, run-in or a falling supply voltage",
    "position": "a dragging cable, a spring or an end stop",
    "load": "a supply that weakens under load, or friction that grows with it",
    "direction": "backlash or friction",
    "run": "a change between the runs",
    "order": "a gradual change from run to run",
    "heading": "a sloping floor",
    "place": "an uneven floor",
}
AT_ONE_TIME = "an event at the same time in every run"
ONE_SIDED = "an asymmetry between the two directions"
REGIMES = {
    "large command": "under large commands",
    "actuator off": "with the actuators off",
    "command step": "after command steps",
    "command reversal": "after command reversals",
    "standstill": "at standstill",
    "slow": "at low speed",
    "fast": "at high speed",
}
OWN_STEP = "Most of it is the error of the model's own time step."
CLOSE = 0.5  # share of the rest from which an effect that was not added needs a reason


def rest_sentence(remainder: Mapping[str, Any]) -> str:
    """`remainder` of diagnosis.json in one or two plain sentences."""
    where = f"The remaining error is mainly in {_components(remainder['components'])}{_regime(remainder['regimes'])}"
    depends = remainder["depends_on"]
    if remainder.get("own_step"):
        return f"{where}. {OWN_STEP}"
    if depends:
        hint = hint_of(depends[0])
        said = f"{where} and {_depends(depends[0])}{', consistent with ' + hint if hint else ''}."
    else:
        said = f"{where} and depends on no logged quantity{_bursts(remainder)}"
    like = resemblance(remainder["resembles"])
    return f"{said} {like}" if like else said


def _bursts(remainder: Mapping[str, Any]) -> str:
    """The end of the sentence: how little of the time holds half of the rest, and the times that hold the most."""
    within = remainder["half_within"]
    if within > BURST:
        return "."
    times = [f"{x['run']} from {number(x['from'])} to {number(x['to'])} s" for x in remainder.get("times", ())]
    most = f" (most in {listed(times[:TIMES])})" if times else ""
    happened = " Was the robot pushed, held or lifted then?" if times and within <= EVENT else ""
    return f"; it comes in bursts: half of it occurs in {percent(within)} of the time{most}.{happened}"


def resemblance(resembles: Mapping[str, Any] | None) -> str:
    """The known effect that comes closest to the rest, and why it is not named as its cause; empty for none."""
    if not resembles:
        return ""
    name, closes, why = name_at(resembles), resembles["closes"], resembles.get("why")
    reason = f": {why.rstrip('.')}" if why and closes >= CLOSE else ""
    closest = f"{name[:1].upper()}{name[1:]} would close {percent(closes)} of it"
    return f"{closest}, but the evidence was insufficient to name it{reason}."


def component_name(name: str) -> str:
    """ "yaw", "position.elbow" as they are spoken of."""
    return COMPONENTS.get(name, name.removeprefix("position."))


def regime_words(name: str) -> str:
    """ "slow" as "at low speed"."""
    return REGIMES.get(name, f"while {name}" if name.startswith("turning") else f"in the {name}")


def hint_of(dependence: Mapping[str, Any]) -> str:
    """What would leave such an error; empty where nothing is known to."""
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
    return {"speed": "proportional to the speed", "direction": "along the direction of motion"}.get(
        dependence["form"], ""
    )


def _components(components: Sequence[Mapping[str, Any]]) -> str:
    components = [c for c in components if c["share"] is not None]  # of a run too short to tell
    named = [c for c in components if c["share"] >= PART] or list(components[:1])
    if len(named) > 3 or sum(c["share"] for c in named) < 0.5:
        return "several channels"
    return listed([component_name(c["name"]) for c in named]) if named else "no channel"


def _regime(regimes: Sequence[Mapping[str, Any]]) -> str:
    for r in sorted(regimes, key=lambda r: -r["lift"]):
        if r["share"] >= SITS and r["lift"] >= LIFT:
            return " " + regime_words(r["name"])
    return ""


def _depends(d: Mapping[str, Any]) -> str:
    share = f"{percent(d['share'])} of it"
    if d["kind"] == "steady":
        return {
            "added": f"is a steady drift ({share})",
            "speed": f"is proportional to the speed ({share})",
            "direction": f"follows the direction of motion, independent of the speed ({share})",
        }[d["form"]]
    form = form_of(d)
    others = f"; {listed(d['alike'])} would fit equally well" if d["alike"] else ""
    return f"depends on {d['on']} ({share}{', ' + form if form else ''}{others})"


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
