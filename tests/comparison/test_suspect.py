"""The note on the change that is nearest to being significant."""

from types import SimpleNamespace
from typing import Any

from diagnosis.linear import space_of, windows

from residual_mpc.comparison.space import change_space
from residual_mpc.comparison.suspect import suspect_note
from residual_mpc.models.settings import Knob, Term


def contrast(effect: str, parameter: str, value: float, dose: float, z: float, p: float) -> Any:
    probe = {Knob(effect, None, parameter, True): value}
    return SimpleNamespace(term=Term(effect, None, True), probe=probe, dose=dose, z=z, p=p)


DELAY = contrast("command_delay", "delay", 0.1, 0.5, 2.7, 0.2)
SPACE = change_space(space_of(windows(2, 6.0)))


def test_it_names_what_differs_nearly_as_much_with_sizes_and_p() -> None:
    gain = contrast("actuator_gain", "gain", 1.2, -0.4, -2.6, 0.25)
    lag = contrast("actuator_lag", "time_constant", 0.1, 0.3, 2.0, 0.6)
    (note,) = suspect_note(SPACE, [lag, gain, DELAY], 0.3)
    assert "command_delay by about +0.05 s or actuator_gain by about -8.0% is the nearest" in note
    assert "in 20% of comparisons" in note
    assert "actuator_lag" not in note


def test_a_limit_has_no_rough_size() -> None:
    (note,) = suspect_note(SPACE, [contrast("saturation", "limit", 3.0, 0.5, 2.7, 0.1)], 0.3)
    assert "of saturation is the nearest" in note


def test_no_note_where_nothing_is_near_to_being_significant() -> None:
    assert suspect_note(SPACE, [DELAY], 0.1) == ()
    assert suspect_note(SPACE, [], 0.3) == ()
