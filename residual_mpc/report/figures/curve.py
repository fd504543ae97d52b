"""The missing rate over what it depends on, with its standard errors; a fitted law, or a ripple, over its quantity."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from residual_mpc.effects.ops import NUMPY
from residual_mpc.effects.surroundings import TORQUE_RIPPLE
from residual_mpc.report.evidence.clock import offset_of
from residual_mpc.report.figures.inline import COLOURS, few_ticks, house_style, inline
from residual_mpc.report.words.numbers import in_brackets, spelled

if TYPE_CHECKING:
    from markupsafe import Markup

SIZE = (5.4, 2.5)  # inches
POINTS = 25  # of a cycle


def curve(dependence: Mapping[str, Any], what: str, name: str) -> "Markup":
    """One entry of `depends_on`. what: the component in words; `name` is unique on the page."""
    c = dependence["curve"]
    x, y, se = (np.asarray(c[k], dtype=float) for k in ("x", "y", "se"))
    if c["repeats"]:  # the first point comes again a period later
        period = 2.0 * np.pi / c["repeats"]
        x, y, se = (np.append(a, b) for a, b in ((x, period), (y, y[0]), (se, se[0])))
    return _drawn(dependence, what, name, x, np.stack([y - 2.0 * se, y, y + 2.0 * se]))


def _drawn(dependence: Mapping[str, Any], what: str, name: str, x: np.ndarray, band: np.ndarray) -> "Markup":
    """The points with their 95 % intervals. band (3, n): lowest value, value and highest value at each x (n,)."""
    from matplotlib.figure import Figure

    low, y, high = band
    offset = offset_of(x)
    apart = dependence["kind"] in ("run", "direction")
    with house_style():
        figure = Figure(figsize=SIZE, layout="constrained")
        axes = figure.add_subplot()
        axes.axhline(0.0, color=COLOURS["floor"], ls=":", lw=1.4)
        if not apart:
            axes.fill_between(x - offset, low, high, color=COLOURS["after"], alpha=0.18, lw=0)
        sides, line = np.maximum([y - low, high - y], 0.0), "none" if apart else "-"
        axes.errorbar(x - offset, y, sides, color=COLOURS["after"], marker="o", ms=4, lw=1.4, ls=line)
        since = f" - {offset:.0f}" if offset else ""
        axes.set_xlabel(dependence["on"] + since + in_brackets(dependence["curve"]["x_unit"]))
        axes.set_ylabel(_y_label(dependence, what))
        axes.margins(x=0.03)
        few_ticks(axes)
        return inline(figure, name, _alt(dependence, what, x, y))


def law_curve(law: Mapping[str, Any], name: str) -> "Markup":
    """A fitted law of an explanation, level beyond its ends unless it repeats; `name` is unique on the page."""
    low, high = law["values_ci95"]
    x, band = np.asarray(law["knots"], dtype=float), np.array([low, law["values"], high], dtype=float)
    if law["form"] != "harmonic":
        beyond = 0.15 * max(float(np.ptp(x)), 1e-6 + 0.1 * abs(float(x[0])))
        begin = x[0] - beyond
        if str(law["on"]).startswith("the size of "):
            begin = max(begin, 0.0)
        x = np.concatenate([[begin], x, [x[-1] + beyond]])
        band = np.pad(band, ((0, 0), (1, 1)), "edge")
    what = f"the {law['of']}" + (f" of {law['target']}" if law.get("target") else "")
    units = {"x_unit": law["on_unit"], "y_unit": law["unit"]}
    return _drawn({"on": law["on"], "kind": "law", "form": "added", "curve": units}, what, name, x, band)


def ripple_curve(ripple: Mapping[str, Any], name: str) -> "Markup":
    """One cycle of a torque ripple of an explanation without its lead, with the interval of its amplitude; `name` is
    unique on the page."""
    assert TORQUE_RIPPLE.step is not None
    own = {k: float(p["value"]) for k, p in ripple["parameters"].items()}
    numbers = {p.name: own.get(p.name, p.null) for p in TORQUE_RIPPLE.parameters}
    x = np.linspace(0.0, 2.0 * np.pi / numbers["cycles"], POINTS)
    ends = ripple["parameters"]["amplitude"].get("ci95") or [numbers["amplitude"]] * 2
    y, *sides = (TORQUE_RIPPLE.step(NUMPY, {**numbers, "amplitude": a}, x, 0.0) for a in (numbers["amplitude"], *ends))
    target = ripple.get("target") or ripple.get("only_target") or "the joint"
    law = {"of": "torque", "on": f"the angle of {target}", "form": "harmonic", "unit": "N m", "on_unit": "rad"}
    band = {"knots": x, "values": y, "values_ci95": [np.minimum(*sides), np.maximum(*sides)]}
    return law_curve({**law, **band, "target": ripple.get("target")}, name)


def _y_label(dependence: Mapping[str, Any], what: str) -> str:
    unit = str(dependence["curve"]["y_unit"])
    lacking = f"missing in {what}"
    if dependence["kind"] == "wheel_angle":
        return f"{lacking}\n({spelled(unit)} of the wheel)"
    if dependence["form"] == "speed":
        return f"{lacking},\nof its speed{in_brackets(unit)}"
    return f"{lacking}\n{in_brackets(unit).strip()}".rstrip()


def _alt(dependence: Mapping[str, Any], what: str, x: np.ndarray, y: np.ndarray) -> str:
    low, high = int(np.argmin(y)), int(np.argmax(y))
    return (
        f"Rate missing in {what} against {dependence['on']}: from {y[low]:.2g} at {x[low]:.2g} "
        f"to {y[high]:.2g} at {x[high]:.2g}."
    )
