"""The smallest changes that runs would show."""

from types import SimpleNamespace
from typing import Any

import pytest
from diagnosis.linear import space_of, windows

from residual_mpc.comparison.space import change_space
from residual_mpc.comparison.visible import smallest_visible
from residual_mpc.models.settings import Knob, Term

DELAY = Term("command_delay", None, True)


@pytest.mark.parametrize(("dose", "sizes"), [(0.5, [0.05]), (2.9, [0.29]), (31.0, [])])
def test_what_no_effect_can_reach_is_not_listed(dose: float, sizes: list[float]) -> None:
    """A delay may be 0.3 s."""
    probe = {Knob("command_delay", None, "delay", True): 0.1}
    contrast: Any = SimpleNamespace(term=DELAY, probe=probe, visible=dose, dose=0.0, p=0.5)
    found = smallest_visible(change_space(space_of(windows(2, 6.0))), [contrast], 0.04)
    assert [v.size for v in found] == pytest.approx(sizes)
