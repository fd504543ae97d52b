"""The map of where the gap lies: along the chain, by channel, by regime, and in time."""

import numpy as np

from residual_mpc.report.evidence import Evidence, WindowGaps
from residual_mpc.report.section import Document, Section, render
from residual_mpc.report.words.effects import STAGES

RUNS = 24  # strips shown; runs with the largest gap come first
BINS = 160  # pieces of a strip; more windows than this are pooled
MOMENTS = 8  # moments listed; the document holds them all


def where(document: Document, evidence: Evidence) -> Section | None:
    """There unless there is no gap, or the document does not place it."""
    places = document.get("where") or {}
    if document["verdict"] == "no_gap" or not any(places.values()):
        return None
    shares = {stage["name"]: stage["share"] for stage in places.get("stages", [])}
    chain = [(name, shares.pop(name, None)) for name in STAGES]
    times = places.get("times", [])
    gaps = [g for window in evidence.windows for g in window.before[np.isfinite(window.before)]]
    dark = float(np.quantile(gaps, 0.98)) if gaps else 0.0
    runs = sorted(evidence.windows, key=lambda window: -_mean(window))
    body = render(
        "sections/where.html.jinja",
        chain=chain if any(share for _, share in chain) else [],
        other_stages=sorted(shares.items(), key=lambda pair: -pair[1]),
        largest=max((share or 0.0 for _, share in chain), default=0.0),
        channels=places.get("channels", []),
        regimes=places.get("regimes", []),
        moments=sorted(times, key=lambda time: -time["share"])[:MOMENTS],
        strips=[_strip(window, evidence.horizon, dark, times) for window in runs[:RUNS]] if dark else [],
        longest=max((float(w.start[-1] - w.start[0]) + evidence.horizon for w in runs[:RUNS]), default=1.0),
        left_out=max(0, len(runs) - RUNS),
        dark=dark,
    )
    return Section("where", "Where the gap lies", body)


def _strip(window: WindowGaps, horizon: float, dark: float, times: list[Document]) -> dict[str, object]:
    """A run as rectangles: (start, width) in seconds from its first window, and depth of colour from 0 to 1."""
    origin, step = float(window.start[0]), max(1, -(-window.start.size // BINS))
    pieces = []
    for first in range(0, window.start.size, step):
        part = slice(first, first + step)
        gaps = window.before[part]
        level = float(np.sqrt(np.nanmean(gaps**2))) / dark if np.isfinite(gaps).any() else None
        start, last = float(window.start[part][0]), float(window.start[part][-1])
        pieces.append({
            "x": start - origin, "width": last - start + horizon,
            "level": None if level is None else min(1.0, level), "held_out": bool(window.held_out[part].any()),
        })  # fmt: skip
    marks = [(t["from"] - origin, t["to"] - t["from"]) for t in times if t["run"] == window.run]
    end = float(window.start[-1])
    return {"run": window.run, "pieces": pieces, "marks": marks, "origin": origin, "mean": _mean(window),
            "worst": float(window.start[np.nanargmax(window.before)]) if np.isfinite(window.before).any() else origin,
            "length": end - origin + horizon}  # fmt: skip


def _mean(window: WindowGaps) -> float:
    """Root mean square of the run's window gaps; 0 where all were skipped."""
    seen = window.before[np.isfinite(window.before)]
    return float(np.sqrt(np.mean(seen**2))) if seen.size else 0.0
