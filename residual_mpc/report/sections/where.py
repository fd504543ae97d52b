"""The map of where the gap lies: along the chain, by channel, by regime, and in time."""

from functools import partial

import numpy as np

from residual_mpc.effects.effect import STAGES
from residual_mpc.report.evidence.clock import first_stamp, since_start
from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.evidence.held_out import held_out
from residual_mpc.report.figures.strips import strips
from residual_mpc.report.sections.section import Document, Section, render

RUNS = 24  # strips shown; runs with the largest gap come first
MOMENTS = 8  # moments listed; the document holds them all
DARKEST = 0.98  # quantile of the windows' gaps that gets the full colour: one outlier must not pale the rest


def where(document: Document, evidence: Evidence) -> Section | None:
    """There unless there is no gap, or nothing places it."""
    places, windows = document.get("where") or {}, evidence.windows
    gaps = windows.before[np.isfinite(windows.before)]
    if document["verdict"] == "no_gap" or not (any(places.values()) or gaps.size):
        return None
    shares = {stage["name"]: stage["share"] for stage in places.get("stages") or []}
    chain = [(name, shares.pop(name, None)) for name in STAGES]
    times = places.get("times") or []
    dark = float(np.quantile(gaps, DARKEST)) if gaps.size else 0.0
    horizon = document["gap"]["horizon"]
    kept = held_out(document, windows)
    runs = strips(windows, kept, horizon, dark, times, partial(first_stamp, evidence)) if dark > 0 else []
    body = render(
        "sections/where.html.jinja",
        chain=chain if any(share for _, share in chain) else [],
        other_stages=sorted(shares.items(), key=lambda pair: -pair[1]),
        largest=max(share or 0.0 for _, share in chain),
        channels=places.get("channels") or [],
        regimes=places.get("regimes") or [],
        moments=[_moment(time, evidence) for time in sorted(times, key=lambda time: -time["share"])[:MOMENTS]],
        strips=runs[:RUNS],
        longest=max((strip.length for strip in runs[:RUNS]), default=1.0),
        left_out=max(0, len(runs) - RUNS),
        dark=dark,
    )
    return Section("where", "Where the gap lies", body)


def _moment(time: Document, evidence: Evidence) -> Document:
    return {**time, **{end: since_start(evidence, time["run"], time[end]) for end in ("from", "to")}}
