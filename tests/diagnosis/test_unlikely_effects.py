"""Effects that are likelier absent than present are left out where the explanation does as well without them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.phases import unlikely
from residual_mpc.diagnosis.phases.describe import describe
from residual_mpc.diagnosis.phases.prepare import DiagnosisInput, prepare
from residual_mpc.diagnosis.phases.refine import Refined, refine, refined_without
from residual_mpc.diagnosis.phases.search import search_effects
from residual_mpc.diagnosis.phases.validate import Validated, validate
from residual_mpc.diagnosis.results.document import to_document
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.models.settings import Knob, Term

ROVER = DiffDrive("rover", 0.033, 0.16)
LAG, TRACK = Term("actuator_lag", None), Term("track_width", None)
SCALE = Knob("track_width", None, "scale")


def quiet(stage: str, done: float) -> None:
    pass


@cache
def judged() -> tuple[Refined, Validated]:
    """A rover with a lag, and a track that is hardly wrong."""
    faults = {"actuator_lag": {"time_constant": 0.15}, "track_width": {"scale": 1.02}}
    runs = tuple(rover_run(f"r{k}", faults, 20.0, seed=k) for k in range(4))
    options = Options(only=(LAG.effect, TRACK.effect))
    rng = np.random.default_rng(0)
    searched = search_effects(prepare(DiagnosisInput(runs, (ROVER,) * 4, SIGMA, (), options), rng, quiet), rng, quiet)
    refined = refine(searched, rng, quiet)
    return refined, validate(refined, rng, quiet)


def left(
    monkeypatch: pytest.MonkeyPatch, found: Mapping[Term, float], little: float = 0.05, rises: float = 9.0
) -> Any:
    """The explanation without what these probabilities make unlikely, and what was tried."""
    refined, validated = judged()
    tried: list[Sequence[Term]] = []

    def less(of: Refined, gone: Sequence[Term], rng: np.random.Generator) -> Refined:
        tried.append(tuple(gone))
        return refined_without(of, gone, rng)

    def present(of: Validated) -> dict[Term, float]:
        return {t: p for t, p in found.items() if t in of.explanation.final.terms}

    monkeypatch.setattr(unlikely, "refined_without", less)
    monkeypatch.setattr(unlikely, "_unlikely", present)
    causes = replace(ResultSettings().causes, little=little, rises=rises, nothing=0.5)
    options = replace(validated.options, settings=replace(ResultSettings(), causes=causes))
    now = unlikely.without_unlikely(refined, replace(validated, options=options), np.random.default_rng(1), quiet)
    return *now, tried


def test_both_are_named_at_first() -> None:
    refined, validated = judged()
    assert set(refined.explanation.final.terms) == {LAG, TRACK} and validated.verdict == "effects"


def test_a_small_one_that_is_unlikely_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    refined, validated, tried = left(monkeypatch, {TRACK: 0.2})
    assert tried == [(TRACK,)]
    of = validated.explanation
    assert of is not judged()[1].explanation and of.final.terms == refined.explanation.final.terms == (LAG,)
    assert of.unlikely == {TRACK: 0.2} and TRACK in of.left_out
    assert validated.verdict == "effects" and of.expected is judged()[0].explanation.expected
    assert of.final.values[Knob(*LAG[:2], "time_constant")] == pytest.approx(0.15, abs=0.02)
    told = to_document(describe(validated, (), np.random.default_rng(0), quiet, lambda diagnosis: None).diagnosis)
    assert [e["effect"] for e in told["explanation"]] == [LAG.effect]
    known = {c["effect"]: c["probability"] for c in told["candidates"]}
    assert known[TRACK.effect] == pytest.approx(0.2)
    assert all(TRACK.effect not in str(s) for s in told["rivals"])
    assert any("track_width" in note and "unlikely" in note for note in told["notes"])


def test_one_that_explains_much_stays_however_unlikely(monkeypatch: pytest.MonkeyPatch) -> None:
    refined, validated, tried = left(monkeypatch, {LAG: 0.1})
    assert tried == [(LAG,)] and (refined, validated.explanation) == (judged()[0], judged()[1].explanation)


@pytest.mark.parametrize(("little", "rises"), [(1e-4, 9.0), (0.05, 1.01)])
def test_the_gap_may_hardly_rise(monkeypatch: pytest.MonkeyPatch, little: float, rises: float) -> None:
    """Neither beside what it was before any effect nor beside what these left."""
    _, validated, tried = left(monkeypatch, {TRACK: 0.2}, little, rises)
    assert tried == [(TRACK,)] and validated.explanation is judged()[1].explanation


def test_without_all_of_them_or_else_without_the_least_likely(monkeypatch: pytest.MonkeyPatch) -> None:
    _, validated, tried = left(monkeypatch, {LAG: 0.2, TRACK: 0.1})
    assert tried == [(LAG, TRACK), (TRACK,), (LAG,)]
    assert validated.explanation.final.terms == (LAG,)


def test_nothing_is_tried_where_all_are_likely() -> None:
    refined, validated = judged()
    rng = np.random.default_rng(2)
    assert unlikely.without_unlikely(refined, validated, rng, quiet) == (refined, validated)
    assert rng.random() == np.random.default_rng(2).random()


def test_a_place_that_many_could_take_says_nothing() -> None:
    """Of a group of three, the place counts; of a larger one, the effect that is named."""
    _, validated = judged()
    others = [Term(name, None) for name in ("wheel_radius", "sensor_delay", "clock_skew")]
    for count, expected in ((2, False), (3, True)):
        of = validated.explanation
        group = ((TRACK,), *((t,) for t in others[:count]))
        rivalry = replace(of.rivalry, groups=(group,), shares={**of.rivalry.shares, TRACK: 0.25})
        gaps = replace(validated.gaps, of=replace(of, rivalry=rivalry))
        assert (TRACK in unlikely._unlikely(replace(validated, gaps=gaps))) is expected


def test_what_acts_in_a_part_of_the_runs_is_not_questioned() -> None:
    _, validated = judged()
    doubted = {t: replace(s, strength=0.0, fails=True, evidence=("fits",)) for t, s in validated.supports.items()}
    assert set(unlikely._unlikely(replace(validated, supports=doubted))) == {LAG, TRACK}
    of = replace(validated.explanation, in_parts={TRACK: None})  # type: ignore[dict-item]
    gaps = replace(validated.gaps, of=of)
    assert set(unlikely._unlikely(replace(validated, gaps=gaps, supports=doubted))) == {LAG}


def test_without_held_out_windows_nothing_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    refined, validated = judged()
    of = refined.explanation
    every = replace(refined, explanation=replace(of, held=np.zeros_like(of.held)))
    monkeypatch.setattr(unlikely, "_unlikely", lambda _: {TRACK: 0.1})
    assert unlikely.without_unlikely(every, validated, np.random.default_rng(0), quiet) == (every, validated)
