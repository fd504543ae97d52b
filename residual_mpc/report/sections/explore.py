"""Sliders for the parameters of the named effects: what the model would predict with other values of them."""

import json
from typing import Any

import numpy as np

from residual_mpc.report.evidence.channel_units import channel_unit
from residual_mpc.report.evidence.clock import since_start
from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.evidence.explore import Exploration, Slider
from residual_mpc.report.sections.section import Document, Section, render
from residual_mpc.report.words.effects import name_at
from residual_mpc.report.words.numbers import measure_each, number, spelled

DIGITS = 5  # of a drawn value


def explore(document: Document, evidence: Evidence) -> Section | None:
    """There where replays with other values were made. Without scripts it is a table."""
    found = evidence.exploration
    if found is None or not found.views:
        return None
    from markupsafe import Markup

    sliders = [_slider(k, s, found) for k, s in enumerate(found.sliders)]
    data = json.dumps(_drawn(found, evidence, sliders), separators=(",", ":"), allow_nan=False)
    body = render(
        "sections/explore.html.jinja", sliders=sliders, judged=found.judged,
        data=Markup(data.replace("<", "\\u003c")), horizon=document["gap"]["horizon"],
    )  # fmt: skip
    return Section("explore", "What other values would predict", body, "explore.js")


def _slider(index: int, s: Slider, found: Exploration) -> dict[str, Any]:
    effect = {"effect": s.term.effect, "target": s.term.target}
    low, high = s.estimate.ci95
    more = sum(o.term == s.term for o in found.sliders) > 1
    return {
        "index": index,
        "name": name_at(effect) + (f", {s.estimate.name.replace('_', ' ')}" if more else ""),
        "labels": measure_each(s.values.tolist(), s.estimate.unit),
        "inside": [bool(low <= v <= high) for v in s.values],
        "gaps": [number(g) for g in s.gaps],
        "fitted": len(s.values) // 2,
    }


def _drawn(found: Exploration, evidence: Evidence, sliders: list[dict[str, Any]]) -> dict[str, Any]:
    views = [
        {
            "name": f"{v.run}, {number(since_start(evidence, v.run, v.start), 4)} s",
            "gaps": [[number(g) for g in row] for row in v.gaps],
            "looks": [
                {
                    "channel": look.channel,
                    "unit": spelled(channel_unit(look.channel, evidence.sliding)),
                    "t": _rounded(look.t),
                    "measured": _rounded(look.measured),
                    "before": _rounded(look.before),
                    "curves": [[_rounded(c) for c in row] for row in look.curves],
                }
                for look in v.looks
            ],
        }
        for v in found.views
    ]
    return {"sliders": sliders, "views": views}


def _rounded(x: np.ndarray) -> list[float | None]:
    """JSON has no NaN."""
    return [float(f"{v:.{DIGITS}g}") if np.isfinite(v) else None for v in x]
