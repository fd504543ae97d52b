"""Outputs that make a channel worse are switched off, unless it is worse still without them; a residual that makes the
gap larger is switched off as a whole."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from residual_mpc.learning.batch.evaluation import switched_off_where_worse, without_harmful_outputs

CHANNELS = ("position.a", "position.b")


@dataclass(frozen=True)
class Outputs:
    """A residual by which of its outputs are on."""

    outputs: tuple[str, ...] = ("a", "b")
    output_scale: np.ndarray = field(default_factory=lambda: np.ones(2))

    def switched_off(self) -> Outputs:
        return self.without(self.outputs)

    def without(self, names: tuple[str, ...]) -> Outputs:
        return replace(self, output_scale=np.where(np.isin(self.outputs, names), 0.0, self.output_scale))


def evaluation(gaps: dict[tuple[float, ...], tuple[float, float]]) -> Any:
    """gaps: of both channels, by which outputs are on."""
    blocks = [SimpleNamespace(robot=None)]

    def gap(residual: Outputs | None, windows: np.ndarray) -> Any:
        on = (0.0, 0.0) if residual is None else tuple(residual.output_scale.tolist())
        return SimpleNamespace(channels=np.array(gaps[on]))

    return SimpleNamespace(gap=gap, data=SimpleNamespace(channels=CHANNELS, blocks=blocks))


@pytest.mark.parametrize(
    ("alone", "scales", "worse"),
    [
        ((0.0027, 0.2), [0.0, 1.0], ("position.a",)),  # without it the channel is as the model has it
        ((0.0176, 0.2), [1.0, 1.0], ()),  # without it the other output pushes it away
    ],
)
def test_an_output_is_switched_off_where_that_helps(
    alone: tuple[float, float], scales: list[float], worse: tuple[str, ...]
) -> None:
    gaps = {(0.0, 0.0): (0.0027, 0.5), (1.0, 1.0): (0.0044, 0.1), (0.0, 1.0): alone}
    form: Any = SimpleNamespace(moved_by=lambda robot, channel: (channel.removeprefix("position."),))
    found, said = without_harmful_outputs(evaluation(gaps), form, Outputs(), np.ones(1, dtype=bool))  # type: ignore[arg-type]
    assert found.output_scale.tolist() == scales and said == worse


@pytest.mark.parametrize(
    ("totals", "scales", "worse"),
    [
        ((0.0049, 0.0041), [1.0, 1.0], ()),
        ((0.0049, 0.0049), [1.0, 1.0], ()),
        ((0.0049, 0.0051), [0.0, 0.0], ("position.b",)),
        ((0.0049, float("nan")), [0.0, 0.0], ("position.b",)),
    ],
)
def test_a_residual_that_makes_the_gap_larger_is_not_kept(
    totals: tuple[float, float], scales: list[float], worse: tuple[str, ...]
) -> None:
    """Also where each output alone was left on, since its channel would be no better without it."""

    def gap(residual: Outputs | None, windows: np.ndarray) -> Any:
        channels = (0.0047, 0.0046) if residual is None else (0.0045, 0.0052)
        return SimpleNamespace(total=totals[residual is not None], channels=np.array(channels))

    judge: Any = SimpleNamespace(gap=gap, data=SimpleNamespace(channels=CHANNELS))
    better: Any = SimpleNamespace(gap=lambda residual, windows: SimpleNamespace(total=0.0, channels=np.zeros(2)))
    found, said = switched_off_where_worse((better, judge), Outputs(), np.ones(1, dtype=bool))  # type: ignore[arg-type]
    assert found.output_scale.tolist() == scales and said == worse
