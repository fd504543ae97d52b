"""A change stays only if unseen windows fit better with it; what it predicts is measured over stretches."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from residual_mpc.comparison import settled
from residual_mpc.comparison.gaps import predicted_of
from residual_mpc.comparison.records import Predicted
from residual_mpc.comparison.search import FoundChange, FoundChanges
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.space import ChangeSpace
from residual_mpc.models.settings import Knob, Term

DELAY, GAIN = Term("command_delay", None, True), Term("actuator_gain", "left", True)
NUMBERS = {DELAY: Knob("command_delay", None, "delay", True), GAIN: Knob("actuator_gain", "left", "gain", True)}


def test_what_a_change_predicts_is_a_mean_over_windows_with_the_error_of_stretches() -> None:
    without = np.array([0.30, 0.30, 0.20, 0.20, 9.0, np.nan])
    changed = np.array([0.10, 0.10, 0.30, 0.30, 5.0, 0.1])
    found = predicted_of(without, changed, np.array([0, 0, 1, 1, 2, 3]))
    # a window that either misses altogether, and one that was not measured, tell nothing
    assert found.gain == pytest.approx((0.4 - 0.2) / 5) and found.better == pytest.approx(1 / 3)
    jackknife = np.array([-0.2 / 3, 0.4 / 3, 0.05])
    assert found.error == pytest.approx(np.sqrt(2 / 3 * np.sum((jackknife - jackknife.mean()) ** 2)))


def settle(
    monkeypatch: pytest.MonkeyPatch,
    gains: list[dict[Term, float]],
    nothing: tuple[Term, ...] = (),
    sized: tuple[set[Term], ...] = (),
    p: float = 0.02,
) -> tuple[Any, list[Any]]:
    """What stays of a delay and a gain if they predict these gains, each time that they are measured; the fits.
    nothing: the changes whose numbers came to nothing; sized: for each call, the changes whose size is established; p:
    of the gain's own test."""
    fits: list[Any] = []
    measured, asked = iter(gains), iter(sized)

    def fit_all(problem: Any, starts: Any, **_: Any) -> list[Any]:
        fits.append(dict(starts[0]))
        return [SimpleNamespace(values=starts[0], cost=1.0)]

    def gap(*_: Any) -> Any:
        return SimpleNamespace(predicted={t: Predicted(g, 0.01, 0.5) for t, g in next(measured).items()})

    def least(problem: Any, fit: Any, rivals: Any, *_: Any) -> Term | None:
        have = next(asked, {DELAY, GAIN})
        return next((c.term for c in rivals.found.changes if c.term not in have), None)

    space = object.__new__(ChangeSpace)
    values = {NUMBERS[DELAY]: 0.04, NUMBERS[GAIN]: 0.9}
    fit = SimpleNamespace(values=values, cost=1.0)
    found = FoundChanges(fit, fit, (FoundChange(DELAY, 0.01, 0.01), FoundChange(GAIN, p, 0.02)), None, 1.0)  # type: ignore[arg-type]
    rivals = settled.ChangeRivals(found, (), {DELAY: {DELAY: 1.0}, GAIN: {GAIN: 1.0}}, {DELAY: 0.5, GAIN: 0.5})
    monkeypatch.setattr(settled, "fit_all", fit_all)
    monkeypatch.setattr(settled, "to_the_end", lambda problem, fit, _: fit)
    monkeypatch.setattr(settled, "came_to_nothing", lambda fit, space, term: term in nothing)
    monkeypatch.setattr(settled, "spread_of", lambda *_: None)
    monkeypatch.setattr(settled, "_least_without_size", least)
    monkeypatch.setattr(settled, "told_apart", lambda *_: "tested again")
    monkeypatch.setattr(settled, "compared_gap", gap)
    monkeypatch.setattr(settled, "_fitted", lambda *_: (None, None, fit, "tested"))
    last = SimpleNamespace(problem=SimpleNamespace(space=space))
    stays = settled.settle(None, None, None, last, rivals, False, None, ComparisonSettings())  # type: ignore[arg-type]
    return stays, fits


def test_changes_that_predict_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    stays, fits = settle(monkeypatch, [{DELAY: 0.02, GAIN: 0.001}])
    assert [c.term for c in stays.rivals.found.changes] == [DELAY, GAIN] and stays.left == "tested" and not fits


def test_the_change_that_predicts_least_goes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without it the other may predict something."""
    stays, fits = settle(monkeypatch, [{DELAY: -0.001, GAIN: -0.002}, {DELAY: 0.003}])
    assert [c.term for c in stays.rivals.found.changes] == [DELAY] and stays.left == "tested again"
    assert fits == [{NUMBERS[DELAY]: 0.04}] and stays.rivals.places == {DELAY: {DELAY: 1.0}}


def test_what_only_a_fit_shows_has_to_predict_beyond_its_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """The standard error of these gains is 0.01."""
    for predicted, p, stay in ((0.009, 0.2, [DELAY]), (0.011, 0.2, [DELAY, GAIN]), (0.009, 0.02, [DELAY, GAIN])):
        with monkeypatch.context() as patched:
            stays, _ = settle(patched, [{DELAY: 0.02, GAIN: predicted}, {DELAY: 0.02}], p=p)
        assert [c.term for c in stays.rivals.found.changes] == stay


def test_nothing_may_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    stays, fits = settle(monkeypatch, [{DELAY: -0.001, GAIN: -0.002}, {DELAY: -0.003}, {}])
    assert not stays.rivals.found.changes and fits[-1] == {}


def test_a_change_that_came_to_nothing_is_in_no_later_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    stays, fits = settle(monkeypatch, [{DELAY: 0.02}], nothing=(GAIN,))
    assert [c.term for c in stays.rivals.found.changes] == [DELAY]
    assert fits == [{NUMBERS[DELAY]: 0.04}] and stays.fit.values == fits[0]


def test_of_two_changes_without_size_one_may_have_it_without_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    stays, fits = settle(monkeypatch, [{GAIN: 0.02}], sized=(set(), {GAIN}))
    assert [c.term for c in stays.rivals.found.changes] == [GAIN]
    assert fits == [{NUMBERS[GAIN]: 0.9}] and stays.left == "tested again"


def test_the_one_that_explains_least_goes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(settled, "may_be_none", lambda *_: True)
    changes = tuple(FoundChange(t, 0.1) for t in (DELAY, GAIN))
    rivals: Any = SimpleNamespace(found=SimpleNamespace(changes=changes), parts={DELAY: 0.6, GAIN: 0.2})
    assert settled._least_without_size(Any, Any, rivals, Any, ComparisonSettings()) == GAIN  # type: ignore[arg-type]
    rivals.found.changes = ()
    assert settled._least_without_size(Any, Any, rivals, Any, ComparisonSettings()) is None  # type: ignore[arg-type]
