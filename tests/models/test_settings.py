"""Hypotheses as arrays: every target its own number, and nothing where nothing acts."""

from __future__ import annotations

import numpy as np
import pytest

from residual_mpc.effects.library import BY_NAME, HOSTED
from residual_mpc.models.settings import TUNE, Knob, Settings, Term, assemble, is_null

SLOTS = {e.name: ("left", "right") for e in HOSTED}


def test_an_effect_without_a_target_fills_all_its_slots_and_one_target_overrides() -> None:
    both, one = Knob("actuator_gain", None, "gain"), Knob("actuator_gain", "right", "gain")
    settings = assemble([{both: 0.8}, {one: 0.7}, {one: 0.7, both: 0.8}, {}], SLOTS)
    gain = settings.effects["actuator_gain"]["gain"]
    np.testing.assert_array_equal(gain, [[0.8, 0.8], [1.0, 0.7], [0.8, 0.7], [1.0, 1.0]])


@pytest.mark.parametrize("effect", BY_NAME)
def test_an_effect_at_null_is_absent(effect: str) -> None:
    null = {Knob(effect, None, p.name): p.null for p in BY_NAME[effect].parameters}
    assert assemble([null, {}], SLOTS).effects == {}


def test_a_shape_without_a_size_does_nothing() -> None:
    assert assemble([{Knob("stribeck_friction", None, "velocity"): 0.5}], SLOTS).effects == {}
    assert assemble([{Knob("slope", None, "heading"): 2.0}], SLOTS).effects == {}
    one = {"rate": np.array([[0.0, 0.1]]), "heading": np.array([[1.0, 1.0]])}
    np.testing.assert_array_equal(is_null("slope", one), [[True, False]])


def test_rows_are_taken_by_place_or_by_mask() -> None:
    knob, tuned = Knob("command_delay", None, "delay"), Knob(TUNE, None, "track_width")
    settings = assemble([{knob: 0.1 * i, tuned: float(i)} for i in range(4)], SLOTS)
    for rows in (np.array([1, 3]), np.array([False, True, False, True])):
        few = settings.take(rows)
        assert few.rows == 2
        np.testing.assert_allclose(few.effects["command_delay"]["delay"][:, 0], [0.1, 0.3])
        np.testing.assert_allclose(few.tuned["track_width"], [1.0, 3.0])
    assert settings.without("command_delay").effects == {} and "command_delay" in settings.effects


def test_rows_that_are_the_same() -> None:
    knob, limit, tuned = Knob("command_delay", None, "delay"), Knob("saturation", None, "limit"), Knob(TUNE, None, "r")
    rows = [{knob: 0.1, tuned: 2.0}, {}, {limit: 3.0}, {knob: 0.1, tuned: 2.0}, {limit: np.inf}]
    rows = [{tuned: 1.0, **row} for row in rows]
    settings = assemble(rows, SLOTS)
    first, back = settings.distinct()
    assert len(first) == 3 and back[0] == back[3] and back[1] == back[4]
    again = settings.take(first).take(back)
    for effect, numbers in settings.effects.items():
        for name, value in numbers.items():
            np.testing.assert_array_equal(again.effects[effect][name], value)
    np.testing.assert_array_equal(again.tuned["r"], settings.tuned["r"])
    assert assemble([{}, {}], SLOTS).distinct()[0].tolist() == [0]


def test_effects_that_do_nothing_in_any_row_are_left_out() -> None:
    knob, limit = Knob("command_delay", None, "delay"), Knob("saturation", None, "limit")
    settings = assemble([{knob: 0.1}, {limit: 3.0}, {}], SLOTS)
    assert settings.acting() is settings
    assert set(settings.take(np.array([0, 2])).acting().effects) == {"command_delay"}
    assert settings.take(np.array([2])).acting().effects == {}


def test_a_target_that_is_not_there() -> None:
    with pytest.raises(ValueError):
        assemble([{Knob("command_delay", "middle", "delay"): 0.1}], SLOTS)


def test_names() -> None:
    assert str(Term("payload", None)) == "payload" and str(Term("armature", "j1")) == "armature [j1]"
    assert Knob("armature", "j1", "inertia").term == Term("armature", "j1")
    assert Settings(3).effects == {} and Settings(3).tuned == {}


def test_the_order_of_effects_is_that_of_the_hypotheses() -> None:
    """The order of a set would change from process to process, and with it the last bits of a sum."""
    names = ("track_width", "actuator_lag", "wheel_radius", "command_delay", "lateral_slip", "dead_zone", "saturation")
    numbers = {name: next(p for p in BY_NAME[name].parameters) for name in names}
    hypothesis = {Knob(name, None, p.name): p.null + 0.1 if np.isfinite(p.null) else 5.0 for name, p in numbers.items()}
    assert tuple(assemble([hypothesis], dict.fromkeys(names, ())).effects) == names
