"""A made-up comparison for each verdict. None of the numbers was measured."""

from typing import Any

from residual_mpc.effects.library import BY_NAME

VERDICTS = ("same", "changed", "partial", "unknown")


def number(
    before: float | None, after: float, value: float, half: float, unit: str = "1", **more: Any
) -> dict[str, Any]:
    """A number of a change with an interval of +-half."""
    size = {"value": value, "ci95": [value - half, value + half], "unit": unit}
    return {"before": before, "after": after, "change": size, **more}


def change(effect: str, target: str | None = None, probability: float = 0.97, **numbers: Any) -> dict[str, Any]:
    return {
        "effect": effect, "target": target, "probability": probability, "parameters": numbers, "p": 1e-5,
        "summary": BY_NAME[effect].summary if effect in BY_NAME else "", "only_target": None,
    }  # fmt: skip


TRACK = {
    **change("track_width", scale=number(1.06, 1.166, 1.1, 0.007)),
    "predicts": {"gain": 0.004, "error": 0.001, "better": 0.94},
}
DELAY = change("command_delay", delay=number(0.071, 0.116, 0.045, 0.019, "s", note="at the bound of its search range"))
GAIN = change("actuator_gain", "left", 0.31, gain=number(1.0, 0.9, 0.9, 0.02))
LIMIT = change("saturation", limit=number(None, 4.97, 4.97, 0.13, "rad/s"))


def document(verdict: str) -> dict[str, Any]:
    """comparison.json as the contract's section 8 has it, with what the program adds."""
    changes = {"same": [], "unknown": [], "changed": [TRACK, DELAY], "partial": [GAIN, LIMIT]}[verdict]
    after = {"same": 0.034, "changed": 0.106, "partial": 0.09, "unknown": 0.12}[verdict]
    explained = {"same": after, "changed": 0.035, "partial": 0.06, "unknown": after}[verdict]
    gap = {"before": 0.033, "after": after, "after_explained": explained, "noise_floor": 0.03}
    slow = "no command above 4 rad/s"
    others = [("actuator_lag", None, 0.2), ("dead_zone", "left", 0.001)]
    return {
        "schema": "residual-mpc/comparison/1",
        "robot": "rover",
        "verdict": verdict,
        "changes": changes,
        "confounded": [[_term("actuator_gain", "left"), [_term("wheel_radius"), _term("track_width")]]]
        if verdict == "partial"
        else [],
        "candidates": [{**_term(e, t), "probability": p, "p": 0.01} for e, t, p in others]
        + [{**_term(c["effect"], c["target"]), "probability": c["probability"], "p": c["p"]} for c in changes],
        "gap": {
            **gap, "horizon": 1.0, "nominal": {"before": 0.09, "after": 0.17}, "windows": {"before": 9, "after": 1},
            "folds": 4,
            "channels": {"pose.theta": gap, "pose.x": gap},
        },
        "unexplained": {"share": 0.02 if changes else 0.0, "p": 0.001 if verdict == "partial" else 0.4},
        "not_testable": [{**_term("saturation", side), "why": slow} for side in ("left", "right")],
        "visible": [
            {**_term("command_delay"), "parameters": {"delay": {"change": 0.012, "unit": "s"}}},
            {**_term("actuator_gain", "left"), "parameters": {"gain": {"change": 0.03, "unit": "1"}}},
        ],
        "account": [_term("track_width"), _term("actuator_lag")] if verdict != "unknown" else [],
        "stretches": {"before": 9, "after": 8},
        "next_experiment": {"what": "drive spins", "commands": None} if verdict == "partial" else None,
        "notes": [],
        "audit": [],
        "command": "residual-mpc compare --robot rover.toml --before before --after after --out out",
        "runs": {"before": ["run1", "run2", "run3"], "after": ["run1", "run2", "run3"]},
    }  # fmt: skip


def _term(effect: str, target: str | None = None) -> dict[str, Any]:
    return {"effect": effect, "target": target}
