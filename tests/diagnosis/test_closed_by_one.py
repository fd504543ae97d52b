"""An answer is checked against what it leaves: an effect that closes a good part of that is taken up."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.fit.evidence import blocks_of
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.phases.closing import closed_anywhere, closed_by_one
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.search import stepwise
from residual_mpc.diagnosis.search.acceptance import Ruler, build_ruler
from residual_mpc.diagnosis.search.stepwise import Found
from residual_mpc.models.settings import Knob, Term

ROVER = DiffDrive("rover", 0.033, 0.16)
TRACK = Knob("track_width", None, "scale")
LAG = Knob("actuator_lag", None, "time_constant")
FREED = Knob("payload", None, "z")
SETTINGS = ResultSettings()


def answer(faults: dict[str, dict[str, float]]) -> tuple[Found, Any]:
    """A result that names only the track width, for runs with these faults."""
    runs = [rover_run(f"r{k}", faults, seed=k) for k in range(2)]
    data = build_dataset(runs, [ROVER] * 2, SIGMA)
    scales = measure_scales(data)
    problem = build_problem(data, build_space(data, ()), data.sigma, scales.motion)
    base, fit = fit_all(problem, [{}, {TRACK: 1.1}], settings=SETTINGS.fit)
    ruler = build_ruler(problem.replays, scales, base, np.random.default_rng(0), SETTINGS.data)
    return Found(problem, fit, base, 1.0, ruler, (), (), data.sigma), SimpleNamespace(fit=fit)


def test_what_closes_the_rest_is_added() -> None:
    found, rivalry = answer({"track_width": {"scale": 1.2}, "actuator_lag": {"time_constant": 0.2}})
    more = closed_by_one(found, rivalry.fit, (), SETTINGS)
    assert more is not None and {t.effect for t in more.fit.terms} == {"track_width", "actuator_lag"}
    assert more.fit.values[Knob("actuator_lag", None, "time_constant")] == pytest.approx(0.2, abs=0.02)
    assert more.steps[-1].after < more.steps[-1].before


def test_what_was_refuted_is_not_added_again() -> None:
    found, rivalry = answer({"track_width": {"scale": 1.2}, "actuator_lag": {"time_constant": 0.2}})
    more = closed_by_one(found, rivalry.fit, (Term("actuator_lag", None),), SETTINGS)
    assert more is None or "actuator_lag" not in {t.effect for t in more.fit.terms if t.target is None}


def test_a_freed_number_takes_the_place_of_an_effect_only_if_it_fits_better(monkeypatch: pytest.MonkeyPatch) -> None:
    """With as many numbers: here a set with a freed one that costs a little more stands beside the effects."""
    found, _ = answer({"track_width": {"scale": 1.2}, "actuator_lag": {"time_constant": 0.2}})
    (both,) = fit_all(found.problem, [{TRACK: 1.2, LAG: 0.2}], settings=SETTINGS.fit)
    blocks = blocks_of(found.problem.data, settings=SETTINGS.fit)

    def kept(more: float) -> set[str]:
        freer = replace(both, terms=found.fit.terms, values={TRACK: 1.2, FREED: 0.2}, cost=both.cost + more)
        monkeypatch.setattr(stepwise, "with_shown", lambda *_: [freer])
        monkeypatch.setattr(stepwise, "convincing", lambda *given: None if given[2] is freer else given[3])
        monkeypatch.setattr(stepwise, "refit", lambda problem, fits, *_, **__: [both])
        monkeypatch.setattr(stepwise, "freed", lambda values: ())
        args = (found.problem, found.ruler, both, found.base, found.problem.data.sigma, blocks, SETTINGS.search)
        return {k.parameter for k in stepwise.prune(*args).values}

    assert kept(1.0) == {"scale", "time_constant"}
    assert kept(-1.0) == {"scale", "z"}


def test_what_closes_most_of_a_little_is_added() -> None:
    """Less than twice the noise floor, which small differences of everything might make up."""
    found, rivalry = answer({"track_width": {"scale": 1.1}, "actuator_lag": {"time_constant": 0.015}})
    assert not found.ruler.much_left(found.fit)
    more = closed_by_one(found, rivalry.fit, (), SETTINGS)
    assert more is not None and len(more.fit.terms) == 2
    (size,) = (v for k, v in more.fit.values.items() if k != TRACK)
    assert size == pytest.approx(0.015, abs=0.002)  # of a lag; which one is for the rivals to say


def test_what_the_time_step_makes_is_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same rest, if the error of the model's own time step is as large."""
    found, rivalry = answer({"track_width": {"scale": 1.1}, "actuator_lag": {"time_constant": 0.015}})
    left = float(found.ruler.squared([found.fit])[0]) - found.ruler.floor
    monkeypatch.setattr(Ruler, "step_error", lambda *_: 1.01 * left)
    assert closed_by_one(found, rivalry.fit, (), SETTINGS) is None


def test_what_it_makes_redundant_is_dropped() -> None:
    """The track was named for a lag."""
    found, rivalry = answer({"actuator_lag": {"time_constant": 0.2}})
    more = closed_by_one(found, rivalry.fit, (), SETTINGS)
    assert more is not None and {t.effect for t in more.fit.terms} == {"actuator_lag"}


def test_nothing_is_added_where_nothing_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("residual_mpc.diagnosis.phases.closing.convincing", lambda *args: True)
    found, rivalry = answer({"track_width": {"scale": 1.2}})
    assert closed_by_one(found, rivalry.fit, (), SETTINGS) is None


def test_what_adds_up_over_longer_windows_is_found_there() -> None:
    """Unequal wheels turn a rover by less than what the noise of its pose hides in one second."""
    runs = [
        rover_run(f"r{k}", {"track_width": {"scale": 1.2}, "wheel_radius_mismatch": {"ratio": 1.06}}, 60.0, seed=k,
                  noise=3.0)
        for k in range(2)
    ]  # fmt: skip
    sigma = {channel: 3.0 * s for channel, s in SIGMA.items()}
    short, long = (build_dataset(runs, [ROVER] * 2, sigma, horizon) for horizon in (1.0, 5.0))
    scales = measure_scales(short)
    problem = build_problem(short, build_space(short, ()), short.sigma, scales.motion)
    base, fit = fit_all(problem, [{}, {TRACK: 1.2}], settings=SETTINGS.fit)
    ruler = build_ruler(problem.replays, scales, base, np.random.default_rng(0), SETTINGS.data)
    found = Found(problem, fit, base, 1.0, ruler, (), (), short.sigma)
    assert closed_by_one(found, fit, (), SETTINGS) is None
    prepared: Any = SimpleNamespace(
        options=Options(settings=SETTINGS), space=problem.space,
        longer=[SimpleNamespace(free=None), SimpleNamespace(free=(long, measure_scales(long)))],
    )  # fmt: skip
    more = closed_anywhere(prepared, found, fit, ())
    assert more is not None and TRACK.term in more.fit.terms and more.problem.data is short
    (came,) = (t for t in more.fit.terms if t != TRACK.term)
    assert came.effect in ("wheel_radius_mismatch", "actuator_gain")  # twins without encoders
