"""The page's plots, as SVG text that stands inside the page."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from residual_mpc.blind.score.confusion import Confusion
from residual_mpc.blind.score.summary import Summary

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = ("#2b6cb0", "#c05621", "#718096", "#2f855a")


def levels_plot(summaries: Sequence[Summary]) -> str:
    """Right answers by level, with 95 % intervals, a bar a method; the line across a bar: exact sets."""
    figure, axes = _figure(7.5, 3.2)
    names = list(summaries[0].by_level)
    width = 0.8 / len(summaries)
    for i, summary in enumerate(summaries):
        at = np.arange(len(names)) + (i - (len(summaries) - 1) / 2) * width
        rates = [summary.by_level[name] for name in names]
        values = np.array([r.value or 0.0 for r in rates])
        ends = np.array([r.ci95 or (0.0, 0.0) for r in rates]).T
        exact = [summary.strict.by_level[name].exact.value or 0.0 for name in names]
        axes.bar(at, values, width * 0.92, color=_COLOURS[i % 4], label=summary.method)
        axes.errorbar(at, values, np.abs(ends - values), fmt="none", ecolor="#1a202c", capsize=2, lw=0.9)
        last = "exact set (strict)" if i == len(summaries) - 1 else ""
        axes.hlines(exact, at - 0.46 * width, at + 0.46 * width, color="#1a202c", lw=2.2, label=last, zorder=3)
    axes.set_xticks(range(len(names)), [n.replace("_", " ") for n in names])
    axes.set_ylim(0, 1.02)
    axes.set_ylabel("share of right answers")
    axes.legend(frameon=False, ncols=2, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1.0))
    return _svg(figure)


def reliability_plot(summary: Summary) -> str:
    """Stated probability against how often it was true; the area of a dot is the number of candidates."""
    figure, axes = _figure(3.6, 3.4)
    axes.plot([0, 1], [0, 1], color="#a0aec0", lw=1, zorder=0)
    strict = summary.strict.every.named_bins
    for bins, colour, label in (
        (summary.bins, _COLOURS[0], "all candidates"),
        (strict, _COLOURS[1], "named effects, strict"),
    ):
        at, seen = [b.stated for b in bins], [b.seen for b in bins]
        axes.scatter(at, seen, s=[12 + 4 * b.count**0.6 for b in bins], color=colour, alpha=0.85, label=label)
        for b in bins:
            axes.annotate(
                str(b.count), (b.stated, b.seen), textcoords="offset points", xytext=(6, -8), fontsize=7, color=colour
            )
    axes.legend(frameon=False, fontsize=7, loc="upper left", markerscale=0.7)
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


def confusion_plot(found: Confusion) -> str:
    """Rows: what was planted; columns: what was named. The shade is the share of the row; the frame, right."""
    if not found.rows:
        return ""
    rows, columns, counts = found.rows, found.columns, found.counts
    figure, axes = _figure(0.32 * len(columns) + 2.6, 0.25 * len(rows) + 2.2)
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for i, j in zip(*np.nonzero(counts), strict=True):
        axes.text(j, i, f"{counts[i, j]:.0f}", ha="center", va="center", fontsize=7,
                  color="white" if share[i, j] > 0.6 else "#1a202c")  # fmt: skip
    for i, row in enumerate(rows):
        if row in columns:
            j = columns.index(row)
            axes.plot(np.array([j, j + 1, j + 1, j, j]) - 0.5, np.array([i, i, i + 1, i + 1, i]) - 0.5,
                      color=_COLOURS[3], lw=1.1, clip_on=False)  # fmt: skip
    axes.set_xticks(range(len(columns)), [_words(c) for c in columns], rotation=60, ha="right", fontsize=7)
    axes.set_yticks(range(len(rows)), [_words(r) for r in rows], fontsize=7)
    axes.set(xlabel="named", ylabel="planted")
    axes.set_xticks(np.arange(len(columns) + 1) - 0.5, minor=True)
    axes.set_yticks(np.arange(len(rows) + 1) - 0.5, minor=True)
    axes.grid(which="minor", color="#e2e8f0", lw=0.5)
    axes.tick_params(which="minor", length=0)
    return _svg(figure)


def _words(name: str) -> str:
    return name.replace("_", " ")


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
