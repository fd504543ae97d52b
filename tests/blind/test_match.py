"""The contract's rule for right answers."""

from dataclasses import replace

from answers import answer, claim

from residual_mpc.blind.records import Planted
from residual_mpc.blind.score.match import match


def test_the_true_set_is_right_and_anything_else_is_not():
    truth = answer(("track_width", None), ("command_delay", None))
    assert match(truth, claim("effects", ("command_delay", None), ("track_width", None))).right
    assert not match(truth, claim("effects", ("command_delay", None))).right
    assert not match(truth, claim("effects", ("command_delay", None), ("track_width", None), ("slope", None))).right
    assert not match(truth, claim("unknown")).right


def test_a_group_of_three_may_stand_for_the_truth_and_one_of_four_may_not():
    truth = answer(("sensor_delay", None))
    group = [("command_delay", None), ("sensor_delay", None), ("actuator_lag", None)]
    found = match(truth, claim("effects", ("command_delay", None), groups=[group]))
    assert found.right and found.group_size == 3
    wide = [*group, ("slope", None)]
    assert not match(truth, claim("effects", ("command_delay", None), groups=[wide])).right


def test_known_twins_may_widen_a_group():
    wide = [("actuator_gain", None), ("wheel_radius", None), ("slope", None), ("longitudinal_slip", None)]
    named = claim("effects", ("actuator_gain", None), groups=[wide])
    assert not match(answer(("wheel_radius", None)), named).right
    twins = ("actuator_gain", "longitudinal_slip", "slope")
    assert match(answer(("wheel_radius", None), twins=(twins,)), named).right


def test_a_member_may_be_a_set_of_effects():
    group = [("actuator_gain", "left"), [("wheel_radius", None), ("wheel_radius_mismatch", None)]]
    named = claim("effects", ("actuator_gain", "left"), groups=[group])
    assert match(answer(("wheel_radius", None), ("wheel_radius_mismatch", None)), named).right
    back = claim("effects", ("wheel_radius", None), ("wheel_radius_mismatch", None), groups=[group])
    assert match(answer(("actuator_gain", "left")), back).right


def test_naming_a_faint_background_effect_is_no_error():
    truth = answer(("track_width", None), background=(Planted("slope", None, {}),))
    assert match(truth, claim("effects", ("track_width", None), ("slope", None))).right
    assert not match(truth, claim("effects", ("track_width", None), ("backlash", None))).right


def test_targets_count_apart_from_the_set():
    truth = answer(("actuator_lag", "left"))
    found = match(truth, claim("effects", ("actuator_lag", "right")))
    assert found.right and found.target_right is False
    assert match(truth, claim("effects", ("actuator_lag", "left"))).target_right


def test_all_targets_are_the_same_as_null():
    both = claim("effects", ("actuator_lag", "left"), ("actuator_lag", "right"))
    assert match(answer(("actuator_lag", None)), both).target_right
    pose = claim("effects", ("sensor_delay", "pose"))
    assert match(answer(("sensor_delay", None)), pose).target_right
    single_joint = answer(("coulomb_friction", None), family="arm", notes={"joints": 1})
    assert match(single_joint, claim("effects", ("coulomb_friction", "j1"))).target_right


def test_a_sensor_effect_may_name_the_joint_or_the_channel():
    truth = answer(("sensor_bias", "position.j2"), family="arm", notes={"joints": 3})
    assert match(truth, claim("effects", ("sensor_bias", "j2"))).target_right


def test_where_the_library_lacks_the_cause_only_doubt_is_right():
    for truth in (answer(unknown=("gusts",), level="unknown"), answer(("slope", None), withheld=("slope",))):
        assert match(truth, claim("unknown")).right
        assert match(truth, claim("partial", ("command_delay", None))).right
        assert not match(truth, claim("effects", ("slope", None))).right
        assert not match(truth, claim("no_gap")).right


def test_without_a_gap_only_no_gap_is_right():
    assert match(answer(level="none"), claim("no_gap")).right
    assert not match(answer(level="none"), claim("unknown")).right


def test_beside_flaws_the_planted_effects_are_named_and_doubt_is_stated():
    truth = answer(("slope", None), unknown=("uneven_floor",), background=(Planted("actuator_lag", None, {}),))
    for more in ((), (("actuator_lag", "left"),), (("fitted_law", None),)):
        assert match(truth, claim("partial", ("slope", None), *more)).right
    assert not match(truth, claim("effects", ("slope", None))).right
    assert not match(truth, claim("partial", ("slope", None), ("backlash", None))).right
    assert not match(truth, claim("partial", ("actuator_lag", None))).right
    assert not match(truth, claim("unknown")).right


def test_an_effect_that_comes_and_goes_may_be_named_but_not_as_the_whole_truth():
    truth = answer(unknown=("track_width ends in run2 at 9.1 s",), background=(Planted("track_width", None, {}),))
    assert match(truth, claim("unknown")).right and match(truth, claim("partial", ("track_width", None))).right
    assert not match(truth, claim("partial", ("voltage_sag", None))).right
    constant = claim("effects", ("track_width", None))
    assert not match(truth, constant).right
    assert match(truth, replace(constant, changing=frozenset({("track_width", None)}))).right
    assert not match(truth, claim("no_gap")).right


def test_outliers_that_are_there_are_no_false_alarm():
    truth = answer(level="rough_none", background=(Planted("sensor_outliers", None, {"rate": 0.002}),))
    assert match(truth, claim("no_gap")).right and match(truth, claim("effects", ("sensor_outliers", None))).right
    assert not match(truth, claim("effects", ("slope", None))).right and not match(truth, claim("unknown")).right
    assert not match(answer(level="rough_none"), claim("effects", ("sensor_outliers", None))).right
