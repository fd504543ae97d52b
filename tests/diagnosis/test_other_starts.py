"""Where a second search begins: with a gain, or with friction where a gain came first, and only where much is left."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import ROBOT, rover_run

import residual_mpc as rm
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.phases import search
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.search import other_starts
from residual_mpc.diagnosis.search.acceptance import Ruler
from residual_mpc.diagnosis.search.other_starts import begun_with, better_everywhere, other_start
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.diagnosis.search.stepwise import Found
from residual_mpc.models.settings import Knob, Term

GAIN, FRICTION, DELAY = (Term(e, None) for e in ("actuator_gain", "coulomb_friction", "command_delay"))


def found(
    first: tuple[Term, ...] | None, candidates: tuple[Term, ...], left: float = 0.2, nominal: float = 0.5
) -> Any:
    """What `other_start` reads of a search that took `first` first, from gaps; the noise alone makes one of 0.001."""
    steps = () if first is None else (SimpleNamespace(terms=first),)
    ruler: Any = SimpleNamespace(floor=0.001**2, squared=lambda fits: (nominal**2, left**2))
    ruler.threshold = partial(Ruler.threshold, ruler)
    problem = SimpleNamespace(space=SimpleNamespace(candidates=candidates))
    return SimpleNamespace(steps=steps, ruler=ruler, fit=None, base=None, problem=problem)


@pytest.mark.parametrize(
    ("first", "candidates", "then"),
    [
        ((FRICTION,), (GAIN, FRICTION, DELAY), GAIN),
        ((DELAY,), (GAIN, FRICTION, DELAY), GAIN),
        ((GAIN,), (GAIN, FRICTION, DELAY), FRICTION),
        ((GAIN, FRICTION), (GAIN, FRICTION, DELAY), None),
        ((Term("actuator_gain", "j1"),), (GAIN, Term("actuator_gain", "j1"), DELAY), None),
        ((DELAY,), (Term("actuator_gain", "j1"), DELAY), Term("actuator_gain", "j1")),
        ((DELAY,), (Term("actuator_gain", "j1"), Term("actuator_gain", "j2")), None),
        (None, (GAIN, FRICTION), None),
    ],
)
def test_the_other_kind_comes_first(
    first: tuple[Term, ...] | None, candidates: tuple[Term, ...], then: Term | None
) -> None:
    settings = SearchSettings()
    assert other_start(found(first, candidates), settings) == then
    assert other_start(found(first, candidates, left=0.049), settings) is None


@pytest.mark.parametrize(
    ("left", "nominal", "tried"),
    [(0.051, 0.5, True), (0.049, 0.5, False), (0.011, 0.04, True), (0.007, 0.04, False), (0.0019, 0.004, False)],
)
def test_little_is_much_where_there_was_no_more(left: float, nominal: float, tried: bool) -> None:
    """A fifth of the nominal gap, unless it is within twice what noise alone makes."""
    start = other_start(found((FRICTION,), (GAIN, FRICTION), left, nominal), SearchSettings())
    assert start == (GAIN if tried else None)


@pytest.mark.parametrize(("other", "taken"), [(0.7, True), (0.9, False), (1.2, False)])
def test_the_second_result_counts_if_it_is_clearly_better(
    monkeypatch: pytest.MonkeyPatch, other: float, taken: bool
) -> None:
    monkeypatch.setattr(other_starts, "squared_gaps", lambda *_: [1.0, other])
    monkeypatch.setattr(other_starts, "PredictionCache", lambda *_: None)
    space: Any = SimpleNamespace(space=None)
    one, two = (Found(space, fit, None, 1.0, None, (), ("met",), None) for fit in ("one", "two"))  # type: ignore[arg-type]
    result = better_everywhere(None, None, one, two, SearchSettings())  # type: ignore[arg-type]
    assert result.fit == ("two" if taken else "one")
    assert result.met == ("one" if taken else "two", "met")


@pytest.mark.parametrize("anew", [True, False])
def test_the_second_search_begins_anew_where_the_first_did_not(monkeypatch: pytest.MonkeyPatch, anew: bool) -> None:
    calls: list[tuple[Any, ...]] = []

    def on(*args: Any) -> Any:
        calls.append(args)
        return SimpleNamespace(anew=anew) if len(calls) == 1 else None

    monkeypatch.setattr(search, "_on", on)
    monkeypatch.setattr(search, "other_start", lambda *_: GAIN)
    settings = SimpleNamespace(search=SearchSettings())
    prepared: Any = SimpleNamespace(headline=("windows", "scales"), options=SimpleNamespace(settings=settings))
    search.search_headline(prepared, np.random.default_rng(0), lambda text, done: None)
    assert len(calls) == 2 and calls[1][-2:] == (GAIN, not anew)


def test_a_start_is_the_fit_of_its_effect_alone(tmp_path: Any) -> None:
    """A gain of 0.3, far from the model's own, beside a delay that stays unexplained."""
    (tmp_path / "robot.toml").write_text(ROBOT)
    robot = rm.load_robot(tmp_path / "robot.toml")
    run = rover_run("r", {"actuator_gain": {"gain": 0.3}, "command_delay": {"delay": 0.05}}, seconds=12.0)
    data = build_dataset([run], [robot.model], {"pose.x": 0.001, "pose.y": 0.001, "pose.theta": 0.002}, 1.0)
    problem = build_problem(data, build_space(data, (), only=("actuator_gain", "dead_zone")), data.sigma)
    values = begun_with(problem, GAIN, SearchSettings())
    assert values is not None and {k.term for k in values} == {GAIN}
    assert values[Knob("actuator_gain", None, "gain")] == pytest.approx(0.3, abs=0.03)
