"""The page of what was withheld, from what was kept of a measurement."""

import json
from pathlib import Path
from typing import Any

from click.testing import CliRunner

from benchmarks.withheld import CASES, marks, withheld


def payload(value: float, low: float, high: float, came: float) -> dict[str, Any]:
    """A diagnosis of the servo with half of its mass."""
    return {
        "verdict": "effects",
        "explanation": [
            {
                "effect": "payload",
                "target": None,
                "probability": 0.9,
                "parameters": {"mass": {"value": value, "ci95": [low, high], "unit": "kg"}},
            }
        ],
        "confounded": [],
        "gap": {"windows": 9, "before": 0.5, "after": 0.1, "noise_floor": 0.01},
        "shrink": {"expected": 0.8, "expected_ci95": [0.7, 0.9], "value": came, "ci95": [0.6, 0.9]},
        "unexplained": {"share": 0.1},
        "remainder": {"sentence": "What is left sits in servo."},
    }


def test_what_is_known_is_held_against_the_interval() -> None:
    half = CASES[0]
    right, wrong = marks(half, payload(0.24, 0.2, 0.3, 0.75))
    assert len(right) == 2 and not wrong
    right, wrong = marks(half, payload(0.16, 0.1, 0.2, 0.95))
    assert not right and len(wrong) == 2


def test_the_page_says_what_was_measured_and_what_was_not(tmp_path: Path) -> None:
    kept = tmp_path / "xl330-half-the-mass"
    kept.mkdir()
    found = {"shown": "residual-mpc diagnose", "code": " (commit 1)", "document": payload(0.24, 0.2, 0.3, 0.75)}
    (kept / "measured.json").write_text(json.dumps(found))
    done = CliRunner().invoke(withheld, ["--keep", str(tmp_path)])
    assert done.exit_code == 0
    assert "| `effects` | 80% (70% to 90%) | 75% | yes |" in done.output
    assert "**Right.** The shrink lies inside its interval." in done.output
    assert done.output.count("Not measured") == len(CASES) - 1
