"""How large the gap is: before, after, and what the sensor noise alone would leave."""

import numpy as np

from residual_mpc.report.evidence import Evidence
from residual_mpc.report.figures.windows import spread
from residual_mpc.report.section import Document, Section, render

FEW = 8  # windows, below which their spread says nothing


def gap(document: Document, evidence: Evidence) -> Section:
    """Always there: the bars, the channels, the promise beside what was kept, and the spread over windows."""
    figures = document["gap"]
    shrink = document.get("shrink")
    bars = [("before", "Model as it is", figures["before"])]
    if figures.get("nominal") is not None:
        bars = [("nominal", "Model as it was given", figures["nominal"]),
                ("before", "The same, retuned", figures["before"])]  # fmt: skip
    if document["explanation"]:
        bars.append(("after", "With the named effects", figures["after"]))
    bars.append(("floor", "Sensor noise alone", figures["noise_floor"]))
    body = render(
        "sections/gap.html.jinja",
        bars=bars,
        largest=max(value for _, _, value in bars) or 1.0,
        horizon=figures["horizon"],
        shrink=shrink,
        promise=_promise(shrink) if shrink else None,
        explained=bool(document["explanation"]),
        channels=sorted(evidence.channels, key=lambda channel: -channel.before),
        still=evidence.still,
        held_out=document["held_out"],
        figure=_spread(document, evidence),
    )
    return Section("gap", "How large the gap is", body)


def _promise(shrink: Document) -> dict[str, object]:
    """The expected and the achieved shrink on one axis, in per cent of its width."""
    ends = [*shrink["expected_ci95"], *shrink["ci95"], shrink["expected"], shrink["value"]]
    low, high = min(0.0, *ends), max(1.0, *ends)
    place = {key: [100 * (x - low) / (high - low) for x in values] for key, values in {
        "expected": [*shrink["expected_ci95"], shrink["expected"]],
        "value": [*shrink["ci95"], shrink["value"]],
    }.items()}  # fmt: skip
    kept = shrink["expected_ci95"][0] <= shrink["value"] <= shrink["expected_ci95"][1]
    return {"place": place, "kept": kept, "above": shrink["value"] > shrink["expected"]}


def _spread(document: Document, evidence: Evidence) -> object:
    held_out = [(w.before[w.held_out], w.after[w.held_out]) for w in evidence.windows]
    if not held_out:
        return None
    before, after = (np.concatenate(parts) for parts in zip(*held_out, strict=True))
    counted = np.isfinite(before) & np.isfinite(after)
    if counted.sum() < FEW:
        return None
    shown = after[counted] if document["explanation"] else None
    return spread(before[counted], shown, document["gap"]["noise_floor"], "spread")
