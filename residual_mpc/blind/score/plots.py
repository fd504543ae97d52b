"""The page's plots, as SVG text that stands inside the page."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from residual_mpc.blind.score.summary import Summary

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = ("#2b6cb0", "#c05621", "#718096", "#2f855a")


def levels_plot(summaries: Sequence[Summary]) -> str:
    """Right answers by level, with 95 % intervals, a bar a method."""
    figure, axes = _figure(7.5, 3.2)
    names = list(summaries[0].by_level)
    width = 0.8 / len(summaries)
    for i, summary in enumerate(summaries):
        at = np.arange(len(names)) + (i - (len(summaries) - 1) / 2) * width
        rates = [summary.by_level[name] for name in names]
        values = np.array([r.value or 0.0 for r in rates])
        ends = np.array([r.ci95 or (0.0, 0.0) for r in rates]).T
        axes.bar(at, values, width * 0.92, color=_COLOURS[i % 4], label=summary.method)
        axes.errorbar(at, values, np.abs(ends - values), fmt="none", ecolor="#1a202c", capsize=2, lw=0.9)
    axes.set_xticks(range(len(names)), [n.replace("_", " ") for n in names])
    axes.set_ylim(0, 1.02)
    axes.set_ylabel("share of right answers")
    axes.legend(frameon=False, ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1.0))
    return _svg(figure)


def reliability_plot(summary: Summary) -> str:
    """Stated probability against how often it was true; the area of a dot is the number of candidates."""
    figure, axes = _figure(3.6, 3.4)
    axes.plot([0, 1], [0, 1], color="#a0aec0", lw=1, zorder=0)
    for b in summary.bins:
        axes.scatter(b.stated, b.seen, s=12 + 4 * b.count**0.6, color=_COLOURS[0])
        axes.annotate(str(b.count), (b.stated, b.seen), textcoords="offset points", xytext=(6, -8), fontsize=7)
    axes.set(xlim=(-0.03, 1.05), ylim=(-0.05, 1.05), xlabel="stated probability", ylabel="observed frequency")
    return _svg(figure)


def shrink_plot(summary: Summary) -> str:
    """Expected against achieved shrink, with the expected interval."""
    figure, axes = _figure(3.6, 3.4)
    axes.plot([0, 1], [0, 1], color="#a0aec0", lw=1, zorder=0)
    for o in summary.outcomes:
        c = o.claim
        if c is None or c.shrink is None or c.expected_shrink is None:
            continue
        low, high = c.expected_interval or (c.expected_shrink, c.expected_shrink)
        axes.plot([low, high], [c.shrink, c.shrink], color="#90cdf4", lw=0.8, zorder=1)
        axes.scatter(c.expected_shrink, c.shrink, s=9, color=_COLOURS[0] if o.match.right else _COLOURS[1], zorder=2)
    axes.set(xlim=(-0.05, 1.02), ylim=(-0.05, 1.02), xlabel="expected shrink", ylabel="achieved shrink")
    return _svg(figure)


def confusion_plot(summary: Summary) -> str:
    """Rows: the one planted effect; columns: what was named instead, or nothing."""
    rows, columns, counts = confusion(summary)
    if not rows:
        return ""
    figure, axes = _figure(0.32 * len(columns) + 2.4, 0.27 * len(rows) + 2.0)
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for i, j in zip(*np.nonzero(counts), strict=True):
        axes.text(j, i, f"{counts[i, j]:.0f}", ha="center", va="center", fontsize=7,
                  color="white" if share[i, j] > 0.6 else "#1a202c")  # fmt: skip
    axes.set_xticks(range(len(columns)), columns, rotation=60, ha="right", fontsize=7)
    axes.set_yticks(range(len(rows)), rows, fontsize=7)
    return _svg(figure)


def confusion(summary: Summary) -> tuple[list[str], list[str], np.ndarray]:
    """(planted names, named names, counts (rows, columns)) over cases with one planted effect to find."""
    pairs: list[tuple[str, str]] = []
    for o in summary.outcomes:
        if len(o.answer.effects) != 1 or o.answer.withheld:
            continue
        true = o.answer.effects[0].effect
        if o.claim is None:
            pairs.append((true, "(failed)"))
        elif o.match.right:
            pairs.append((true, true))
        else:
            extra = [effect for effect, _ in o.claim.named if effect != true]
            pairs += [(true, effect) for effect in extra or [f"({o.claim.verdict})"]]
    rows = sorted({a for a, _ in pairs})
    columns = rows + sorted({b for _, b in pairs} - set(rows))
    counts = np.zeros((len(rows), len(columns)))
    for a, b in pairs:
        counts[rows.index(a), columns.index(b)] += 1
    return rows, columns, counts


def _figure(width: float, height: float) -> tuple[Figure, Axes]:
    from matplotlib.figure import Figure as MatplotlibFigure

    figure = MatplotlibFigure(figsize=(width, height), layout="constrained")
    axes = figure.subplots()
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _svg(figure: Figure) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None})
    # the XML prologue has no place inside a page, and the metadata name hosts for nothing
    return re.sub(r"^.*?(?=<svg)|<metadata>.*?</metadata>", "", text.getvalue(), flags=re.S)
