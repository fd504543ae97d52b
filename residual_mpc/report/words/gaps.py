"""Gaps in words: one line a horizon, and what a reader has to know before trusting the figures."""

from collections.abc import Mapping, Sequence
from typing import Any

from residual_mpc.report.words.numbers import count, number, percent

Gap = Mapping[str, Any]  # `gap` of diagnosis.json, or what `gap --json` prints; or one of its `horizons`
RULES = 3.0  # times the median window's gap, from which a few windows make up the whole
USELESS = 0.3  # gap from which a model that is worse than a forecast of constant velocity says nothing
ALIKE = 1.05  # times a forecast's gap, up to which a model is no worse
FAR = 3.0  # times the noise floor, from which a gap is no noise, whatever the floor's error
NEAR = 2.0  # times the noise floor, up to which a gap may be noise
QUARTER = 0.25  # of a horizon over which noise hides everything, to try next
DIVERGES = 10.0  # a gap from which the prediction runs away


def horizons_of(gap: Gap) -> list[Gap]:
    """Every horizon, the headline one first; that one alone for an older document."""
    return list(gap.get("horizons") or [gap])


def first_of(gap: Gap) -> float:
    """The gap of the model as it is: retuned in a diagnosis, nominal in a measurement."""
    return float(gap["before"] if "before" in gap else gap["nominal"])


def last_of(gap: Gap) -> float | None:
    """The gap with the effects, or of the model that was measured beside the nominal one; None where there is none."""
    last = gap.get("after", gap.get("model"))
    return None if last is None else float(last)


def horizon_line(gap: Gap, explained: bool) -> str:
    """ "gap at 5 s: 0.12 -> 0.03 (noise floor 0.02)"; explained: whether the last gap is another model's."""
    last = last_of(gap) if explained else None
    arrow = "" if last is None else f" -> {number(last)}"
    windows = f", {count(gap['windows'], 'window')}" if gap.get("windows") else ""
    seen = ", not held out" if gap.get("held_out") is False else ""
    floor, first = number(gap["noise_floor"], 2), number(first_of(gap))
    retuned = "" if number(gap.get("nominal", first_of(gap))) == first else f"{number(gap['nominal'])}, retuned "
    return f"gap at {number(gap['horizon'])} s: {retuned}{first}{arrow} (noise floor {floor}){windows}{seen}"


def new_readings_line(gap: Gap, explained: bool) -> str:
    """The gap without what a slow sensor repeats; empty where none does."""
    new = gap.get("new_readings")
    if not new:
        return ""
    arrow = f" -> {number(last_of(new) or 0.0)}" if explained else ""
    figures = f"{number(first_of(new))}{arrow} (noise floor {number(new['noise_floor'], 2)})"
    return f"gap at {number(gap['horizon'])} s without repeated readings: {figures}"


def window_gaps(gap: Gap, last: bool) -> Mapping[str, Any] | None:
    """The quantiles p50, p90 and max of the windows' own gaps, of the first or the last model, and the window of the
    largest where that is told; None where nothing is."""
    told = gap.get("window_gaps") or {}
    return next((told[k] for k in (("after", "model") if last else ("before", "nominal")) if told.get(k)), None)


def few_windows(gap: Gap, last: bool) -> str:
    """A sentence where a few windows make up the gap; empty elsewhere."""
    quantiles, total = window_gaps(gap, last), last_of(gap) if last else first_of(gap)
    if quantiles is None or total is None or total <= RULES * quantiles["p50"]:
        return ""
    half, worst = number(quantiles["p50"], 2), number(quantiles["max"], 2)
    begin = quantiles.get("from")
    ends = "" if begin is None else f"{number(begin)} to {number(begin + gap['horizon'])} s"
    where = f" ({quantiles['run']}, {ends})" if ends else ""
    return (
        f"A few windows dominate the gap at {number(gap['horizon'])} s: the median over the windows is {half}, "
        f"the maximum {worst}{where}."
    )


def floor_matters(gap: Gap) -> bool:
    """Whether a gap at any horizon is so near its noise floor that a lower floor would change the reading."""
    return any(first_of(one) < FAR * float(one.get("noise_floor") or 0.0) for one in horizons_of(gap))


def size(gap: float) -> str:
    """How much of the motion a model with that gap misses: "misses 21 % of the motion"."""
    if gap >= DIVERGES:
        return f"diverges to {number(gap, 2)} times the motion itself"
    if gap >= 1.0:
        return f"has an error of {number(gap, 2)} times the motion itself"
    return f"misses {percent(gap)} of the motion"


def warnings(gap: Gap, explained: bool) -> list[str]:
    """What makes the figures doubtful, a sentence each: noise in which a correct model would do no better, a model that
    is worse than a forecast without one, and one that diverges."""
    constant = gap.get("constant_velocity")
    nominal = float(gap["nominal"]) if gap.get("nominal") is not None else first_of(gap)
    last = last_of(gap) if explained else None
    models = [("nominal", nominal)] if last is None else [("nominal", nominal), ("final", last)]
    if (noise := _noise_alone(gap, models[-1][1])) is not None:
        return [noise]
    said = []
    if constant is not None:
        worse = {name: value for name, value in models if value > ALIKE * constant}
        if worse:
            who = "This model" if len(models) == 1 else f"The {' and the '.join(worse)} model"
            verb, their = ("predicts", "its") if len(worse) == 1 else ("predict", "their")
            few = all(few_windows(gap, name == "final") for name in worse)
            useless = max(worse.values()) > USELESS and not few
            nothing = f", so {their} figures are not meaningful for these runs" if useless else ""
            said.append(f"{who} {verb} worse than a constant-velocity forecast ({number(constant)}){nothing}.")
        if constant < models[-1][1] <= ALIKE * constant:
            who = "This" if len(models) == 1 else f"The {models[-1][0]}"
            said.append(f"{who} model predicts no better than a constant-velocity forecast ({number(constant)}).")
    if nominal >= 1.0:
        said.append(f"The nominal model {size(nominal)}: a model that predicts no motion would be better.")
    return said


def _noise_alone(gap: Gap, last: float) -> str | None:
    """A sentence where the noise floor is so high that even a correct model is worse than a forecast without one, and
    the last model is near it; None elsewhere. An unstable robot amplifies the noise in a window's start."""
    floor, constant = float(gap.get("noise_floor") or 0.0), gap.get("constant_velocity")
    if last > NEAR * floor or floor < (1.0 if constant is None else min(float(constant), 1.0)):
        return None
    return (
        f"At {number(gap['horizon'])} s, noise in the measured start state alone produces a gap of {number(floor, 2)}, "
        f"even for a correct model: these runs cannot test the model at this horizon. Shorten it ({shorter(gap)})."
    )


def shorter(gap: Gap) -> str:
    """The horizon to try where noise hides everything over the present one."""
    return f"for example --horizon {number(QUARTER * gap['horizon'], 2)}"


def hardest(gap: Gap, key: str) -> Gap:
    """The horizon at which the gap `key` stands highest above the noise floor; the headline one among equals."""
    return max(horizons_of(gap), key=lambda h: ratio(h, key) or 0.0)


def ratio(gap: Gap, key: str) -> float | None:
    """A gap over the noise floor; None where either is missing or the floor is nil."""
    floor, value = gap.get("noise_floor"), gap.get(key)
    return None if not floor or value is None else float(value) / float(floor)


def at_horizon(gap: Gap, headline: float) -> str:
    """ " at 5 s" for a horizon other than the headline one."""
    return "" if gap["horizon"] == headline else f" at {number(gap['horizon'])} s"


def seen_horizons(gaps: Sequence[Gap]) -> list[float]:
    """The horizons at which no window could be held out."""
    return [float(g["horizon"]) for g in gaps if g.get("held_out") is False]
