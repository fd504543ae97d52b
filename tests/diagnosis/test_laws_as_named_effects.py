"""A law that is equivalent to an effect of the library becomes that effect unless it fits better beyond doubt."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from residual_mpc.diagnosis.laws import add
from residual_mpc.diagnosis.laws.named import beside
from residual_mpc.diagnosis.remainder.settings import RemainderSettings
from residual_mpc.models.settings import Knob, Term

VISCOUS, LAW = Term("viscous_friction", "j2"), Term("fitted_law_torque_speed", "j2")
DRAG, OFFSET = Knob("viscous_friction", "j2", "coefficient"), Knob("coulomb_friction", "j1", "torque")
LINE = {Knob("fitted_law_torque_speed", "j2", name): 0.1 for name in ("start", "step1")}


@pytest.mark.parametrize(("costlier", "known", "named"), [(0.9, True, True), (1.1, True, False), (0.9, False, False)])
def test_the_effect_takes_the_place_of_its_law_where_it_fits_as_well(
    monkeypatch: pytest.MonkeyPatch, costlier: float, known: bool, named: bool
) -> None:
    """costlier: as a share of what a law with one more number has to be worth."""
    begun: list[dict[Knob, float]] = []
    tuning = RemainderSettings()
    worth = tuning.search.beyond_doubt + tuning.search.per_knob

    def fitted(problem: Any, starts: list[dict[Knob, float]], *_: Any, **__: Any) -> list[Any]:
        begun.extend(starts)
        return [SimpleNamespace(values=dict(s), cost=100.0 + costlier * worth) for s in starts]

    monkeypatch.setattr(add, "fit_all", fitted)
    monkeypatch.setattr(add, "dispersion", lambda *_: 1.0)
    monkeypatch.setattr(add, "blocks_of", lambda *_, **__: np.zeros(1, dtype=int))
    monkeypatch.setattr(add, "named_twin", lambda law, space: beside(VISCOUS, {DRAG: 0.01}) if known else None)
    search: Any = SimpleNamespace(tuning=tuning, settings=SimpleNamespace(fit_steps=4), few=None)
    problem: Any = SimpleNamespace(space=SimpleNamespace(may_join=lambda term, terms: True))
    fit: Any = SimpleNamespace(values={OFFSET: 0.2, **LINE}, cost=100.0)
    found = add._as_named(search, problem, beside(LAW, LINE), fit)
    assert (found is not None) == named
    assert begun == ([{OFFSET: 0.2, DRAG: 0.01}] if known else [])
