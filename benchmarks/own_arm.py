"""MPC on arms of a user's own MJCF, timed against IPOPT and do-mpc: `python -m benchmarks.own_arm`.

A six- and a seven-joint arm, with 30 ms of dead time, a payload, dry friction, a weak gain and a network on the
accelerations in the model; N = 20 at 20 ms; limits on commands, rates, joint positions and forces; every joint moves
along a sine. `--recovery` instead withholds the four effects on three arms, diagnoses runs of the nominal MPC, and runs
the MPC with the diagnosed model.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import residual_mpc as rm
from benchmarks.control import Contestant, ControlProblem, do_mpc, full, print_table, race, real_time, row
from benchmarks.findings.arm_models import SEVEN, SIX, ArmModel, Link
from benchmarks.findings.arms import Servos
from controllers.mpc import build_mpc
from controllers.usual import usual_settings
from residual_mpc.closed_loop.scenario import RunOptions
from residual_mpc.export import Augmented, Build, augment
from residual_mpc.learning.forms.joint import JointForm
from residual_mpc.learning.network.mlp import Mlp, initial_weights
from residual_mpc.learning.network.residual import Residual
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Knob, Values
from scenarios.own import OwnScenario, named_motion

DT, N = 0.02, 20
FOUR = ArmModel(
    "four_joint",
    (
        Link("0 0 1", "0 0 0.1", 1.2, "0 0 0.1", 0.05, 0.3),
        Link("0 1 0", "0 0 0.1", 1.5, "0.3 0 0", 0.05, 0.3),
        Link("0 1 0", "0.3 0 0", 1.0, "0.25 0 0", 0.04, 0.2),
        Link("0 1 0", "0.25 0 0", 0.4, "0.1 0 0", 0.02, 0.1),
    ),
    Servos(np.array([120.0, 150, 100, 40]), np.array([8.0, 10, 7, 3]), np.array([30.0, 40, 30, 12])),
)
ARMS = {"six": SIX, "seven": SEVEN, "four": FOUR}
HOMES = {
    "six": (0.0, -1.0, 1.4, -0.6, 0.3, 0.0),
    "seven": (0.0, 0.5, 0.0, 1.6, 0.0, 1.2, 0.0),
    "four": (0.0, -0.7, 1.0, 0.4),
}


def load(name: str, folder: Path) -> rm.NominalRobot:
    """The arm with a keyframe as its home."""
    angles = " ".join(map(str, HOMES[name]))
    key = f'</actuator><keyframe><key name="home" qpos="{angles}"/></keyframe>'
    (folder / f"{name}.xml").write_text(ARMS[name].xml().replace("</actuator>", key))
    (folder / f"{name}.toml").write_text(f'name = "{name}"\nplant = "mujoco"\nmodel = "{name}.xml"\n')
    return rm.load_robot(folder / f"{name}.toml")


def withheld(robot: Robot) -> Values:
    """The four effects, sized by the arm."""
    heavy = {"six": 1.5, "seven": 1.0, "four": 0.3}[robot.name]
    rubs = {"six": 8.0, "seven": 3.0, "four": 0.6}[robot.name]
    return {
        Knob("command_delay", None, "delay"): 0.03,
        Knob("payload", None, "mass"): heavy,
        Knob("coulomb_friction", robot.slots("coulomb_friction")[1], "torque"): rubs,
        Knob("actuator_gain", robot.slots("actuator_gain")[2], "gain"): 0.85,
    }


def network(robot: Robot) -> Residual:
    """Accelerations of a few per cent of the arm's, from positions, velocities and commands."""
    form = JointForm()
    inputs, outputs = form.inputs(robot), form.outputs(robot)
    net = Mlp(len(inputs), outputs=len(outputs))
    rng = np.random.default_rng(3)
    theta = initial_weights(net, rng) + 0.1 * rng.standard_normal(net.size)
    mean, scale = np.zeros(len(inputs)), np.ones(len(inputs))
    return Residual(net, theta, inputs, outputs, mean, scale, np.full(len(outputs), 0.3), "joint", DT, robot.name, 3.0)


def model(robot: Robot, smooth: float = 0.0) -> Augmented:
    """The arm with its effects and the network."""
    return augment(robot, withheld(robot), network(robot), Build(DT, smooth))


def contest(robot: Robot, steps: int, few: int, long: int) -> list[dict[str, Any]]:
    """One row per contestant; those that solve to convergence drive `few` samples, or are left out if it is 0."""
    exact = model(robot)
    settings = usual_settings(exact)
    motion = named_motion("sines", exact, rounds=max(4, int(np.ceil(max(steps, long) * DT / 4.0)) + 1))
    begin = dict(zip(exact.stepped.poses, motion.path(np.zeros(1))[0].tolist(), strict=True))
    problem = ControlProblem(DT, N, motion.path, begin, lambda y, wanted: y - wanted)
    ours, rng = build_mpc(exact, settings), np.random.default_rng(0)
    alone = [real_time("real-time iteration, DAQP", ours, problem)]
    race(alone, ours, problem, steps, steps, rng)
    pair: list[Contestant] = []
    if few:
        rounded = build_mpc(model(robot, smooth=1e-3), replace(settings, compile=False))
        pair = [
            real_time("", ours, problem),
            full("IPOPT, converged, smoothed", rounded, 100, problem),
            do_mpc("do-mpc with IPOPT", rounded, problem),  # with limits on commands only
        ]
        race(pair, ours, problem, few, 10, rng)
    best = alone[0].cost * pair[1].cost / pair[0].cost if few else float("nan")
    rows = [_row(alone[0], best), *(_row(c, pair[1].cost) for c in pair[1:])]
    if long:
        endless: list[Contestant] = [real_time(f"DAQP, {long} steps", ours, problem)]
        race(endless, ours, problem, long, long, rng)
        rows.append(_row(endless[0], float("nan")))
    for r in rows[1:3] if few else ():
        r["times_ours"] = r["cpu_median"] / rows[0]["cpu_median"]
    return rows


def _row(c: Contestant, best: float) -> dict[str, Any]:
    kept = c if len(c.wall) > 40 else replace(c, wall=[c.wall[-1]] * 20 + c.wall, cpu=[c.cpu[-1]] * 20 + c.cpu)
    return row(kept, best)


def recover(robot: rm.NominalRobot, seeds: int, only: tuple[str, ...] | None) -> dict[str, Any]:
    """Tracking errors with the diagnosis of two training motions, on a motion that is in neither."""
    truth = withheld(robot.model)
    plain = rm.augment(robot, dt=DT)
    training: list[Run] = []
    for k, motion in enumerate(("postures", "sines")):
        alone = OwnScenario(robot, plain, motion, truth, controllers=("nominal",))
        driven = alone.drive(RunOptions(seeds=2, seed=7000 + 10 * k), _silent).comparison
        training += [e.run() for e in driven.episodes["nominal"]]
    with tempfile.TemporaryDirectory() as folder:
        for i, run in enumerate(training):
            _write(run, Path(folder) / f"training_{i}.csv")
        runs = rm.read_runs(robot, folder)
        made = rm.diagnose(robot, runs, only=only or ())
    found = rm.augment(robot, made, dt=DT)
    result = OwnScenario(robot, found, "circle", truth).run(RunOptions(seeds=seeds))
    said = [f"{k.effect} [{k.target}] {k.parameter} {v:.3g}" for k, v in _values(found).items()]
    errors = {n: c["tracking_rmse"] for n, c in result["controllers"].items()}
    return {"robot": robot.name, "said": said, "tracking_rmse": errors, "recovered": result["recovered"]["augmented"]}


def _values(found: rm.AugmentedModel) -> Values:
    from residual_mpc.models.model_file import model_in

    return model_in(found.source)[1]


def _write(run: Run, path: Path) -> None:
    import pandas as pd

    pd.DataFrame({"t": run.t, **run.columns}).to_csv(path, index=False)


def _silent(stage: str, done: float) -> None:
    """No progress."""


def main() -> None:
    """Print the tables; --json for machines."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--arms", default="six,seven", help="names, separated by commas: six, seven, four")
    parser.add_argument("--steps", type=int, default=500, help="samples of the real-time iteration")
    parser.add_argument("--few", type=int, default=30, help="samples of every contestant")
    parser.add_argument("--long", type=int, default=0, help="samples of a run of our controller alone")
    parser.add_argument("--recovery", action="store_true", help="diagnose training runs and drive with the diagnosis")
    parser.add_argument("--only", default="", help="effects that the diagnosis may name; by default all")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    out: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in options.arms.split(","):
            robot = load(name, Path(folder))
            if options.recovery:
                only = tuple(filter(None, options.only.split(",")))
                out[name] = recover(robot, options.seeds, only or None)
                print(json.dumps(out[name], indent=2), file=sys.stderr, flush=True)
                continue
            out[name] = contest(robot.model, options.steps, options.few, options.long)
            if not options.json:
                print_table(f"{name} joints, N = {N}, {DT} s", out[name])
                for r in [r for r in out[name] if "times_ours" in r]:
                    print(f"{r['name']}: {r['times_ours']:.0f} times our time")
    if options.json:
        json.dump(out, sys.stdout, indent=2)


if __name__ == "__main__":
    main()
