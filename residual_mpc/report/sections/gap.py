"""The size of the gap in detail: by horizon, step by step, by channel and by window."""

import numpy as np

from residual_mpc.report.evidence.clock import since_start
from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.evidence.held_out import held_out
from residual_mpc.report.figures.windows import spread
from residual_mpc.report.sections.horizons import channel_rows, horizon_rows
from residual_mpc.report.sections.section import Document, Section, render
from residual_mpc.report.words.gaps import few_windows, horizons_of, new_readings_line, seen_horizons
from residual_mpc.report.words.numbers import listed, number

FEW = 8  # windows, below which their spread says nothing


def gap(document: Document, evidence: Evidence) -> Section:
    """Always there: the horizons, the steps, expected beside achieved, the channels and the windows."""
    figures, shrink = document["gap"], document.get("shrink")
    explained = bool(document["explanation"])
    rows = horizon_rows(figures, explained)
    steps = document.get("stages_of_gap") or []
    body = render(
        "sections/gap.html.jinja",
        dominated=next((text for row in horizons_of(figures) if (text := few_windows(row, explained))), ""),
        new_readings=new_readings_line(figures, explained),
        rows=rows if len(rows) > 1 or rows[0].quantiles else [],
        seen=listed([f"{number(h)} s" for h in seen_horizons(horizons_of(figures))] or [""]),
        gap=figures,
        steps=steps if len(steps) > 2 else [],  # before and after alone are the bars above
        step_largest=max((step["gap"] for step in steps), default=0.0) or 1.0,
        shrink=shrink,
        ranges=_ranges(shrink),
        explained=explained,
        channels=channel_rows(figures) or rows[0].channels,
        held_out=[_kept_back(part, evidence) for part in document["held_out"]],
        fit=document.get("fit") or {},
        figure=_spread(document, evidence),
    )
    return Section("gap", "Size of the gap", body)


def _ranges(shrink: Document | None) -> dict[str, object] | None:
    """The expected and the achieved shrink on one axis, in per cent of its width; None without both."""
    if not shrink or any(shrink.get(key) is None for key in ("expected", "expected_ci95", "value", "ci95")):
        return None
    rows = {
        "expected": [*shrink["expected_ci95"], shrink["expected"]],
        "value": [*shrink["ci95"], shrink["value"]],
    }
    ends = [end for row in rows.values() for end in row]
    low, high = min(0.0, *ends), max(1.0, *ends)
    place = {key: [100 * (end - low) / (high - low) for end in row] for key, row in rows.items()}
    inside = shrink["expected_ci95"][0] <= shrink["value"] <= shrink["expected_ci95"][1]
    return {"place": place, "low": low, "inside": inside, "above": shrink["value"] > shrink["expected"]}


def _kept_back(part: str | Document, evidence: Evidence) -> Document:
    """A run, or part of one with its times from the run's start."""
    if isinstance(part, str):
        return {"run": part, "from": None, "to": None}
    run = part["run"]
    return {"run": run, **{end: since_start(evidence, run, part[end]) for end in ("from", "to")}}


def _spread(document: Document, evidence: Evidence) -> object:
    windows = evidence.windows
    counted = held_out(document, windows) & np.isfinite(windows.before)
    if counted.sum() < FEW:
        return None
    explained = bool(document["explanation"]) and bool(np.isfinite(windows.after[counted]).all())
    after = windows.after[counted] if explained else None
    return spread(windows.before[counted], after, document["gap"]["noise_floor"], "spread")
