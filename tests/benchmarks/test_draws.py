"""Random choices of runs: what a draw says, and whether two draws agree."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from benchmarks.draws import Draw, agreements, draw_runs, read, tables

GAIN = ("actuator_gain", None, "gain")


def draw(low: float, value: float, high: float) -> Draw:
    return Draw(("a",), "partial", 0.5, 0.1, 0.01, {GAIN[:2]: 0.6}, {GAIN: (low, value, high)}, 10.0)


def kept(target: str | None = None, ci95: list[float] | None = None) -> dict[str, Any]:
    """A draw as it is kept."""
    gain = {"value": 0.5, "ci95": ci95}
    named = {"effect": "actuator_gain", "target": target, "probability": 0.6, "parameters": {"gain": gain}}
    return {
        "runs": ["data/a.parquet"], "seconds": 10.0, "diagnosis": {"verdict": "partial", "explanation": [named]},
        "gap": {"nominal": 0.5, "model": 0.1, "noise_floor": 0.01},
    }  # fmt: skip


def test_a_draw_says_what_it_closes_and_names() -> None:
    found = read(kept("m1", [0.4, 0.6]))
    assert found.closed == pytest.approx(0.8)
    assert found.named == {("actuator_gain", "m1"): 0.6}
    assert found.numbers == {("actuator_gain", "m1", "gain"): (0.4, 0.5, 0.6)}
    assert read(kept()).numbers == {}  # without an interval there is nothing to compare


@pytest.mark.parametrize(
    ("other", "apart", "overlap"),
    [((0.5, 0.6, 0.7), 0.1 / 0.1414, True), ((0.58, 0.68, 0.78), 0.18 / 0.1414, True), ((0.9, 1.0, 1.1), 3.536, False)],
)
def test_two_draws_are_compared_in_halves_of_their_intervals(
    other: tuple[float, float, float], apart: float, overlap: bool
) -> None:
    (found,) = agreements([draw(0.4, 0.5, 0.6), draw(*other)])
    assert found.apart == pytest.approx(apart, rel=1e-3)
    assert found.overlap is overlap


def test_the_tables_count_the_pairs() -> None:
    text = tables([draw(0.4, 0.5, 0.6), draw(0.5, 0.6, 0.7), draw(0.9, 1.0, 1.1)])
    assert "| 1 | `partial` | 0.5 to 0.1 | 80% |" in text
    assert "Of 3 numbers that two draws have both, 1 differ by no more" in text
    assert "(33%); the intervals of 1 overlap" in text


def test_without_the_recordings_it_says_so(tmp_path: Path) -> None:
    done = CliRunner().invoke(draw_runs, ["--shared", str(tmp_path)])
    assert done.exit_code == 0 and "nothing was measured" in done.output
