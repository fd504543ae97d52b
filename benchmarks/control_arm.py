"""The MPC's step on the SCALER arm, timed: `python -m benchmarks.control_arm`, or as the second table of `.control`.

Six joints through the closed five-bar, a dead time, a payload and the network in the model, N = 20, 10 ms, joint
and rate limits, the tool on a circle that goes up and down, on the model itself.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.control import ControlProblem, full, print_table, race, real_time, row
from controllers.mpc import build_mpc
from plants.scaler_arm.servo_robot import ServoArm
from residual_mpc.export import Augmented, Build, augment
from residual_mpc.models.settings import Knob
from scenarios.arm import CONTROL, DT, blank_network, circle_z


def model(smooth: float = 0.0) -> Augmented:
    """The arm with 24 ms of dead time, 100 g at the tool, and a network of a few per cent of its speed."""
    blank = blank_network(0, DT)
    network = blank.with_theta(0.2 * np.random.default_rng(3).standard_normal(blank.net.size))
    effects = {Knob("command_delay", None, "delay"): 0.024, Knob("payload", None, "mass"): 0.1}
    return augment(ServoArm("scaler_arm_servo"), effects, network, Build(DT, smooth))


def arm_rows(steps: int) -> list[dict[str, Any]]:
    """One row a contestant; IPOPT, which takes a hundred times as long, drives the first tenth."""
    reference = circle_z()
    problem = ControlProblem(DT, CONTROL.horizon, reference.path, reference.begin(), lambda y, wanted: y - wanted)
    exact = model()
    ours = build_mpc(exact, CONTROL)
    contestants = [
        real_time("real-time iteration, DAQP", ours, problem),
        real_time("real-time iteration, OSQP", build_mpc(exact, replace(CONTROL, solver="osqp")), problem),
        real_time("the same without a compiler", build_mpc(exact, replace(CONTROL, compile=False)), problem),
    ]
    few = max(40, steps // 10)
    pair = [
        real_time("", ours, problem),
        full("IPOPT, converged, smoothed", build_mpc(model(smooth=1e-3), CONTROL), 200, problem),
    ]
    rng = np.random.default_rng(0)
    race(pair, ours, problem, few, 20, rng)
    race(contestants, ours, problem, steps, 40, rng)
    over = pair[0].cost / pair[1].cost  # on the same samples
    rows = [row(c, contestants[0].cost / over) for c in contestants]
    return [*rows, row(pair[1], pair[1].cost)]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--steps", type=int, default=480, help="samples each contestant drives")
    print_table("SCALER arm", arm_rows(parser.parse_args().steps))


if __name__ == "__main__":
    main()
