"""10^5 steps of the default controller, noise and kicks in the loop: no failure (about a minute)."""

from __future__ import annotations

import numpy as np
import pytest
from drives import DT, SLOW, drive, figure_eight

from controllers.mpc import build_mpc
from controllers.settings import MpcSettings
from residual_mpc.export import casadi_model


@pytest.mark.slow
def test_no_failure_in_100_000_steps():
    model = drive(SLOW, network=True)
    mpc = build_mpc(model, MpcSettings())
    f = casadi_model(model).f
    rng = np.random.default_rng(0)
    state, x = mpc.init(), model.start()
    noise = rng.standard_normal((100_000, 3)) * [0.002, 0.002, 0.006]
    paths = figure_eight(DT * np.arange(240 + 21))  # one period: the figure repeats
    turn = 0.0
    for k in range(100_000):
        i = k % 240
        if i == 0 and k:
            turn = np.round((x[2] - paths[1, 2]) / (2 * np.pi)) * 2 * np.pi
        if k % 997 == 0:
            x[:3] += rng.uniform(-1, 1, 3) * [0.3, 0.3, 1.0]  # someone lifts the robot and puts it elsewhere
        seen = x.copy()
        seen[:3] += noise[k]
        command, state, info = mpc.step(state, seen, paths[i + 1 : i + 21] + [0.0, 0.0, turn])
        assert info.outcome != "shifted" and (np.abs(command) <= 12.0).all(), k
        x = np.array(f(x, command, model.p)).ravel()
    assert state.failures == 0
