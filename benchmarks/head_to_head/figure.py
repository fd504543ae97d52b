"""The picture of the page: every value over its true one, by who said it."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.head_to_head.files import HIDDEN
from benchmarks.head_to_head.match import Match
from benchmarks.head_to_head.servo import CASES, TUNED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TITLES = {
    "nothing": "nothing hidden",
    "delay": "10 ms of command delay",
    "payload": "0.15 kg of payload",
    "step": "nothing, but a coarse model",
}
SIDES = (
    ("mujoco.sysid, told nothing", "#c44e52", "o"),
    ("mujoco.sysid, told which", "#dd8452", "s"),
    ("residual-mpc diagnose, told nothing", "#4c72b0", "D"),
)
TICKS = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
SHOWN = (0.65, 7.0)  # of value / true value; what lies beyond is written at the edge


def draw(matches: Sequence[Match], path: Path) -> None:
    """Write a PNG: a panel a case, a row a parameter, a dot a seed; bars are the tools' own 95 % intervals."""
    from matplotlib.figure import Figure

    cases = [case for case in CASES if any(m.case == case for m in matches)]
    figure = Figure(figsize=(3.4 * len(cases), 3.9), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(cases), sharex=True))
    for axes, case in zip(panels, cases, strict=True):
        rows = [*TUNED, case] if case in HIDDEN else [*TUNED]
        axes.axvline(1.0, color="0.6", lw=0.8, zorder=0)
        for side, (label, colour, marker) in enumerate(SIDES):
            points = [p for m in matches if m.case == case for p in _points(m, rows, side)]
            if not points:
                continue
            x, low, high, y = np.array(points).T
            for value, height in zip(x, y, strict=True):
                if not SHOWN[0] < value < SHOWN[1]:
                    _beyond(axes, value, height, colour)
            axes.errorbar(x, y, xerr=[x - low, high - x], fmt=marker, ms=4, lw=1.2, color=colour, label=label)
        axes.set(title=TITLES[case], xscale="log", yticks=range(len(rows)), yticklabels=rows)
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_xticks(TICKS, labels=[f"{tick:g}" for tick in TICKS])
        axes.set_xlim(*SHOWN)
        axes.minorticks_off()
    figure.supxlabel("value / true value", fontsize=10)
    entries = dict(pair[::-1] for axes in panels for pair in zip(*axes.get_legend_handles_labels(), strict=True))
    found = [label for label, _, _ in SIDES if label in entries]
    figure.legend([entries[label] for label in found], found, loc="outside upper center", ncols=3, frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130, metadata={"Software": None})


def _beyond(axes: "Axes", value: float, height: float, colour: str) -> None:
    """The value in words, at the edge that it lies beyond."""
    low = value < SHOWN[0]
    text, at = (f"← {value:.2g}", SHOWN[0] * 1.02) if low else (f"{value:.2g} →", SHOWN[1] * 0.98)
    axes.text(at, height, text, color=colour, ha="left" if low else "right", va="center", fontsize=8)


def _points(m: Match, rows: Sequence[str], side: int) -> list[tuple[float, float, float, float]]:
    """(value, low, high) over the true value, and the height, of what one side said of a match."""
    told = (m.fits["nothing"], m.fits.get(m.case) if m.case in HIDDEN else None)
    out = []
    for i, name in enumerate(rows):
        true = getattr(m.truth, name)
        height = i + 0.25 * (side - 1) + 0.03 * (m.seed % 5 - 2)
        if side < 2:
            fit = told[side]
            if fit is None or name not in fit.values:
                continue
            value, half = fit.values[name], fit.half_widths[name]
            low, high = value - half, value + half
        else:
            if name not in m.diagnosed.values:
                continue
            value = m.diagnosed.values[name]
            low, high = m.diagnosed.intervals.get(name, (value, value))
        out.append((value / true, max(low, 1e-6) / true, high / true, height))
    return out
