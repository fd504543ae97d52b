"""What the robot did and what the model predicts: held-out data as drawings, every run for the page's script."""

import base64
import json
from typing import Any

import numpy as np

from residual_mpc.report.evidence.channel_units import channel_unit
from residual_mpc.report.evidence.clock import first_stamp, since_start
from residual_mpc.report.evidence.evidence import Array, Evidence
from residual_mpc.report.evidence.run_traces import RunTraces, Signals
from residual_mpc.report.figures import traces as figures
from residual_mpc.report.sections.section import Document, Section, render
from residual_mpc.report.words.numbers import number, spelled

STEPS = 32767  # of 16 bits to both sides of zero; the step below stands for a missing sample


def traces(document: Document, evidence: Evidence) -> Section | None:
    """There where the evidence holds signals. Without scripts it is drawings of held-out windows."""
    if not evidence.panels:
        return None
    panels = [
        {
            "panel": panel,
            "from": since_start(evidence, panel.run, panel.t[0]),
            "to": since_start(evidence, panel.run, panel.t[-1]),
            "svg": figures.traces(panel, f"trace{index}", first_stamp(evidence, panel.run)),
            "before": figures.rms_error(panel, panel.before),
            "after": figures.rms_error(panel, panel.after),
        }
        for index, panel in enumerate(evidence.panels)
    ]
    explained = bool(document["explanation"])
    runs = [_run(run, evidence) for run in evidence.traces]
    windows = int(np.isfinite(evidence.windows.before).sum())
    body = render(
        "sections/traces.html.jinja", panels=panels, horizon=document["gap"]["horizon"], explained=explained,
        data=_script_data({"explained": explained, "runs": runs}) if runs else None,
        left_out=max(0, windows - sum(len(run.first) for run in evidence.traces)),
    )  # fmt: skip
    return Section("traces", "Measured and predicted motion", body, "traces.js" if runs else "")


def _script_data(content: dict[str, Any]) -> object:
    """JSON that cannot end its element."""
    from markupsafe import Markup

    return Markup(json.dumps(content, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"))


def _run(run: RunTraces, evidence: Evidence) -> dict[str, Any]:
    last = [*run.first[1:], len(run.t)]
    gaps = zip(run.before, run.after, run.held_out, strict=True)
    labels = [
        f"{number(run.t[a], 4)} to {number(run.t[b - 1], 4)} s, gap {_before_after(before, after)}"
        + (", held out" if held else "")
        for a, b, (before, after, held) in zip(run.first, last, gaps, strict=True)
    ]
    shown = run.held_out if run.held_out.any() else np.ones(len(run.first), dtype=bool)
    mean = [float(np.sqrt(np.mean(g**2))) for g in (run.before, run.after)]
    return {
        "name": run.run,
        "label": f"{run.run}, gap {_before_after(*mean)}",
        "t": _bytes(run.t.astype("<f4")),
        "first": run.first.tolist(),
        "gaps": [[_digits(b), _digits(a)] for b, a in zip(run.before, run.after, strict=True)],
        "labels": labels,
        "opens": int(np.argmax(np.where(shown, run.before, -np.inf))),
        "channels": [_channel(signals, evidence) for signals in run.signals],
    }


def _before_after(before: float, after: float) -> str:
    """ "0.21 → 0.03", or the first alone."""
    return number(before, 2) + (f" \N{RIGHTWARDS ARROW} {number(after, 2)}" if np.isfinite(after) else "")


def _channel(signals: Signals, evidence: Evidence) -> dict[str, Any]:
    """The three signals in 16 bits between the ends of the measured one and as much again on both sides."""
    seen = signals.measured[np.isfinite(signals.measured)]
    low, high = (float(seen.min()), float(seen.max())) if len(seen) else (0.0, 1.0)
    room = 2.5 * (high - low) or 1.0
    ends = (low - room, high + room)
    name = signals.channel
    return {
        "channel": name,
        "unit": spelled(channel_unit(name, evidence.sliding)),
        "low": ends[0],
        "high": ends[1],
        "values": [_packed(x, *ends) for x in (signals.measured, signals.before, signals.after)],
    }


def _packed(x: Array, low: float, high: float) -> str | None:
    """None for a signal without samples; what lies beyond the ends stays at them."""
    there = np.isfinite(x)
    if not there.any():
        return None
    steps = np.round((np.clip(np.where(there, x, low), low, high) - low) / (high - low) * 2 * STEPS) - STEPS
    return _bytes(np.where(there, steps, -STEPS - 1).astype("<i2"))


def _bytes(x: np.ndarray) -> str:
    return base64.b64encode(x.tobytes()).decode()


def _digits(x: float) -> float | None:
    return float(f"{x:.4g}") if np.isfinite(x) else None
