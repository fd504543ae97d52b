"""Where much is left, the search also begins anew: what was found first may have kept it from the cause."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.fit.evidence import blocks_of
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.search.acceptance import Ruler, build_ruler
from residual_mpc.diagnosis.search.beam import leaving_far_less
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.diagnosis.search.stepwise import Forward, Step, stepwise_search
from residual_mpc.models.settings import Knob, Values

LAG, TRACK = Knob("actuator_lag", None, "time_constant"), Knob("track_width", None, "scale")
SETTINGS = SearchSettings()


def begun() -> tuple[Forward, Fit]:
    """A search on a rover whose track is wrong, and a fit that explains it by a lag."""
    run = rover_run("run1", {"track_width": {"scale": 1.3}}, 20.0)
    data = build_dataset([run], [DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)], SIGMA)
    scales = measure_scales(data)
    space = build_space(data, (), ("actuator_lag", "track_width"))
    problem = build_problem(data, space, data.sigma, scales.motion)
    base, wrong = fit_all(problem, [{}, {LAG: 0.1}])
    ruler = build_ruler(problem.replays, scales, base, np.random.default_rng(0), SETTINGS.data)
    noise, blocks = 1.0 / problem.weight, blocks_of(data, settings=SETTINGS.fit)
    quiet, unsuggested = (lambda text, done: None), (lambda problem, fit: {})
    return Forward(problem, ruler, base, noise, blocks, quiet, unsuggested, SETTINGS, False), wrong


@pytest.mark.parametrize("stuck", [True, False])
def test_the_way_that_leaves_far_less_is_taken(monkeypatch: pytest.MonkeyPatch, stuck: bool) -> None:
    """From the wrong effect the search goes on to the right one as well, or is stuck; from nothing it finds it."""
    forward, wrong = begun()
    steps, pairs = [Step(wrong.terms, 1.0, 0.9)], []
    cause: Values = {TRACK: 1.3}
    right, both = fit_all(forward.problem, [cause, {**wrong.values, **cause}])

    def go_on(self: Forward, beam: list[Fit], taken: list[Step]) -> tuple[list[Fit], list[Step], list[Fit]]:
        pairs.append(self.settings.pairs.always)
        if beam[0] is self.base:
            return [right], [*taken, Step(right.terms, 1.0, 0.1)], []
        return ([beam[0]], taken, []) if stuck else ([both], [*taken, Step(both.terms, 0.9, 0.1)], [])

    monkeypatch.setattr(Forward, "go_on", go_on)
    beam, way, _ = forward.from_both([wrong], steps)
    assert beam[0] is (right if stuck else both)
    assert pairs == [False, True]  # from the nominal model with pairs in any case
    assert way[0].terms == (right.terms if stuck else wrong.terms)


@pytest.mark.parametrize("allowed", [True, False])
def test_a_search_says_whether_it_began_anew(monkeypatch: pytest.MonkeyPatch, allowed: bool) -> None:
    forward, wrong = begun()
    starts = []

    def go_on(self: Forward, beam: list[Fit], taken: list[Step]) -> tuple[list[Fit], list[Step], list[Fit]]:
        starts.append((self.small_differences, {t.effect for t in beam[0].terms}))
        return beam, taken, []

    monkeypatch.setattr(Ruler, "visible", lambda *_: True)
    monkeypatch.setattr(Forward, "go_on", go_on)
    rng = np.random.default_rng(0)
    found = stepwise_search(forward.problem, forward.ruler.scales, SETTINGS, rng, start=wrong.values, anew=allowed)
    lag = {"actuator_lag"}
    assert starts == [(True, lag), (False, lag)] + ([(False, set())] if allowed else [])
    assert found.fit.terms and found.anew == allowed


def test_a_search_from_nothing_has_begun_there(monkeypatch: pytest.MonkeyPatch) -> None:
    forward, _ = begun()
    marginalised = []

    def go_on(self: Forward, beam: list[Fit], taken: list[Step]) -> tuple[list[Fit], list[Step], list[Fit]]:
        marginalised.append(self.small_differences)
        return beam, taken, []

    monkeypatch.setattr(Ruler, "visible", lambda *_: True)
    monkeypatch.setattr(Forward, "go_on", go_on)
    found = stepwise_search(forward.problem, forward.ruler.scales, SETTINGS, np.random.default_rng(0))
    assert not found.fit.terms and marginalised == [True, False] and found.anew


def test_sets_that_leave_far_less_come_first() -> None:
    """A lag explains a track's error badly, track and lag together as well as the track alone."""
    forward, wrong = begun()
    worse, right = fit_all(forward.problem, [{LAG: 0.02}, {TRACK: 1.3}])
    assert leaving_far_less(forward.ruler, [wrong, right, worse], wrong, SETTINGS) == [right]
    assert leaving_far_less(forward.ruler, [wrong, right], right, SETTINGS) == []
