"""How a channel weighs where two fits are compared."""

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.fit.evidence import blocks_of
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.fit.marginalisation import carrying
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.search import stepwise
from residual_mpc.diagnosis.search.acceptance import build_ruler, convincing, judge
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.diagnosis.search.stepwise import Step
from residual_mpc.models.settings import Knob

ROVER = DiffDrive("rover", 0.033, 0.16)


def test_what_one_fit_explains_weighs_though_the_other_spoils_it() -> None:
    """Each channel weighs as under the fit that leaves less of it, and alone as under the fit at hand."""
    data = build_dataset([rover_run(f"r{k}", {}, seed=k) for k in range(3)], [ROVER] * 3, SIGMA)
    problem = build_problem(data, build_space(data, ()), data.sigma)
    noise, scales, settings = 1.0 / problem.weight, measure_scales(data), SearchSettings()
    bias, track = Knob("sensor_bias", "pose.theta", "bias"), Knob("track_width", None, "scale")
    turned, wide = fit_all(problem, [{bias: 0.5}, {track: 0.7}], 0)
    one, other, both, swapped = (
        1.0 / judge(problem, fit, noise, scales, settings, beside).weight
        for fit, beside in ((turned, None), (wide, None), (turned, wide), (wide, turned))
    )
    assert (one > 2.0 * noise).any() and (other > 2.0 * noise).any()
    np.testing.assert_allclose(both, np.minimum(one, other), rtol=1e-9)
    np.testing.assert_allclose(swapped, both, rtol=1e-9)


LAG, TRACK = Knob("actuator_lag", None, "time_constant"), Knob("track_width", None, "scale")


def convinces(faults: dict[str, dict[str, float]]) -> bool:
    """Whether a track is taken up beside a lag."""
    faults = {"actuator_lag": {"time_constant": 0.08}, **faults}
    data = build_dataset([rover_run(f"r{k}", faults, seed=k) for k in range(3)], [ROVER] * 3, SIGMA)
    scales, settings = measure_scales(data), SearchSettings()
    problem = build_problem(data, build_space(data, ()), data.sigma, scales.motion)
    base, lag, both = fit_all(problem, [{}, {LAG: 0.08}, {LAG: 0.08, TRACK: 1.04}])
    ruler = build_ruler(problem.replays, scales, base, np.random.default_rng(0), settings.data)
    about = carrying(problem, lag.values, settings=settings.fit)
    blocks = blocks_of(data, settings=settings.fit)
    return convincing(about, ruler, lag, both, base, blocks, settings) is not None


def test_what_closes_most_of_the_rest_counts_though_many_small_differences_could(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A track that is wrong by less than three times what is usual closes nearly all that a lag leaves."""
    monkeypatch.setattr("residual_mpc.diagnosis.fit.marginalisation.likeliest_level", lambda *args, **kwargs: 1.0)
    assert convinces({"track_width": {"scale": 1.04}})
    assert not convinces({"track_width": {"scale": 1.02}, "gusts": {"size": 0.3}})  # it closes little of the rest
    monkeypatch.setattr("residual_mpc.diagnosis.search.acceptance._clear_alone", lambda *args: False)
    assert not convinces({"track_width": {"scale": 1.04}})


def test_what_is_far_above_the_noise_and_the_steps_error_is_visible(monkeypatch: pytest.MonkeyPatch) -> None:
    data = build_dataset(
        [rover_run(f"r{k}", {"actuator_lag": {"time_constant": 0.08}}, seed=k) for k in range(3)], [ROVER] * 3, SIGMA
    )
    scales, settings = measure_scales(data), SearchSettings()
    problem = build_problem(data, build_space(data, ()), data.sigma, scales.motion)
    base, lag = fit_all(problem, [{}, {LAG: 0.08}])
    ruler = build_ruler(problem.replays, scales, base, np.random.default_rng(0), settings.data)
    assert ruler.visible(base, settings) and not ruler.visible(lag, settings)
    left = float(ruler.squared([base])[0])
    monkeypatch.setattr(type(ruler), "step_error", lambda ruler, fit: 1.01 * left / settings.steps.beyond_step)
    assert not ruler.visible(base, settings)


@pytest.mark.parametrize("far_smaller", [True, False])
def test_where_little_is_left_only_a_far_smaller_gap_counts(monkeypatch: pytest.MonkeyPatch, far_smaller: bool) -> None:
    """Of what a search finds that goes on as if nothing else differed."""
    data = build_dataset(
        [rover_run(f"r{k}", {"actuator_lag": {"time_constant": 0.08}}, seed=k) for k in range(3)], [ROVER] * 3, SIGMA
    )
    scales, settings = measure_scales(data), SearchSettings()
    problem = build_problem(data, build_space(data, (), ("actuator_lag", "track_width")), data.sigma, scales.motion)
    (both,) = fit_all(problem, [{LAG: 0.08, TRACK: 1.01}], 0)
    further = Step(both.terms, 2.0, 1.0)
    monkeypatch.setattr(stepwise.Ruler, "visible", lambda *_: True)
    monkeypatch.setattr(stepwise.Forward, "from_both", lambda self, beam, steps: ([both], [*steps, further], []))
    monkeypatch.setattr(stepwise.Forward, "far_smaller", lambda *_: far_smaller)
    monkeypatch.setattr(stepwise, "prune", lambda problem, ruler, current, *_, **__: current)
    found = stepwise.stepwise_search(problem, scales, settings, np.random.default_rng(0))
    assert (further in found.steps) == far_smaller
    assert {t.effect for t in found.fit.terms} == {"actuator_lag"} | ({"track_width"} if far_smaller else set())


def test_a_far_smaller_gap_is_well_below_the_other() -> None:
    data = build_dataset(
        [rover_run(f"r{k}", {"actuator_lag": {"time_constant": 0.08}}, seed=k) for k in range(3)], [ROVER] * 3, SIGMA
    )
    scales, settings = measure_scales(data), SearchSettings()
    problem = build_problem(data, build_space(data, ()), data.sigma, scales.motion)
    base, lag = fit_all(problem, [{}, {LAG: 0.08}], 0)
    ruler = build_ruler(problem.replays, scales, base, np.random.default_rng(0), settings.data)
    blocks = blocks_of(data, settings=settings.fit)
    forward = stepwise.Forward(
        problem, ruler, base, 1.0 / problem.weight, blocks, lambda *_: None, lambda *_: {}, settings
    )
    assert forward.far_smaller(lag, base) and not forward.far_smaller(base, lag) and not forward.far_smaller(lag, lag)
