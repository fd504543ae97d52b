"""Compare the diagnosis of changed runs with that of the same runs unchanged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import hypot, isfinite
from pathlib import Path
from typing import Any

from residual_mpc.blind.recorded.case_files import HALVES, write_case
from residual_mpc.blind.recorded.half import Half
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.robot_file import RobotFile

WORSE = 1.5  # ratio of the remaining gaps above which a part of the change counts as unexplained
Document = Mapping[str, Any]
Name = tuple[str, str | None]


def write_beside(folder: Path, robot: RobotFile, untouched: Half, changed: Half) -> None:
    """A case whose `before` holds the untouched runs and whose `after` holds the same runs with the changes."""
    first, second = HALVES
    renamed = [replace(log, name=log.name.replace(f"{second}_", f"{first}_", 1)) for log in untouched.logs]
    write_case(folder, robot, replace(untouched, logs=tuple(renamed)), changed)


def difference(untouched: Document, changed: Document) -> dict[str, Any]:
    """The difference of two diagnoses, as a document of `compare`: an effect has changed if only one of them names it,
    or if the 95 % interval of the change of a parameter excludes no change."""
    was, now = _named(untouched), _named(changed)
    pairs = [(name, was.get(name), now.get(name)) for name in dict.fromkeys([*now, *was])]
    changes = [c for name, a, b in pairs if (c := _change(name, a, b)) is not None]
    left = [float(d["gap"]["after"]) for d in (untouched, changed)]
    more = left[1] > WORSE * left[0]
    verdict = ("partial" if more else "changed") if changes else ("unknown" if more else "same")
    return {
        "verdict": verdict,
        "changes": changes,
        "confounded": list(changed.get("confounded") or ()),
        "gap": {"before": left[0], "after_explained": left[1], "noise_floor": changed["gap"]["noise_floor"]},
    }


def _named(diagnosis: Document) -> dict[Name, Document]:
    return {(str(e["effect"]), e.get("target")): e for e in diagnosis["explanation"]}


def _change(name: Name, was: Document | None, now: Document | None) -> dict[str, Any] | None:
    """The change of one effect; None if the intervals allow that it is the same in both."""
    stated = [e for e in (was, now) if e is not None]
    parameters, differs = {}, len(stated) == 1
    for parameter in stated[-1]["parameters"]:
        figures = _figures(name[0], parameter, was, now)
        if figures is not None:
            parameters[parameter], beyond = figures
            differs = differs or beyond
    if not differs:
        return None
    probability = min(float(e["probability"]) for e in stated)
    return {"effect": name[0], "target": name[1], "probability": probability, "parameters": parameters}


def _figures(
    effect: str, parameter: str, was: Document | None, now: Document | None
) -> tuple[dict[str, Any], bool] | None:
    """The change of one parameter, and whether it exceeds its 95 % interval; None for a parameter without a finite null
    value of an effect that only one diagnosis names, and for a ratio to or from zero."""
    null = BY_NAME[effect].parameter(parameter).null
    (a, da), (b, db) = (_value(e, parameter, null) for e in (was, now))
    if not (isfinite(a) and isfinite(b)) or (null == 1.0 and 0.0 in (a, b)):
        return None
    if null == 1.0:  # gains, scales and radii change by a ratio
        ratio = b / a
        half, change = abs(ratio) * hypot(da / a, db / b), ratio
        beyond = abs(ratio - 1.0) > half
    else:
        half, change = hypot(da, db), b - a
        beyond = abs(change) > half
    return {"before": a, "after": b, "change": {"value": change, "ci95": [change - half, change + half]}}, beyond


def _value(effect: Document | None, parameter: str, null: float) -> tuple[float, float]:
    """(value, half the width of its 95 % interval); (null, 0) without the effect."""
    if effect is None:
        return null, 0.0
    figures = effect["parameters"][parameter]
    interval = figures.get("ci95")
    return float(figures["value"]), 0.5 * (interval[1] - interval[0]) if interval else 0.0
