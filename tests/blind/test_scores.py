"""Figures over cases: rates, calibration, summaries."""

import pytest
from answers import answer, claim

from residual_mpc.blind.records import Planted
from residual_mpc.blind.score.calibration import calibration_error, reliability
from residual_mpc.blind.score.confusion import confusion
from residual_mpc.blind.score.match import match
from residual_mpc.blind.score.outcome import Outcome, _parameters
from residual_mpc.blind.score.rates import Rate, rate
from residual_mpc.blind.score.summary import summarise


def outcome_of(truth, said, name="x"):
    compared = match(truth, said) if said else None
    from residual_mpc.blind.score.match import Match

    parameters = _parameters(truth, said) if said else ()
    return Outcome(name, truth, said, compared or Match(False, None, (), 1), parameters, 2.0, "")


def test_wilson_matches_published_values():
    # Newcombe 1998, table I: 81 of 263 and 0 of 20
    assert Rate(81, 263).ci95 == pytest.approx((0.2553, 0.3662), abs=2e-4)
    assert Rate(0, 20).ci95 == pytest.approx((0.0, 0.1611), abs=2e-4)
    assert rate([]).value is None and rate([]).ci95 is None


def test_calibration_error_of_honest_and_of_boastful_probabilities():
    honest = reliability([0.9] * 10, [True] * 9 + [False])
    boastful = reliability([0.99] * 10, [True] * 5 + [False] * 5)
    assert calibration_error(honest) == pytest.approx(0.0)
    assert calibration_error(boastful) == pytest.approx(0.49)
    assert calibration_error(()) is None


def test_a_case_without_a_diagnosis_is_wrong_and_a_false_alarm_where_there_was_no_gap():
    summary = summarise(
        "m", [outcome_of(answer(level="none"), None), outcome_of(answer(level="none"), claim("no_gap"))]
    )
    assert summary.right.value == 0.5 and summary.false_alarms.value == 0.5
    assert summary.document()["failed"] == 1


def test_parameters_are_scored_against_their_distance_from_null():
    truth = answer(("track_width", None, {"scale": 1.2}))
    said = claim("effects", ("track_width", None), parameters={"scale": {"value": 1.22, "ci95": [1.21, 1.23]}})
    (found,) = _parameters(truth, said)
    assert found.relative_error == pytest.approx(0.1) and found.covered is False
    fitted = answer(("track_width", None, {"scale": 1.2}), notes={"best_fit": {"track_width.scale": 1.215}})
    assert _parameters(fitted, said)[0].covered is True


def test_rates_by_level_family_and_effect_and_the_confusions():
    outcomes = [
        outcome_of(answer(("slope", None)), claim("effects", ("slope", None))),
        outcome_of(answer(("slope", None)), claim("effects", ("sensor_bias", "pose.theta"))),
        outcome_of(answer(("track_width", None)), claim("unknown")),
        outcome_of(answer(unknown=("gusts",), level="unknown"), claim("partial", ("slope", None))),
    ]
    summary = summarise("m", outcomes)
    assert summary.by_level["single"].hits == 1 and summary.by_level["unknown"].value == 1.0
    assert summary.by_effect["slope"].value == 0.5
    assert summary.unknown_wrongly.hits == 1 and summary.unknown_said.value == 1.0
    found = confusion(outcomes)
    assert _count(found, "slope", "slope") == 1 and _count(found, "slope", "sensor_bias") == 1
    assert _count(found, "track_width", "(unknown)") == 1 and _count(found, "(unknown) gusts", "slope") == 1


def test_where_runs_are_confounded_a_lucky_guess_is_told_from_a_reported_group():
    truth = answer(("sensor_delay", None), level="confounded")
    group = [("command_delay", None), ("sensor_delay", None)]
    lucky = outcome_of(truth, claim("effects", ("sensor_delay", None)))
    honest = outcome_of(truth, claim("effects", ("command_delay", None), groups=[group]))
    summary = summarise("m", [lucky, honest])
    assert summary.right.value == 1.0 and summary.group_reported.value == 0.5


def test_a_faint_background_counts_neither_way_in_the_calibration():
    faint = (Planted("track_width", None, {}),)
    truth = answer(("slope", None), background=faint)
    summary = summarise("m", [outcome_of(truth, claim("effects", ("slope", None), ("track_width", None)))])
    assert sum(b.count for b in summary.bins) == 1


def _count(found, planted, named):
    return found.counts[found.rows.index(planted), found.columns.index(named)]


def test_the_confusion_matrix_holds_every_level():
    faint = (Planted("slope", None, {}),)
    outcomes = [
        outcome_of(answer(level="none"), claim("no_gap")),
        outcome_of(answer(level="none"), claim("effects", ("sensor_bias", "pose.theta"))),
        outcome_of(
            answer(("slope", None), withheld=("slope",), level="withheld"), claim("partial", ("backlash", None))
        ),
        outcome_of(
            answer(("track_width", None), background=faint, level="hard"),
            claim("effects", ("track_width", None), ("slope", None), ("backlash", None)),
        ),
        outcome_of(answer(("track_width", None), ("backlash", None)), None),
    ]
    found = confusion(outcomes)
    assert _count(found, "(no gap)", "(no gap)") == 1 and _count(found, "(no gap)", "sensor_bias") == 1
    assert _count(found, "(withheld) slope", "backlash") == 1
    assert _count(found, "(extra, in the background)", "slope") == 1
    assert _count(found, "(extra, not there)", "backlash") == 1
    assert _count(found, "track_width", "track_width") == 1 and _count(found, "track_width", "(failed)") == 1
    assert found.counts.sum() == 8
