"""Whether the truths behind the published robots' logs are those of their models, and not of a time step."""

from __future__ import annotations

import numpy as np
import pytest
from published.logs import FINE, UR5E_MIDDLE, UR5E_REACH, arm_log, ur5e_as_it_is
from published.robots import UR5E_JOINTS


@pytest.mark.parametrize("run", range(3))
def test_the_arms_log_does_not_depend_on_the_truths_step(run: int) -> None:
    """A held command whose steps exceed a light wrist's torque limit made them differ by 0.2 rad."""
    logs = []
    for step in (FINE, FINE / 2):
        spec = ur5e_as_it_is()
        spec.option.timestep = step
        logs.append(arm_log(spec, UR5E_JOINTS, UR5E_MIDDLE, UR5E_REACH, 0.04, 0.0, 20.0, run)[2])
    assert np.abs(logs[0] - logs[1]).max() < 2e-3
