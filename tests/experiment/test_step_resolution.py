"""Neither a plan nor a confirmation parts explanations by what the model's own time step makes of them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from residual_mpc.experiment import separate
from residual_mpc.experiment.confirmation import confirm
from residual_mpc.experiment.confirmation.settings import ConfirmationSettings


@pytest.mark.parametrize(("alike", "scores"), [(True, [100.0, 114.0, 110.0]), (False, [100.0, 580.0, 110.0])])
def test_what_differs_by_less_is_not_excluded(
    monkeypatch: pytest.MonkeyPatch, alike: bool, scores: list[float]
) -> None:
    seen: list[Any] = []

    def within(data: Any, scales: Any, rows: Any, settings: Any) -> np.ndarray:
        seen.append(rows)
        return np.array([True, alike])

    monkeypatch.setattr(confirm, "within_step_error", within)
    fits = [SimpleNamespace(values=name) for name in ("kept", "far", "near")]
    problem = SimpleNamespace(space=SimpleNamespace(settings=list))
    fitted: Any = SimpleNamespace(problem=problem, fits=fits)
    prepared: Any = SimpleNamespace(clean=None, scales=None)
    given = [100.0, 580.0, 110.0]
    assert confirm._told_apart(given, fitted, prepared, ConfirmationSettings()) == scores
    assert seen == [["kept", "far"]]


@pytest.mark.parametrize(("alike", "loss"), [(True, 0.0), (False, 3.0)])
def test_a_motion_is_not_expected_to_separate_what_differs_by_less(
    monkeypatch: pytest.MonkeyPatch, alike: bool, loss: float
) -> None:
    problem = SimpleNamespace(data=None, space=SimpleNamespace(settings=list))
    fits = [SimpleNamespace(cost=10.0, values="own"), SimpleNamespace(cost=16.0, values="other")]
    monkeypatch.setattr(separate, "within_limits", lambda *given: separate.Planned(None, True))  # type: ignore[arg-type]
    monkeypatch.setattr(separate, "simulate_run", lambda *given: None)
    monkeypatch.setattr(separate, "_problem", lambda *given: problem)
    monkeypatch.setattr(separate, "fit_all", lambda *given, **more: fits)
    monkeypatch.setattr(separate, "measure_scales", lambda data: None)
    monkeypatch.setattr(separate, "within_step_error", lambda *given: np.array([True, alike]))
    setup: Any = SimpleNamespace(dispersion=2.0)
    nothing: Any = None
    found = separate.separation(nothing, setup, nothing, [{}, {}], np.random.default_rng(0))
    assert found.losses.tolist() == [[np.inf, loss], [loss, np.inf]]
