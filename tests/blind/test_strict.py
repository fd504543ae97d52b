"""The strict rule: what it asks for beyond the lenient one."""

import pytest
from answers import answer, claim

from residual_mpc.blind.records import Planted
from residual_mpc.blind.score.claim import claim_of
from residual_mpc.blind.score.match import Match, match
from residual_mpc.blind.score.outcome import Outcome, _parameters
from residual_mpc.blind.score.strict import statements
from residual_mpc.blind.score.strict_figures import strict_figures, strict_summary
from residual_mpc.blind.score.usefulness import usefulness

GAIN, RADIUS, TRACK, SLOPE = ("actuator_gain", None), ("wheel_radius", None), ("track_width", None), ("slope", None)


def scored(truth, said):
    if said is None:
        return Outcome("x", truth, None, Match(False, None, (), 1), (), None, "failed")
    return Outcome("x", truth, said, match(truth, said), _parameters(truth, said), 1.0, "")


def test_a_group_makes_an_answer_right_and_not_exact():
    found = scored(answer(GAIN), claim("effects", RADIUS, groups=[[RADIUS, GAIN]]))
    assert found.match.right and not found.strict.exact
    assert found.strict.planted == (("actuator_gain", "group"),)
    figures = strict_figures([found])
    assert figures.planted_named.value == 0.0 and figures.planted_in_group.value == 1.0


def test_an_effect_of_the_background_is_extra_and_not_wrong():
    truth = answer(TRACK, background=(Planted("slope", None, {}),))
    found = scored(truth, claim("effects", TRACK, SLOPE))
    assert found.match.right and not found.strict.exact
    assert found.strict.extra == ("slope",) and found.strict.wrong == ()
    figures = strict_figures([found])
    assert (figures.extra_effects, figures.extra_in_background, figures.wrong_effects) == (1, 1, 0)


def test_the_place_counts_where_the_set_is_exact():
    left = answer(("actuator_lag", "left"))
    assert scored(left, claim("effects", ("actuator_lag", "left"))).strict.exact_targets
    assert scored(left, claim("effects", ("actuator_lag", "right"))).strict.exact_targets is False
    both = claim("effects", ("actuator_lag", "left"), ("actuator_lag", "right"))
    assert scored(answer(("actuator_lag", None)), both).strict.exact_targets
    assert scored(left, claim("unknown")).strict.exact_targets is None


def test_a_wrong_effect_in_a_partial_is_seen_where_the_library_lacks_the_cause():
    gusts = answer(unknown=("gusts",), level="unknown")
    named, plain = scored(gusts, claim("partial", SLOPE)), scored(gusts, claim("unknown"))
    assert named.match.right and not named.strict.exact and plain.strict.exact
    law = scored(gusts, claim("partial", ("fitted_law", None)))
    assert law.strict.exact
    figures = strict_figures([named, plain, law])
    assert (figures.wrong_in_partial.hits, figures.wrong_in_partial.count) == (1, 2)
    withheld = scored(answer(SLOPE, withheld=("slope",)), claim("partial", TRACK))
    assert withheld.strict.wrong == ("track_width",) and withheld.strict.planted == ()


def test_the_drawn_value_is_not_moved_towards_the_estimate():
    truth = answer(
        ("track_width", None, {"scale": 1.2}),
        background=(Planted("slope", None, {}),),
        notes={"best_fit": {"track_width.scale": 1.21}, "best_fit_among_background": {"track_width.scale": 1.25}},
    )
    said = claim("effects", TRACK, SLOPE, parameters={"scale": {"value": 1.23, "ci95": [1.22, 1.24]}})
    (found,) = scored(truth, said).parameters
    assert found.covered is True and found.covers_drawn is False and found.drawn == 1.2
    figures = strict_figures([scored(truth, said)])
    assert figures.best_fit_coverage.value == 1.0 and figures.drawn_coverage.value == 0.0


def test_how_sure_wrong_answers_are():
    wrong = scored(answer(TRACK), claim("effects", SLOPE))  # claims are stated at 0.9
    doubtful = scored(answer(TRACK), claim("unknown"))
    right = scored(answer(TRACK), claim("effects", TRACK))
    figures = strict_figures([wrong, doubtful, right])
    assert (figures.wrong_and_sure.hits, figures.wrong_and_sure.count) == (1, 2)
    assert figures.surest_wrong is not None
    assert (figures.surest_wrong.effect, figures.surest_wrong.probability) == ("slope", 0.9)


def test_what_is_stated_as_sure_is_there_or_not():
    truth = answer(TRACK, background=(Planted("sensor_bias", "pose.theta", {}),))
    said = claim(
        "effects", TRACK, SLOPE, ("sensor_bias", "pose.theta"), RADIUS, ("fitted_law", None), groups=[[RADIUS, TRACK]]
    )
    figures = strict_figures([scored(truth, said)])
    assert (figures.sure_and_there.hits, figures.sure_and_there.count) == (3, 4)  # the slope is nowhere
    assert (figures.sure_and_planted.hits, figures.sure_and_planted.count) == (1, 4)
    elsewhere = scored(answer(("actuator_lag", "left")), claim("effects", ("actuator_lag", "right")))
    assert strict_figures([elsewhere]).sure_and_there.hits == 0


def test_doubt_is_asked_for_where_the_library_lacks_the_cause():
    withheld = answer(SLOPE, withheld=("slope",))
    sure, silent = scored(withheld, claim("partial", TRACK)), scored(withheld, claim("unknown"))
    here = scored(answer(TRACK), claim("effects", SLOPE))  # the library has its cause
    figures = strict_figures([sure, silent, here])
    assert (figures.doubt_where_lacking.hits, figures.doubt_where_lacking.count) == (1, 2)


def test_the_calibration_leaves_nothing_out():
    truth = answer(TRACK, background=(Planted("slope", None, {}),))
    figures = strict_figures([scored(truth, claim("effects", TRACK, SLOPE))])
    assert sum(b.count for b in figures.bins) == 2
    assert figures.bins[0].seen == 0.5  # the slope is not planted


def test_a_part_of_the_planted_place_is_true_if_named_and_a_rival_of_the_whole_if_not():
    both = answer(("actuator_lag", None))
    left = claim("effects", ("actuator_lag", "left"))
    assert [true for _, _, true in statements(both, left)] == [True]
    candidate = {"effect": "actuator_lag", "target": "left", "probability": 0.01}
    rival = claim_of({"verdict": "unknown", "explanation": [], "candidates": [candidate]})
    assert [true for _, _, true in statements(both, rival)] == [False]


def test_gaps_are_compared_with_a_forecast_of_constant_velocity():
    def gap(**values):
        return claim_of({"verdict": "unknown", "explanation": [], "gap": values})

    useful, useless = (
        gap(before=0.5, after=0.1, constant_velocity=0.3),
        gap(before=2.0, after=0.6, constant_velocity=0.4),
    )
    found = usefulness([useful, useless, gap(before=1.0, after=0.2)])
    assert (found.useful.hits, found.useful.count, found.nominal_useful.hits) == (1, 2, 0)
    assert found.after == 0.2 and found.constant_velocity == pytest.approx(0.35) and found.noise_floor is None


def test_a_case_without_a_diagnosis_is_not_exact_and_misses_everything():
    summary = strict_summary([scored(answer(TRACK), None), scored(answer(level="none"), claim("no_gap"))])
    assert summary.every.exact.hits == 1 and summary.every.planted_named.hits == 0
    assert list(summary.by_level) == ["single", "none"] and list(summary.by_family) == ["wheeled"]
    document = summary.document()
    assert document["exact"]["value"] == 0.5 and document["by_level"]["none"]["exact"]["value"] == 1.0
