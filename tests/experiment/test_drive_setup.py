"""How the next motions are driven: as the runs were, at the period that their controller meant."""

from __future__ import annotations

import numpy as np
import pytest
from diagnosis.linear import ROVER

from residual_mpc.experiment.command_file import command_table
from residual_mpc.experiment.drive_setup import setup_from_runs
from residual_mpc.experiment.motions import motions


def period_of(measured: float) -> float:
    limits = {"low": -1.0, "high": 1.0}
    made = {"commands": {"left": limits, "right": limits}, "sigma": {}, "start": {}, "period": measured,
            "switches": False, "dispersion": 1.0}  # fmt: skip
    setup = setup_from_runs({"setup": made}, ROVER, "diagnosis.json", {})
    table = command_table(motions(setup, 10.0, np.random.default_rng(0))[:1], setup.actuators).splitlines()
    stamps = [line.split(",")[0] for line in table[1:]]
    assert float(stamps[1]) == pytest.approx(setup.period, rel=1e-5)
    assert setup.period != 0.02 or {len(stamp) for stamp in stamps} <= {1, 2, 3, 4}  # 0, 10, 0.1, 9.96
    return setup.period


@pytest.mark.parametrize(
    ("measured", "meant"), [(0.0199999, 0.02), (0.02000004, 0.02), (1 / 30, 1 / 30), (0.0201, 0.0201)]
)
def test_a_measured_period_is_taken_as_it_was_meant(measured: float, meant: float) -> None:
    assert period_of(measured) == meant
