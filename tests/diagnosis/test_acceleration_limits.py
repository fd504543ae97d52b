"""A base controller that limits the acceleration of its forward and its turning speed, on rovers of another simulation
without encoders."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.rover_euler import simulate
from oracles.rover_log import SIGMA

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob, Term

ROBOT = DiffDrive("rover", 0.033, 0.16)
PERIOD = 0.05  # s
FORWARD, TURN = 9.0, 4.0  # rad/s^2
LIMITS = {"forward_rate_limit": {"rate": FORWARD}, "turn_rate_limit": {"rate": TURN}}


def stepped_run(seed: int, faults: dict[str, dict[str, float]], seconds: float = 14.0) -> Run:
    """Jumps of the forward and of the turning speed at times of their own."""
    rng = np.random.default_rng(seed)
    t = PERIOD * np.arange(round(seconds / PERIOD) + 1)

    def jumps(low: float, high: float) -> np.ndarray:
        at = np.cumsum(rng.uniform(1.0, 2.5, len(t)))
        levels = np.concatenate([[0.0], rng.uniform(low, high, len(t))])
        return np.asarray(levels[np.searchsorted(at, t, side="right")])

    forward, turn = jumps(-4.0, 10.0), jumps(-3.0, 3.0)
    u = np.stack([forward - turn, forward + turn], axis=-1)

    def command(time: float) -> tuple[float, float]:
        left, right = u[min(int(max(time, 0.0) / PERIOD + 1e-6), len(t) - 1)]
        return float(left), float(right)

    pose = simulate(command, t, faults, fine=5e-4)
    columns = {"command.left": u[:, 0], "command.right": u[:, 1]}
    for i, (channel, sigma) in enumerate(SIGMA.items()):
        columns[channel] = pose[:, i] + sigma * rng.standard_normal(len(t))
    return Run(f"r{seed}", t, columns)


def test_rates_are_tried_in_units_of_what_is_commanded_ahead_and_in_turns() -> None:
    """Both are candidates without encoders."""
    run = stepped_run(1, {})
    space = build_space(build_dataset([run], [ROBOT], SIGMA), ())
    left, right = run.columns["command.left"], run.columns["command.right"]
    for effect, sent in (("forward_rate_limit", 0.5 * (left + right)), ("turn_rate_limit", 0.5 * (right - left))):
        assert Term(effect, None) in space.candidates
        rates = [probe[Knob(effect, None, "rate")] for probe in space.probes(Term(effect, None))]
        np.testing.assert_allclose(rates, np.array([4.0, 1.0, 0.3, 0.1]) * np.ptp(sent), rtol=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("track", [1.0, 1.2])
def test_both_limits_are_found_and_a_wider_track_with_them(track: float) -> None:
    faults = {**LIMITS, "track_width": {"scale": track}}
    runs = [stepped_run(k, faults) for k in range(4)]
    found = diagnose(runs, [ROBOT] * 4, {}, (), Options(), np.random.default_rng(0)).diagnosis
    truth = {"forward_rate_limit": FORWARD, "turn_rate_limit": TURN} | ({"track_width": track} if track > 1.0 else {})
    assert {c.term.effect for c in found.causes} == set(truth) and found.verdict == "effects"
    for cause in found.causes:
        (number,) = cause.parameters
        assert number.ci95[0] <= truth[cause.term.effect] <= number.ci95[1]


@pytest.mark.slow
@pytest.mark.parametrize("fault", [{"rate_limit": {"rate": 9.0}}, {"actuator_lag": {"time_constant": 0.3}}])
def test_wheels_that_follow_slowly_are_no_limits_of_the_base(fault: dict[str, dict[str, float]]) -> None:
    runs = [stepped_run(k, fault) for k in range(4)]
    found = diagnose(runs, [ROBOT] * 4, {}, (), Options(), np.random.default_rng(0)).diagnosis
    assert {c.term.effect for c in found.causes} == set(fault)
