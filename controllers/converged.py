"""The same control problem solved to convergence by IPOPT: the reference that real-time iteration is held against.

Slow, and meant for tests and benchmarks. The kinks of a leaky ReLU stop it now and then: build the model with
`smooth` > 0 for it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from controllers.mpc import EFFORT, Mpc
from residual_mpc.extras import extra


@dataclass(frozen=True, eq=False)
class Converged:
    """solver: CasADi nlpsol over the plan; parameters (x, sent, reference, p)."""

    mpc: Mpc
    solver: Any

    def solve(
        self, x: np.ndarray, sent: np.ndarray, reference: np.ndarray, guess: np.ndarray
    ) -> tuple[np.ndarray, float, bool]:
        """(plan (N, nu), its cost, whether the solver converged) from a guess (N, nu)."""
        s, m = self.mpc.settings, self.mpc
        n = guess.size
        most = np.tile(s.limits.most(m.model.nu, m.model.build.dt), len(guess))
        extra = len(s.limits.soft)
        parameters = np.concatenate([x, sent, reference.ravel(), m.p])
        rows = [most] + [np.full(2 * len(guess), np.inf)] * extra
        low = [-most] + [np.zeros(2 * len(guess))] * extra
        result = self.solver(
            x0=np.concatenate([guess.ravel(), np.zeros(extra)]),
            p=parameters,
            lbx=np.concatenate([np.tile(m.low, len(guess)), np.zeros(extra)]),
            ubx=np.concatenate([np.tile(m.high, len(guess)), np.full(extra, np.inf)]),
            lbg=np.concatenate(low),
            ubg=np.concatenate(rows),
        )
        plan = np.array(result["x"]).ravel()[:n].reshape(guess.shape)
        return plan, float(result["f"]), bool(self.solver.stats()["success"])


def converged(mpc: Mpc, iterations: int = 200) -> Converged:
    """The full problem of an Mpc, its cost written out once more in CasADi's terms."""
    with extra("mpc"):
        import casadi as ca

    from residual_mpc.export.casadi_model import casadi_model

    model, s = mpc.model, mpc.settings
    c = casadi_model(model)
    n, nx, nu, ny = s.horizon, model.nx, model.nu, len(model.stepped.tracked)
    plan, slack = ca.MX.sym("plan", nu, n), ca.MX.sym("slack", len(s.limits.soft))
    x0, sent, reference = ca.MX.sym("x", nx), ca.MX.sym("sent", nu), ca.MX.sym("reference", ny, n)
    p = ca.MX.sym("p", len(mpc.p))
    v, w = (ca.DM(part) for part in s.weights.of_commands(nu))
    cost: Any = 0
    rows: list[Any] = []
    soft: list[Any] = []
    x, last = x0, sent
    for k in range(n):
        force: Any = None if c.effort is None else c.effort(x, plan[:, k], p)[0]
        x = c.f(x, plan[:, k], p)
        y = ca.vertcat(*[x[int(i)] for i in mpc.poses]) if c.output is None else c.output(x)[0]
        e = y - reference[:, k]
        if "pose.theta" in model.stepped.tracked:
            turn = reference[2, k]
            e = ca.vertcat(
                ca.cos(turn) * e[0] + ca.sin(turn) * e[1],
                -ca.sin(turn) * e[0] + ca.cos(turn) * e[1],
                ca.remainder(e[2], 2 * ca.pi),
            )
        root = mpc.roots[0] if k < n - 1 else mpc.roots[1]
        change = plan[:, k] - last
        cost += 0.5 * ca.sumsqr(ca.mtimes(root, e))
        cost += 0.5 * ca.dot(w * change, change) + 0.5 * ca.dot(v * plan[:, k], plan[:, k])
        rows.append(change)
        last = plan[:, k]
        for j, limit in enumerate(s.limits.soft):
            at = model.stepped
            if limit.channel.startswith(EFFORT):
                value = force[at.commands.index(limit.channel.removeprefix(EFFORT))]
            elif limit.channel in at.tracked:
                value = y[at.tracked.index(limit.channel)]
            else:
                value = x[at.states.index(limit.channel)]
            soft += [value - limit.lower + slack[j], limit.upper - value + slack[j]]
    for j, limit in enumerate(s.limits.soft):
        cost += limit.price * slack[j] + 0.5 * limit.square * slack[j] ** 2
    z = ca.vertcat(ca.vec(plan), slack)
    problem = {"x": z, "p": ca.vertcat(x0, sent, ca.vec(reference), p), "f": cost, "g": ca.vertcat(*rows, *soft)}
    quiet: dict[str, Any] = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes", "ipopt.max_iter": iterations}
    return Converged(mpc, ca.nlpsol("converged", "ipopt", problem, quiet))
