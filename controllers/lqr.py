"""LQR: about a point, and along a trajectory that the model itself can drive.

About a point the Riccati equation is python-control's. Along a trajectory the finite recursion runs backwards over the
exact linearisations (Anderson and Moore, Optimal Control, 1990, chapter 2), the network's derivative in them. The input
is the change of the command, so that lag and delay of the model and the last command are all part of the state.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from controllers.mpc import Info, build_mpc
from controllers.riccati import controlled, stage_cost, with_last_command
from controllers.settings import Limits, MpcSettings
from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import Augmented
from residual_mpc.export.casadi_model import casadi_model


def backwards(
    A: Sequence[np.ndarray], B: Sequence[np.ndarray], Q: np.ndarray, R: np.ndarray, end: np.ndarray
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """K_k (nu, nx), k = 0 to n - 1, and P_k (nx, nx), k = 0 to n, of x_{k+1} = A_k x_k + B_k u_k, u_k = -K_k x_k.

    x_0'P_0 x_0 is the least cost, Q and R a step and `end` at the end.
    """
    P, gains, costs = end, [], [end]
    for a, b in zip(reversed(A), reversed(B), strict=True):
        K = np.linalg.solve(R + b.T @ P @ b, b.T @ P @ a)
        P = Q + a.T @ P @ (a - b @ K)
        P = 0.5 * (P + P.T)
        gains.append(K)
        costs.append(P)
    return gains[::-1], costs[::-1]


@dataclass(frozen=True, eq=False)
class LqrState:
    """sample: number of the next one; sent (nu,): the last command."""

    sample: int
    sent: np.ndarray


@dataclass(frozen=True, eq=False)
class Lqr:
    """Feedback about a trajectory. x (n + 1, nx), u (n, nu): what the model drives; K (n, nu, states + nu)."""

    model: Augmented
    limits: Limits
    x: np.ndarray
    u: np.ndarray
    K: np.ndarray
    states: np.ndarray
    horizon: int = 1

    def init(self) -> LqrState:
        """At rest, nothing sent yet."""
        return LqrState(0, np.clip(np.zeros(self.model.nu), self.limits.lower, self.limits.upper))

    def step(self, state: LqrState, x: np.ndarray, reference: np.ndarray) -> tuple[np.ndarray, LqrState, Info]:
        """Command (nu,) from the estimate x (nx,). Of `reference` nothing is read: the trajectory was planned ahead."""
        import time

        begin = time.perf_counter()
        k = min(state.sample, len(self.u) - 1)
        before = self.u[k - 1] if k else np.zeros(self.model.nu)
        off = x - self.x[k]
        if "pose.theta" in self.model.stepped.states:
            i = self.model.stepped.states.index("pose.theta")
            off[i] = np.remainder(off[i] + np.pi, 2 * np.pi) - np.pi
        change = self.u[k] - before - self.K[k] @ np.concatenate([off[self.states], state.sent - before])
        good = bool(np.isfinite(change).all())
        wanted = state.sent + change if good else state.sent
        most = self.limits.rate * self.model.build.dt
        command = np.clip(wanted, state.sent - most, state.sent + most)
        command = np.clip(command, self.limits.lower, self.limits.upper)
        outcome = "solved" if good else "shifted"
        info = Info(outcome, time.perf_counter() - begin, float("nan"), 0)  # type: ignore[arg-type]
        return command, LqrState(state.sample + 1, command), info

    def with_parameters(self, p: np.ndarray) -> "Lqr":
        """Raises BadInput: gains along a trajectory are worked out beforehand."""
        raise BadInput("an LQR cannot learn while it drives", self.model.robot.name, "take --controller mpc")


def build_lqr(model: Augmented, path: np.ndarray, settings: MpcSettings) -> Lqr:
    """Gains along `path` (n + horizon, ny), poses a sample apart, from rest at its first pose.

    The trajectory is the one that the MPC drives on the model itself: it keeps the limits, and the model can follow it.
    """
    mpc = build_mpc(model, replace(settings, budget=math.inf))
    n = len(path) - settings.horizon
    x, state = model.start(dict(zip(model.stepped.poses, path[0].tolist(), strict=True))), mpc.init()
    stage = casadi_model(model).stage
    xs, us, A, B = [x], [], [], []
    states = controlled(model)
    for k in range(n):
        u, state, _ = mpc.step(state, x, path[k + 1 : k + 1 + settings.horizon])
        new, a, b = (np.array(v) for v in stage(x, u, model.p))
        bigger = with_last_command(a[np.ix_(states, states)], b[states])
        A.append(bigger[0])
        B.append(bigger[1])
        x = new.ravel()
        xs.append(x)
        us.append(u)
    Q, R = stage_cost(settings.weights, model, states)
    gains, _ = backwards(A, B, Q, R, 10.0 * Q)
    return Lqr(model, settings.limits, np.array(xs), np.array(us), np.array(gains), states)
