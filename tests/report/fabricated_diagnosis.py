"""A made-up diagnosis for each verdict, and evidence to go with it. None of the numbers was measured."""

from typing import Any

import numpy as np

from residual_mpc.report import Evidence, Panel, Windows

HORIZON = 1.0  # s


def document(verdict: str) -> dict[str, Any]:
    """diagnosis.json as the contract's section 5 has it."""
    return {"no_gap": _no_gap, "effects": _effects, "partial": _partial, "unknown": _unknown}[verdict]()


def evidence(verdict: str, seed: int = 0) -> Evidence:
    """Three channels over four windows of a held-out run, and the gaps of three runs."""
    rng = np.random.default_rng(seed)
    explained = verdict in ("effects", "partial")
    late = 0.0 if verdict == "no_gap" else 0.12
    channels = [("pose.theta", "rad"), ("pose.x", "m"), ("velocity.left", "rad/s")]
    panels = tuple(_panel(channel, unit, late, explained, rng) for channel, unit in channels)
    return Evidence(panels, _windows(late, explained, rng))


def _panel(channel: str, unit: str, late: float, explained: bool, rng: np.random.Generator) -> Panel:
    t = 12.0 + np.arange(0.0, 4.0, 0.02)
    truth = np.sin(1.7 * t) + 0.3 * np.sin(5.1 * t)
    measured = truth + 0.01 * rng.standard_normal(t.size)
    before = np.sin(1.7 * (t + late)) + 0.3 * np.sin(5.1 * (t + late))
    after = truth + 0.02 * np.sin(3 * t) if explained else np.full(t.size, np.nan)
    before, after = before.copy(), after.copy()
    edges = np.searchsorted(t, [13.0, 14.0, 15.0])
    for signal in (measured, before, after):
        signal[edges] = np.nan
    measured[1::2] = np.nan  # a sensor at half the rate of the log
    return Panel("run3", channel, unit, t, measured, before, after)


def _windows(late: float, explained: bool, rng: np.random.Generator) -> Windows:
    counts = {"run1": 29, "run2": 38, "run3": 47}
    start = np.concatenate([0.5 + HORIZON * np.arange(count) for count in counts.values()])
    before = (0.02 + 1.6 * late * (0.4 + np.abs(np.sin(0.25 * start)))) * rng.uniform(0.8, 1.2, start.size)
    before[15] = np.nan
    after = 0.02 + 0.1 * before if explained else np.full(start.size, np.nan)
    return Windows([run for run, count in counts.items() for _ in range(count)], start, before, after)


def _channels(before: float, after: float) -> dict[str, Any]:
    return {
        "pose.theta": {"before": 1.2 * before, "after": 1.2 * after, "noise_floor": 0.021},
        "pose.x": {"before": 0.7 * before, "after": 0.6 * after, "noise_floor": 0.018},
    }


def _horizon(horizon: float, before: float, after: float, windows: int, held_out: bool = True) -> dict[str, Any]:
    return {
        "horizon": horizon,
        "nominal": before,
        "before": before,
        "after": after,
        "noise_floor": 0.02,
        "windows": windows,
        "held_out": held_out,
        "channels": _channels(before, after),
        "window_gaps": {
            "before": {"p50": 0.8 * before, "p90": 1.4 * before, "max": 2.5 * before},
            "after": {"p50": 0.2 * after, "p90": 0.9 * after, "max": 9.0 * after},
        },
    }


def _base() -> dict[str, Any]:
    return {
        "schema": "residual-mpc/diagnosis/1",
        "robot": "rover",
        "held_out": ["run3"],
        "shrink": None,
        "where": {"stages": [], "channels": [], "regimes": [], "times": []},
        "explanation": [],
        "candidates": [],
        "confounded": [],
        "not_testable": [
            {"effect": "saturation", "target": "left", "why": "no command above 4 rad/s"},
            {"effect": "saturation", "target": "right", "why": "no command above 4 rad/s"},
            {"effect": "lateral_slip", "target": None, "why": "the robot drove straight lines alone"},
        ],
        "moved": [],
        "next_experiment": None,
    }


def _where() -> dict[str, Any]:
    return {
        "stages": [
            {"name": "command", "share": 0.84},
            {"name": "actuator", "share": 0.09},
            {"name": "contact", "share": 0.05},
            {"name": "sensor", "share": 0.02},
        ],
        "channels": [{"name": "pose.theta", "share": 0.7}, {"name": "pose.x", "share": 0.3}],
        "regimes": [
            {"name": "command reversal", "share": 0.6, "lift": 3.1},
            {"name": "high acceleration", "share": 0.31, "lift": 1.8},
            {"name": "standstill", "share": 0.01, "lift": 0.1},
        ],
        "times": [
            {"run": "run1", "from": 5.5, "to": 8.5, "share": 0.12},
            {"run": "run3", "from": 17.5, "to": 20.5, "share": 0.08},
        ],
    }


def _candidates() -> list[dict[str, Any]]:
    names = [
        ("command_delay", 0.97, 0.86),
        ("actuator_lag", 0.21, 0.61),
        ("dead_zone", 0.06, 0.08),
        ("wheel_radius", 0.03, 0.02),
        ("slope", 0.01, 0.0),
    ]
    return [{"effect": e, "target": None, "probability": p, "shrink": s} for e, p, s in names]


def _effects() -> dict[str, Any]:
    return _base() | {
        "verdict": "effects",
        "gap": {
            "before": 0.21,
            "after": 0.03,
            "noise_floor": 0.02,
            "horizon": HORIZON,
            "nominal": 0.21,
            "windows": 47,
            "skipped": 1,
            "still": ["pose.y"],
            "channels": _channels(0.21, 0.03),
            "constant_velocity": 0.38,
            "horizons": [
                _horizon(HORIZON, 0.21, 0.03, 47),
                _horizon(5.0, 0.12, 0.034, 9),
                _horizon(30.0, 0.09, 0.031, 3, held_out=False),
            ],
        },
        "shrink": {"expected": 0.85, "expected_ci95": [0.80, 0.90], "value": 0.86, "ci95": [0.83, 0.89]},
        "where": _where(),
        "explanation": [
            {
                "effect": "command_delay",
                "target": None,
                "probability": 0.97,
                "parameters": {"delay": {"value": 0.081, "ci95": [0.078, 0.084], "unit": "s"}},
                "evidence": ["fits", "predicts", "survives"],
                "note": "at the bound of its search range",
            }
        ],
        "candidates": _candidates(),
        "confounded": [[{"effect": "command_delay", "target": None}, {"effect": "sensor_delay", "target": None}]],
        "unexplained": {"share": 0.012, "learned_residual_shrink": 0.01},
        "next_experiment": {
            "parts": ["command_delay", "sensor_delay"],
            "what": "log the wheel encoders",
            "commands": None,
        },
    }


def _partial() -> dict[str, Any]:
    return _base() | {
        "verdict": "partial",
        "robot": "arm <6> & gripper",
        "held_out": [{"run": "run3", "from": 0.5, "to": 20.5}],
        "stages_of_gap": [
            {"terms": [], "gap": 0.66},
            {"terms": [{"effect": "coulomb_friction", "target": "elbow"}], "gap": 0.52},
            {
                "terms": [
                    {"effect": "coulomb_friction", "target": "elbow"},
                    {"effect": "backlash", "target": "shoulder_lift"},
                ],
                "gap": 0.41,
            },
        ],
        "rivals": [
            {
                "terms": [
                    {"effect": "stribeck_friction", "target": "elbow"},
                    {"effect": "backlash", "target": "shoulder_lift"},
                ],
                "probability": 0.06,
            }
        ],
        "learned": {"by": "network", "asked": ["ridge", "network"]},
        "audit": [
            {
                "severity": "info",
                "kind": "offset in time",
                "run": "",
                "column": "",
                "row": None,
                "message": "the pose answers the commands 80 ms late.",
                "remedy": "",
            },
            {
                "severity": "warning",
                "kind": "gap in time",
                "run": "run2",
                "column": "position.elbow",
                "row": 601,
                "message": "0.4 s without a sample at t = 12.1 s.",
                "remedy": "Nothing to do: windows that touch it are skipped.",
            },
        ],
        "fit": {"runs": ["run1", "run2"], "windows": 67},
        "notes": ["No velocity was logged: friction and play are told apart by positions alone."],
        "outliers": {"share": 0.004, "channels": {"position.elbow": 0.012}},
        "seconds": 41.2,
        "command": "residual-mpc diagnose --robot arm.toml logs",
        "gap": {"nominal": 0.9, "before": 0.66, "after": 0.41, "noise_floor": 0.02, "horizon": HORIZON}
        | {"constant_velocity": 0.38},
        "shrink": {"expected": 0.52, "expected_ci95": [0.45, 0.60], "value": 0.38, "ci95": [0.30, 0.44]},
        "where": _where(),
        "explanation": [
            {
                "effect": "coulomb_friction",
                "target": "elbow",
                "probability": 0.93,
                "parameters": {"torque": {"value": 0.0131, "ci95": [0.0122, 0.0140], "unit": "N m"}},
            },
            {
                "effect": "backlash",
                "target": "shoulder_lift",
                "probability": 0.88,
                "parameters": {"gap": {"value": 0.021, "ci95": [0.018, 0.024], "unit": "rad"}},
            },
            {
                "effect": "actuator_gain",
                "target": "wrist",
                "probability": 0.31,
                "since": {"run": "run1", "t": 31.5},
                "by_run": {"run1": 0.62, "run2": 0.66},
                "parameters": {"gain": {"value": 0.62, "ci95": [0.58, 0.66], "unit": "1"}},
            },
            {
                "effect": "sensor_bias",
                "target": "position.elbow",
                "probability": 0.77,
                "parameters": {"bias": {"value": -0.07, "ci95": [-0.09, -0.05], "unit": "rad"}},
            },
        ],
        "candidates": _candidates() * 3,
        "confounded": [
            [
                {"effect": "coulomb_friction", "target": "elbow"},
                [
                    {"effect": "backlash", "target": "elbow"},
                    {"effect": "stribeck_friction", "target": "elbow"},
                ],
            ]
        ],
        "moved": [{"parameter": "joint.elbow.damping", "from": 0.05, "to": 0.002}],
        "unexplained": {"share": 0.38, "learned_residual_shrink": 0.22},
        "remainder": _remainder([]),
    }


def _depends(on: str, kind: str, of: str | None, form: str, repeats: int | None) -> dict[str, Any]:
    x = [k * 6.28 / 8 / (repeats or 1) for k in range(8)]
    return {
        "on": on,
        "kind": kind,
        "of": of,
        "form": form,
        "share": 0.62,
        "by_chance": 0.04,
        "alike": [] if repeats else ["the accumulated motor activity in the run"],
        "curve": {
            "component": "position.elbow",
            "x": x,
            "y": [0.5, 1.2, 0.4, -0.1, -0.6, -1.1, -0.5, 0.1],
            "se": [0.1] * 8,
            "x_unit": "rad" if repeats else "s",
            "y_unit": "rad/s^2",
            "repeats": repeats,
        },
    }


def _remainder(depends: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "components": [
            {"name": "position.elbow", "share": 0.9, "rate": 0.4, "unit": "rad/s^2"},
            {"name": "position.wrist", "share": 0.1, "rate": 0.03, "unit": "rad/s^2"},
        ],
        "regimes": [{"name": "slow", "share": 0.5, "lift": 2.1}, {"name": "fast", "share": 0.1, "lift": 0.4}],
        "times": [],
        "half_within": 0.12,
        "depends_on": depends,
        "resembles": {"effect": "viscous_friction", "target": "elbow", "closes": 0.31},
    }


def _unknown() -> dict[str, Any]:
    return _base() | {
        "verdict": "unknown",
        "gap": {"before": 0.21, "after": 0.21, "noise_floor": 0.02, "horizon": HORIZON},
        "where": _where(),
        "candidates": [c | {"probability": 0.1 * c["probability"], "shrink": 0.0} for c in _candidates()],
        "unexplained": {"share": 1.0, "learned_residual_shrink": 0.55},
        "remainder": _remainder(
            [
                _depends("the angle of elbow", "angle", "elbow", "added", 12),
                _depends("the time in the run", "time", None, "direction", None),
            ]
        ),
        "next_experiment": {
            "parts": [],
            "what": "drive slow circles both ways, with the wheel encoders logged",
            "commands": None,
            "sensors": ["velocity.left", "velocity.right"],
            "excite": "residual-mpc excite out/diagnosis.json --robot arm.toml --out out/next.csv",
        },
    }


def _no_gap() -> dict[str, Any]:
    return _base() | {
        "verdict": "no_gap",
        "gap": {"before": 0.021, "after": 0.021, "noise_floor": 0.02, "horizon": HORIZON},
        "unexplained": {"share": 0.0, "learned_residual_shrink": None},
    }
