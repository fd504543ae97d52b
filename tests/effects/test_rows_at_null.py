"""Rows whose effect does nothing are left out of its computation, and keep their bits."""

import numpy as np
import pytest

from residual_mpc.effects.chain import through_commands, through_outputs
from residual_mpc.effects.library import BY_NAME
from residual_mpc.effects.speed_chain import through_pair

DT, ROWS, STEPS = 0.01, 8, 60
SIZES = {"actuator_lag": 0.1, "command_delay": 0.024, "dead_zone": 0.3, "rate_limit": 2.0}  # at the command port
OUTPUTS = {"actuator_gain": 0.8, "voltage_sag": 0.02, "saturation": 0.4}
PAIRS = {"turn_limit": 0.3, "forward_rate_limit": 2.0, "turn_rate_limit": 2.0}


@pytest.mark.parametrize("name", [*SIZES, *OUTPUTS, *PAIRS])
@pytest.mark.parametrize("acting", [0, 1, 3, ROWS])
def test_a_row_is_the_same_beside_any_others(name: str, acting: int) -> None:
    effect, rng = BY_NAME[name], np.random.default_rng(0)
    u, clock = rng.standard_normal((ROWS, STEPS, 2)), rng.uniform(0.0, 9.0, (ROWS, STEPS, 1))
    p = {q.name: np.full((ROWS, 1 if name in PAIRS else 2), q.null) for q in effect.parameters}
    (first, *_) = effect.parameters
    p[first.name][ROWS - acting :, -1] = {**SIZES, **OUTPUTS, **PAIRS}[name]

    def through(rows: slice) -> np.ndarray:
        mine = {k: v[rows] for k, v in p.items()}
        if name in SIZES:
            return through_commands(effect, mine, u[rows], DT)
        if name in PAIRS:
            return through_pair(effect, mine, u[rows], DT)
        return through_outputs(effect, mine, u[rows], clock[rows], DT)

    together = through(slice(None))
    alone = np.concatenate([through(slice(k, k + 1)) for k in range(ROWS)])
    assert np.array_equal(together, alone)
    assert np.array_equal(together[: ROWS - acting], u[: ROWS - acting])
    assert all((together[k] != u[k]).any() for k in range(ROWS - acting, ROWS))
