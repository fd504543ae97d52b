"""What a channel did, and what the model predicts without and with the named effects."""

from typing import TYPE_CHECKING

import numpy as np

from residual_mpc.report.evidence.evidence import Array, Panel
from residual_mpc.report.figures.inline import COLOURS, few_ticks, house_style, inline
from residual_mpc.report.words.numbers import measure, number, spelled

if TYPE_CHECKING:
    from markupsafe import Markup

SIZE = (5.4, 2.5)  # inches; at a phone's width the text is still about 8 px
DOTTED = 60  # with fewer measured samples than this, each is shown as a dot


def traces(panel: Panel, name: str, start: float) -> "Markup":
    """The panel's three signals over the time since `start`, the run's first stamp (s). `name` is unique on the
    page."""
    from matplotlib.figure import Figure

    t = panel.t - start
    breaks = np.isnan(panel.measured) & np.isnan(panel.before) & np.isnan(panel.after)
    explained = bool(np.isfinite(panel.after).any())
    with house_style():
        figure = Figure(figsize=SIZE, layout="constrained")
        axes = figure.add_subplot()
        measured = bridged(panel.measured, breaks)
        few = int(np.isfinite(panel.measured).sum()) < DOTTED
        dot = "." if few else ""
        axes.plot(t, measured, color=COLOURS["ink"], lw=2.2, alpha=0.55, marker=dot, ms=4)
        axes.plot(t, bridged(panel.before, breaks), color=COLOURS["before"], ls=(0, (4, 1.6)))
        if explained:
            axes.plot(t, bridged(panel.after, breaks), color=COLOURS["after"])
        axes.set_xlabel("time since start of run (s)")
        axes.set_ylabel(spelled(panel.unit))
        axes.margins(x=0.01)
        few_ticks(axes)
        return inline(figure, name, _alt(panel, t, explained))


def bridged(signal: Array, breaks: np.ndarray) -> Array:
    """`signal` with its missing samples filled by straight lines inside each stretch between `breaks`.

    A sensor slower than the log leaves most cells empty, and a line drawn through NaN would be invisible.
    """
    filled = signal.copy()
    edges = np.flatnonzero(np.diff(np.concatenate(([True], breaks, [True])).astype(int)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        stretch = signal[first:last]
        seen = np.flatnonzero(np.isfinite(stretch))
        if seen.size:
            index = np.arange(stretch.size)
            inside = (index >= seen[0]) & (index <= seen[-1])
            filled[first:last][inside] = np.interp(index[inside], seen, stretch[seen])
    return filled


def rms_error(panel: Panel, signal: Array) -> float:
    """Root mean square of prediction minus measurement, in the panel's unit; NaN where nothing overlaps."""
    error = signal - panel.measured
    if panel.channel.endswith(".theta"):  # a heading may be logged wrapped
        error = np.arctan2(np.sin(error), np.cos(error))
    error = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(error**2))) if error.size else float("nan")


def _alt(panel: Panel, t: Array, explained: bool) -> str:
    text = (
        f"{panel.channel} of run {panel.run} from {number(t[0], 4)} to {number(t[-1], 4)} s: measured, and"
        f" predicted before (root mean square error {measure(rms_error(panel, panel.before), panel.unit)})"
    )
    after = f" and after ({measure(rms_error(panel, panel.after), panel.unit)})" if explained else ""
    return text + after + "."
