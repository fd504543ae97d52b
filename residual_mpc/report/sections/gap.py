"""How large the gap is: before, after, and what the sensor noise alone would leave."""

import numpy as np

from residual_mpc.report.evidence import Evidence
from residual_mpc.report.figures.windows import spread
from residual_mpc.report.held_out import held_out
from residual_mpc.report.section import Document, Section, render

FEW = 8  # windows, below which their spread says nothing


def gap(document: Document, evidence: Evidence) -> Section:
    """Always there: the bars, the steps, the promise beside what was kept, the channels and the windows."""
    figures, shrink = document["gap"], document.get("shrink")
    bars = _bars(document)
    channels = [{"name": name, **values} for name, values in (figures.get("channels") or {}).items()]
    steps = document.get("stages_of_gap") or []
    body = render(
        "sections/gap.html.jinja",
        bars=bars,
        largest=max(value for _, _, value in bars) or 1.0,
        gap=figures,
        steps=steps if len(steps) > 2 else [],  # before and after alone are the bars above
        step_largest=max((step["gap"] for step in steps), default=0.0) or 1.0,
        shrink=shrink,
        promise=_promise(shrink),
        explained=bool(document["explanation"]),
        channels=sorted(channels, key=lambda channel: -channel["before"]),
        held_out=document["held_out"],
        fit=document.get("fit") or {},
        figure=_spread(document, evidence),
    )
    return Section("gap", "How large the gap is", body)


def _bars(document: Document) -> list[tuple[str, str, float]]:
    """(kind, label, gap) from the largest to the least, as the story goes."""
    figures = document["gap"]
    nominal = figures.get("nominal")
    bars = [("before", "Model as it is", figures["before"])]
    if nominal is not None and not np.isclose(nominal, figures["before"]):
        bars = [
            ("nominal", "Model as it was given", nominal),
            ("before", "The same, retuned", figures["before"]),
        ]
    if document["explanation"]:
        bars.append(("after", "With the named effects", figures["after"]))
    return [*bars, ("floor", "Sensor noise alone", figures["noise_floor"])]


def _promise(shrink: Document | None) -> dict[str, object] | None:
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
    kept = shrink["expected_ci95"][0] <= shrink["value"] <= shrink["expected_ci95"][1]
    return {"place": place, "low": low, "kept": kept, "above": shrink["value"] > shrink["expected"]}


def _spread(document: Document, evidence: Evidence) -> object:
    windows = evidence.windows
    counted = held_out(document, windows) & np.isfinite(windows.before)
    if counted.sum() < FEW:
        return None
    explained = bool(document["explanation"]) and bool(np.isfinite(windows.after[counted]).all())
    after = windows.after[counted] if explained else None
    return spread(windows.before[counted], after, document["gap"]["noise_floor"], "spread")
