"""The one list of effects that data cannot part."""

from residual_mpc.blind.inseparable import may_be_withheld
from residual_mpc.effects.equivalents import inseparable_from


def test_twins_are_read_both_ways_and_depend_on_what_was_logged():
    assert "sensor_delay" in inseparable_from("command_delay", ("wheeled", "no_encoders"))
    assert "command_delay" in inseparable_from("sensor_delay", ("wheeled", "no_encoders"))
    assert inseparable_from("command_delay", ("wheeled", "encoders")) == ()
    assert inseparable_from("slope", ("wheeled", "straight", "no_encoders")) == (
        "actuator_gain",
        "longitudinal_slip",
        "wheel_radius",
    )


def test_an_effect_with_a_stand_in_is_never_withheld():
    assert not may_be_withheld("actuator_lag", ("wheeled", "encoders"))
    assert not may_be_withheld("wheel_radius", ("wheeled", "no_encoders"))
    assert may_be_withheld("track_width", ("wheeled", "no_encoders"))


def test_what_others_remove_of_an_arms_gears_is_not_measured():
    assert not may_be_withheld("backlash", ("arm", "drops"))
    assert may_be_withheld("backlash", ("wheeled", "encoders"))
