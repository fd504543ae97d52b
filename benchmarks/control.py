"""The MPC's step, timed beside what one would otherwise take: `python -m benchmarks.control`.

A differential drive with dead time, lag and the paper's network in its model, N = 20, 50 ms, box and rate limits, on a
figure-eight of the model itself; and the SCALER arm (`benchmarks.control_arm`). Everything in one process, one thread;
the order is shuffled in blocks so that a busy machine slows all of them alike. Wall time, and CPU time where a machine
is shared.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from controllers.converged import converged
from controllers.mpc import Mpc, build_mpc
from controllers.settings import MpcSettings
from plants.diff_drive import DiffDrive
from residual_mpc.export import Augmented, Build, augment, casadi_model
from residual_mpc.learning.forms.body import BODY
from residual_mpc.learning.network.mlp import Mlp
from residual_mpc.learning.network.residual import Residual
from residual_mpc.models.settings import Knob

DT, N = 0.05, 20
PERIOD = 12.0  # s, of the figure-eight


def model(smooth: float = 0.0) -> Augmented:
    """The rover with 80 ms of dead time, 100 ms of lag, and a network of a few per cent of its speed."""
    rng = np.random.default_rng(3)
    net = Mlp(5)
    inputs = (*(f"previous.{n}" for n in BODY), "command.left", "command.right")
    residual = Residual(
        net, 0.3 * rng.standard_normal(net.size), inputs, BODY, np.zeros(5), np.array([0.3, 0.1, 2.0, 10.0, 10.0]),
        np.array([0.02, 0.01, 0.2]), "body", DT, "rover",
    )  # fmt: skip
    effects = {Knob("command_delay", None, "delay"): 0.08, Knob("actuator_lag", None, "time_constant"): 0.1}
    return augment(DiffDrive("rover", 0.033, 0.16), effects, residual, Build(DT, smooth))


def path(t: np.ndarray) -> np.ndarray:
    """(n, 3) poses of the figure-eight; its clock starts gently, for do-mpc knows no rate limit and ours would bind."""
    t = np.where(t < 2.0, t * t / 4.0, t - 1.0)
    w = 2 * np.pi / PERIOD
    dx, dy = 0.4 * w * np.cos(w * t), 0.4 * w * np.cos(2 * w * t)
    return np.stack([0.4 * np.sin(w * t), 0.2 * np.sin(2 * w * t), np.unwrap(np.arctan2(dy, dx))], axis=-1)


@dataclass(frozen=True)
class ControlProblem:
    """What is driven: path(t (n,)) -> (n, ny); begin: poses by channel at its start; error(y, wanted) (ny,): in the
    frame that the weights speak of.
    """

    dt: float
    steps: int  # of the horizon
    path: Callable[[np.ndarray], np.ndarray]
    begin: Mapping[str, float]
    error: Callable[[np.ndarray, np.ndarray], np.ndarray]

    def ahead(self, k: int) -> np.ndarray:
        """(steps, ny) what is wanted after sample k."""
        return self.path(self.dt * (k + 1 + np.arange(self.steps)))


def drive() -> ControlProblem:
    """The figure-eight."""
    begin = dict(zip(("pose.x", "pose.y", "pose.theta"), path(np.zeros(1))[0].tolist(), strict=True))
    return ControlProblem(DT, N, path, begin, _in_frame)


def _in_frame(y: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    e, c, s = y - wanted, np.cos(wanted[2]), np.sin(wanted[2])
    return np.array([c * e[0] + s * e[1], -s * e[0] + c * e[1], np.remainder(e[2] + np.pi, 2 * np.pi) - np.pi])


@dataclass
class Contestant:
    """One way to close the loop: `step(x, k)` -> command. wall, cpu: ms of each step; cost: in the MPC's own terms."""

    name: str
    step: Any
    x: np.ndarray
    sent: np.ndarray
    wall: list[float]
    cpu: list[float]
    cost: float = 0.0
    failed: int = 0


def real_time(name: str, mpc: Mpc, problem: ControlProblem) -> Contestant:
    """Our controller, with its own warm start."""
    memory = {"state": mpc.init()}

    def step(x: np.ndarray, k: int, sent: np.ndarray) -> tuple[np.ndarray, bool]:
        command, memory["state"], info = mpc.step(memory["state"], x, problem.ahead(k))
        return command, info.outcome != "shifted"

    return _contestant(name, step, mpc.model, problem)


def full(name: str, mpc: Mpc, iterations: int, problem: ControlProblem) -> Contestant:
    """CasADi and IPOPT on the same problem, warm-started with the shifted plan."""
    solver = converged(mpc, iterations)
    memory = {"plan": mpc.init().plan}

    def step(x: np.ndarray, k: int, sent: np.ndarray) -> tuple[np.ndarray, bool]:
        guess = np.concatenate([memory["plan"][1:], memory["plan"][-1:]])
        plan, _, good = solver.solve(x, sent, problem.ahead(k), guess)
        memory["plan"] = plan
        return plan[0], good

    return _contestant(name, step, mpc.model, problem)


def do_mpc(name: str, mpc: Mpc, problem: ControlProblem) -> Contestant:
    """do-mpc with IPOPT (50 iterations at most), the exported model as its right-hand side."""
    import casadi as ca

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of do-mpc's own optional parts
        from do_mpc.controller import MPC
        from do_mpc.model import Model

    m, c, s = mpc.model, casadi_model(mpc.model), mpc.settings
    inner = Model("discrete", "SX")
    x = inner.set_variable("_x", "x", shape=(m.nx, 1))
    u = inner.set_variable("_u", "u", shape=(m.nu, 1))
    tracked = m.stepped.tracked
    wanted = inner.set_variable("_tvp", "wanted", shape=(len(tracked), 1))
    inner.set_rhs("x", c.f(x, u, m.p))
    inner.setup()
    outer = MPC(inner)
    options = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes", "ipopt.max_iter": 50}
    outer.set_param(n_horizon=problem.steps, t_step=problem.dt, store_full_solution=False, nlpsol_opts=options)
    e = ca.vertcat(*[x[int(i)] for i in mpc.poses]) - wanted
    if "pose.theta" in tracked:
        turn = wanted[2]
        ahead = ca.cos(turn) * e[0] + ca.sin(turn) * e[1]
        e = ca.vertcat(ahead, -ca.sin(turn) * e[0] + ca.cos(turn) * e[1], ca.sin(e[2]))
    stage, end = (ca.sumsqr(ca.mtimes(root, e)) for root in mpc.roots)
    outer.set_objective(lterm=stage, mterm=end)
    outer.set_rterm(u=s.weights.of_commands(m.nu)[1])
    outer.bounds["lower", "_u", "u"], outer.bounds["upper", "_u", "u"] = s.limits.box(m.nu)
    template, now = outer.get_tvp_template(), {"k": 0}

    def reference(_: float) -> Any:
        poses = problem.path(problem.dt * (now["k"] + np.arange(problem.steps + 1)))
        for i in range(problem.steps + 1):
            template["_tvp", i, "wanted"] = poses[i]
        return template

    outer.set_tvp_fun(reference)
    outer.setup()
    outer.x0 = m.start(problem.begin)
    outer.u0 = m.hold(m.start(problem.begin))
    outer.set_initial_guess()

    def step(x: np.ndarray, k: int, sent: np.ndarray) -> tuple[np.ndarray, bool]:
        now["k"] = k
        command = np.array(outer.make_step(x[:, None])).ravel()
        return command, bool(outer.solver_stats["success"])

    return _contestant(name, step, m, problem)


def _contestant(name: str, step: Any, m: Augmented, problem: ControlProblem) -> Contestant:
    x = m.start(problem.begin)
    return Contestant(name, step, x, m.hold(x), [], [])


def race(
    contestants: list[Contestant], mpc: Mpc, problem: ControlProblem, steps: int, block: int, rng: np.random.Generator
) -> None:
    """Everyone drives `steps` samples of the same model, in blocks, in shuffled order."""
    plant = build_plant(mpc.model)
    for first in range(0, steps, block):
        for i in rng.permutation(len(contestants)):
            c = contestants[i]
            for k in range(first, min(first + block, steps)):
                wall, cpu = time.perf_counter(), time.process_time()
                command, good = c.step(c.x, k, c.sent)
                c.cpu.append(1e3 * (time.process_time() - cpu))
                c.wall.append(1e3 * (time.perf_counter() - wall))
                c.failed += not good
                c.x = plant(c.x, command)
                c.cost += _cost(mpc, problem, c.x, k, command, c.sent)
                c.sent = command


def build_plant(m: Augmented) -> Any:
    """x+ of the model itself, fast."""
    f = casadi_model(m).f
    return lambda x, u: np.array(f(x, u, m.p)).ravel()


def _cost(mpc: Mpc, problem: ControlProblem, x: np.ndarray, k: int, command: np.ndarray, sent: np.ndarray) -> float:
    e = problem.error(mpc.model.outputs(x), problem.ahead(k)[0])
    w = mpc.settings.weights
    own, change = w.of_commands(len(command))
    return float(np.sum((e / w.error) ** 2) + np.sum(change * (command - sent) ** 2) + np.sum(own * command**2))


def main() -> None:
    """Print the table; --json for machines, --long for the run of 10^5 steps without a failure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--steps", type=int, default=480, help="samples each contestant drives")
    parser.add_argument("--long", type=int, default=0, help="samples of a run of our default controller alone")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    exact, round_, problem = model(), model(smooth=1e-2), drive()
    ours = build_mpc(exact, MpcSettings())
    contestants = [
        real_time("real-time iteration, DAQP", ours, problem),
        real_time("real-time iteration, OSQP", build_mpc(exact, MpcSettings(solver="osqp")), problem),
        real_time("the same without a compiler", build_mpc(exact, MpcSettings(compile=False)), problem),
        full("IPOPT, converged, smoothed", build_mpc(round_, MpcSettings()), 200, problem),
        full("IPOPT, converged, leaky", ours, 50, problem),
        do_mpc("do-mpc with IPOPT, leaky", ours, problem),
    ]
    race(contestants, ours, problem, options.steps, 40, np.random.default_rng(0))
    best = next(c for c in contestants if c.name.startswith("IPOPT, converged, smoothed"))
    rows = [row(c, best.cost) for c in contestants]
    if options.long:
        alone = real_time(f"DAQP, {options.long} steps", build_mpc(exact, MpcSettings()), problem)
        race([alone], ours, problem, options.long, options.long, np.random.default_rng(0))
        rows.append(row(alone, float("nan")))
    from benchmarks.control_arm import arm_rows

    of_arm = arm_rows(options.steps)
    if options.json:
        arm = {"dt": 0.01, "horizon": N, "rows": of_arm}
        json.dump({"dt": DT, "horizon": N, "rows": rows, "arm": arm}, sys.stdout, indent=2)
        return
    print_table("differential drive", rows)
    print_table("SCALER arm", of_arm)


def print_table(title: str, rows: list[dict[str, Any]]) -> None:
    """ms a step; cost over that of the converged solver."""
    print(f"{title:32}{'median':>8}{'p99':>8}{'cpu med':>9}{'cpu p99':>9}{'failed':>8}{'cost':>9}")
    for r in rows:
        print(
            f"{r['name']:32}{r['median']:8.3f}{r['p99']:8.3f}{r['cpu_median']:9.3f}{r['cpu_p99']:9.3f}"
            f"{r['failed']:8d}{r['cost_over_converged']:+9.2%}"
        )


def row(c: Contestant, best: float) -> dict[str, Any]:
    wall, cpu = np.array(c.wall[20:]), np.array(c.cpu[20:])
    return {
        "name": c.name,
        "median": float(np.median(wall)),
        "p99": float(np.quantile(wall, 0.99)),
        "cpu_median": float(np.median(cpu)),
        "cpu_p99": float(np.quantile(cpu, 0.99)),
        "failed": c.failed,
        "cost_over_converged": c.cost / best - 1.0,
    }


if __name__ == "__main__":
    main()
